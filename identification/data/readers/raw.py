"""RawTable: columns as a file names them, before anything is known of what they mean."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray


def row_place(row: int) -> str:
    """Where sample ``row`` (from 0) stands in a file that has no lines."""
    return f"row {row + 1}"


@dataclass(frozen=True)
class RawTable:
    """Columns of a file under the file's own names.

    Attributes:
        file: Name of the file, for messages.
        columns: One 1-D float array per column that could be read as numbers; lengths may differ.
        problems: For each other column the sentence to raise if somebody wants it.
        place: Where a sample (from 0) stands in the file, as its reader would say it.
        warnings: What was noticed while reading.
    """

    file: str
    columns: Mapping[str, Array]
    problems: Mapping[str, str] = field(default_factory=dict)
    place: Callable[[int], str] = row_place
    warnings: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All column names, readable or not."""
        return (*self.columns, *self.problems)


def listed(names: Iterable[object], limit: int = 12) -> str:
    """Names for a message, the first ``limit`` of them."""
    words = [str(name) for name in names]
    if not words:
        return "none"
    return ", ".join(words[:limit]) + (f" and {len(words) - limit} more" if len(words) > limit else "")
