"""Files of one recording side by side: positions in one file and torques in another, row by row."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identification.data.recording import RawTable
from phantom_dyn.errors import LogError

_TIME = "t"
# Of the median step: by so much times of one row may differ between files.
_APART = 0.01


def side_by_side(first: RawTable, others: Sequence[RawTable]) -> RawTable:
    """One table of the columns of several files; a name that several have gets that of its file before it.

    So ``joint1`` of ``pos.csv`` and of ``tau.csv`` are ``pos/joint1`` and ``tau/joint1``, which a column map can take.

    Args:
        first: Its time counts, or that of the first file that has one.
        others: Of as many rows.

    Raises:
        LogError: If rows do not belong together.
    """
    counts = Counter(name for raw in (first, *others) for name in raw.names)
    twice = {name for name, count in counts.items() if count > 1 and name != _TIME}
    out, *others = [_renamed(raw, twice) for raw in (first, *others)]
    for other in others:
        rows, own = _rows(out), _rows(other)
        if rows != own:
            raise LogError(
                f"{out.file} has {rows} rows and {other.file} has {own}: files side by side need the same rows; cut "
                "them alike."
            )
        if _TIME in out.columns and _TIME in other.columns:
            _require_same_times(out, other)
        out = replace(
            out,
            columns={**other.columns, **out.columns},
            problems={**other.problems, **out.problems},
            warnings=(*out.warnings, *other.warnings),
        )
    return out


def _renamed(raw: RawTable, twice: set[str]) -> RawTable:
    before = raw.file.rpartition(".")[0] or raw.file
    columns = {f"{before}/{name}" if name in twice else name: values for name, values in raw.columns.items()}
    problems = {f"{before}/{name}" if name in twice else name: said for name, said in raw.problems.items()}
    return replace(raw, columns=columns, problems=problems)


def _rows(raw: RawTable) -> int:
    return len(next(iter(raw.columns.values()), ()))


def _require_same_times(first: RawTable, other: RawTable) -> None:
    t, own = first.columns[_TIME], other.columns[_TIME]
    if len(t) < 2:
        return
    apart = np.abs(t - own)
    if not float(np.max(apart)) <= _APART * abs(float(np.median(np.diff(t)))):
        row = int(np.argmax(apart))
        raise LogError(
            f"{first.file} and {other.file} have different times, {t[row]:g} s and {own[row]:g} s in "
            f"{first.place(row)}: files side by side need the same rows; bring them to one time first."
        )
