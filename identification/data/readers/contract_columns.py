"""From the columns of a file to the contract's: what must be there, what cannot be right, what is left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from identification.data.readers.names import LARGEST, Column, column_of, shape_problem
from identification.data.readers.raw import RawTable, listed
from identification.data.recording import Table
from phantom_dyn.errors import LogError
from phantom_dyn.motion import read_only

Array = np.ndarray

FEWEST_ROWS = 50


def _contract_names(raw: RawTable) -> tuple[dict[str, Column], tuple[str, ...]]:
    """The contract's columns in the file and the names of the others."""
    wanted = {name: column for name in raw.names if (column := column_of(name)) is not None}
    for name in raw.names:
        sentence = None if name in wanted else shape_problem(name)
        if sentence is not None and name in raw.problems:
            raise LogError(raw.problems[name])
        if sentence is not None:
            raise LogError(f"{raw.file}: {sentence}: rename the column or map it with --columns.")
    return wanted, tuple(name for name in raw.names if name not in wanted)


def _require_columns(raw: RawTable, wanted: Mapping[str, Column], others: tuple[str, ...]) -> None:
    if not wanted:
        raise LogError(
            f"{raw.file} has none of a log's columns (t, q.<joint>, tau.<joint>, ...), its columns are "
            f"{listed(others)}: rename them or map them with --columns."
        )
    if "t" not in wanted:
        raise LogError(
            f"{raw.file} has no column t (time in seconds), its columns are {listed(raw.names)}: add it or map it "
            "with --columns."
        )
    if not any(column.quantity == "q" for column in wanted.values()):
        raise LogError(
            f"{raw.file} has no column q.<joint> (measured position), its columns are {listed(raw.names)}: add it or "
            "map it with --columns."
        )


def _readable(raw: RawTable, wanted: Mapping[str, Column]) -> dict[str, Array]:
    for name in wanted:
        if name in raw.problems:
            raise LogError(raw.problems[name])
    columns = {name: raw.columns[name] for name in wanted}
    n = len(columns["t"])
    for name, values in columns.items():
        if len(values) != n:
            raise LogError(
                f"{raw.file}: column {name} has {len(values)} rows and t has {n}: every column needs one value a row."
            )
    if n == 0:
        raise LogError(f"{raw.file} has no rows: its columns are there but empty.")
    return columns


def _require_possible(raw: RawTable, columns: Mapping[str, Array], wanted: Mapping[str, Column]) -> None:
    """Refuse the first value that is not finite or that no sensor gives."""
    for name, values in columns.items():
        largest = LARGEST[wanted[name].quantity]
        with np.errstate(invalid="ignore"):
            bad = np.flatnonzero(~(np.abs(values) <= largest))
        if not len(bad):
            continue
        row = int(bad[0])
        value = values[row]
        where = f"{raw.file}, {raw.place(row)}, column {name}"
        if not np.isfinite(value):
            raise LogError(f"{where} is {value}: every value must be a number; repair or delete the row.")
        hint = "give the time in seconds" if name == "t" else "give SI units (--columns converts), or delete the row"
        raise LogError(f"{where} is {value:g}, which no sensor gives (limit {largest:g}): {hint}.")


def _kept_rows(raw: RawTable, columns: Mapping[str, Array]) -> Array:
    """Rows without the identical repetitions; refuses a time that does not increase."""
    t = columns["t"]
    same = np.ones(len(t) - 1, dtype=bool)
    for values in columns.values():
        same &= values[1:] == values[:-1]
    kept = np.concatenate([[True], ~same])
    bad = np.flatnonzero((np.diff(t) <= 0) & ~same)
    if not len(bad):
        return kept
    row = int(bad[0]) + 1
    where = f"{raw.file}, {raw.place(row)}"
    if t[row] == t[row - 1]:
        differing = next(name for name, values in columns.items() if values[row] != values[row - 1])
        raise LogError(
            f"{where}: the time {t[row]:.9g} s is that of the row before, but {differing} differs: every sample needs "
            "a time of its own; write the time with more digits or delete one of the rows."
        )
    raise LogError(
        f"{where}: the time goes back from {t[row - 1]:.9g} s to {t[row]:.9g} s: time must increase; sort the rows, "
        "or give each recording in a file of its own."
    )


def contract_table(raw: RawTable) -> Table:
    """The contract's columns of a file, checked.

    Args:
        raw: Columns as the file names them, or as a column map renamed them.

    Returns:
        One read-only column each in SI units, identical repeated rows dropped; warnings count those and name the
        columns that were left out.

    Raises:
        LogError: If a column is missing, misnamed, no numbers or of another length, a value is impossible, the time
            does not increase, or there are too few rows.
    """
    wanted, others = _contract_names(raw)
    _require_columns(raw, wanted, others)
    columns = _readable(raw, wanted)
    _require_possible(raw, columns, wanted)
    kept = _kept_rows(raw, columns)
    rows = int(kept.sum())
    if rows < FEWEST_ROWS:
        raise LogError(
            f"{raw.file} has {rows} rows, too few to tell anything: record at least {FEWEST_ROWS}, "
            "better several seconds of motion."
        )
    warnings = raw.warnings
    dropped = len(kept) - rows
    if dropped:
        noun = "row that repeats the one before was" if dropped == 1 else "rows that repeat the one before were"
        warnings += (f"{raw.file}: {dropped} {noun} dropped.",)
    if others:
        noun = "column" if len(others) == 1 else "columns"
        warnings += (f"{raw.file}: {noun} {listed(others)} not used: no name of a log's columns.",)
    return Table(raw.file, {name: read_only(values[kept]) for name, values in columns.items()}, warnings)
