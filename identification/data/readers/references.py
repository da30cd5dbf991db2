"""References of position controllers from another source than the states: each holds until the next one comes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from identification.data.recording import RawTable
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import LogError


@dataclass(frozen=True)
class SentReferences:
    """References as they were sent.

    Attributes:
        source: Topic or file, for messages.
        t: When each was sent [s], in the time of the states.
        columns: Values by column of the table that they go to, such as ``q_ref.elbow``.
    """

    source: str
    t: Float[Array, " M"]
    columns: Mapping[str, Float[Array, " M"]]


def with_references(table: RawTable, reference: SentReferences) -> RawTable:
    """States with the reference that held at each of them; states before the first one are left out, and counted.

    Args:
        table: States with a column ``t`` [s].
        reference: References that were sent; columns that the table has already are replaced.

    Raises:
        LogError: If no state is left.
    """
    t = table.columns["t"]
    order = np.argsort(reference.t, kind="stable")
    at = np.searchsorted(reference.t[order], t, side="right") - 1
    kept = at >= 0
    if not kept.any():
        raise LogError(
            f"{table.file}: all references of {reference.source} came after the last state: record both at the same "
            "time, and by the same clock."
        )
    rows = order[at[kept]]
    columns = {name: values[kept] for name, values in table.columns.items()}
    columns |= {name: values[rows] for name, values in reference.columns.items()}
    first = int(np.argmax(kept))
    warning = f"{table.file}: {first} states before the first reference of {reference.source} were left out."
    return replace(
        table,
        columns=columns,
        place=lambda row: table.place(row + first),
        warnings=(*table.warnings, warning) if first else table.warnings,
    )
