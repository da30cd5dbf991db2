"""The standard columns of a log (``t``, ``q.<joint>``, ``p.<frame>.x``, ...): names, units, and the check of a file.

`contract_table` takes the columns with these names from a file. It raises an error for a missing column, a value that
no sensor gives, or a time that decreases, and warns of columns that it leaves out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from identification.data.readers.held_rows import rows_once_read
from identification.data.recording import RawTable, Table
from phantom_dyn.array_types import Array, Bool, Float, read_only
from phantom_dyn.errors import LogError, listed, shortened

Quantity = Literal[
    "t", "q", "tau", "v", "i", "u", "q_ref", "v_ref", "duty", "x", "temp", "supply", "f", "p", "o", "w", "sf", "contact"
]  # fmt: skip

JOINT_QUANTITIES: tuple[Quantity, ...] = ("q", "tau", "v", "i", "u", "q_ref", "v_ref", "duty", "x", "temp")
ALONE: tuple[Quantity, ...] = ("t", "supply")
"""Quantities of the whole robot; the names of their columns contain no joint or frame."""

_XYZ = ("x", "y", "z")
FRAME_AXES: dict[str, tuple[str, ...]] = {"f": _XYZ, "p": _XYZ, "o": ("qx", "qy", "qz", "qw"), "w": _XYZ, "sf": _XYZ}
"""Components of each vector or quaternion of a frame."""

FRAME_FLAGS: tuple[Quantity, ...] = ("contact",)
"""Quantities of a frame that have a single column."""

MEANT = {
    "f": "a force",
    "p": "a position",
    "o": "an orientation",
    "w": "the angular velocity of a gyroscope",
    "sf": "the specific force of an accelerometer",
}
"""Words for the quantities of a frame in messages."""

# Largest value of each quantity in SI units, far above what any sensor gives. A larger value is an error, or in another
# unit.
LARGEST: dict[Quantity, float] = {
    "t": 1e11,
    "q": 1e6,
    "tau": 1e9,
    "v": 1e6,
    "i": 1e6,
    "u": 1e6,
    "q_ref": 1e6,
    "v_ref": 1e6,
    "duty": 1e3,
    "supply": 1e6,
    "x": 1e6,
    "temp": 2e3,
    "f": 1e9,
    "p": 1e6,
    "o": 1e3,
    "w": 1e4,
    "sf": 1e5,
    "contact": 1.0,
}

_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_POSITION = {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi, "m": 1.0, "mm": 1e-3, "um": 1e-6}
_LENGTH = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
_SPEED = {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "rev/s": 2 * math.pi, "m/s": 1.0, "mm/s": 1e-3}
_FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
_TORQUE = {"Nm": 1.0, "N m": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}

UNITS: dict[Quantity, dict[str, float]] = {
    "t": _TIME,
    "q": _POSITION,
    "q_ref": _POSITION,
    "x": _POSITION,
    "v": _SPEED,
    "v_ref": _SPEED,
    "duty": {"1": 1.0, "percent": 0.01},
    "supply": {"V": 1.0, "mV": 1e-3},
    "tau": {**_TORQUE, **_FORCE},
    "i": {"A": 1.0, "mA": 1e-3},
    "u": {"V": 1.0, "mV": 1e-3},
    "temp": {"degC": 1.0},
    "f": _FORCE,
    "p": _LENGTH,
    "o": {"1": 1.0},
    "w": {"rad/s": 1.0, "deg/s": math.pi / 180},
    "sf": {"m/s^2": 1.0, "g": 9.80665},
    "contact": {"1": 1.0},
}

# Quantities that may be in encoder counts; a speed is then in counts per second.
COUNTED: tuple[Quantity, ...] = ("q", "q_ref", "x", "v", "v_ref")

# A simulation diverged if a signal went this many times farther in the last rows before the first impossible value than
# in the first half of the rows before that value.
_LAST_ROWS, _GREW = 20, 100.0

FEWEST_ROWS = 50
FEWEST_POSES = 20
"""Smallest number of rows of a file of measured poses without torque: a laser tracker needs seconds for each pose."""

SHORTEST_STEP, LONGEST_STEP = 1e-5, 1e9
"""Limits of the median time between two samples [s]."""


@dataclass(frozen=True)
class Column:
    """Meaning of a standard column: quantity, joint or frame, and for a vector of a frame the component."""

    quantity: Quantity
    of: str = ""
    axis: str = ""


def column_of(name: str) -> Column | None:
    """Meaning of a column name, or None if it is not a standard one."""
    if name in ALONE:
        return Column(cast("Quantity", name))
    prefix, _, rest = name.partition(".")
    if prefix in (*JOINT_QUANTITIES, *FRAME_FLAGS) and rest:
        return Column(cast("Quantity", prefix), rest)
    frame, _, axis = rest.rpartition(".")
    if frame and axis in FRAME_AXES.get(prefix, ()):
        return Column(cast("Quantity", prefix), frame, axis)
    return None


def name_problem(name: str) -> str | None:
    """Message on a name that looks like a misspelt standard one; None for any other name."""
    prefix, dot, _ = name.partition(".")
    folded = prefix.lower()
    if column_of(name) is not None:
        return None
    # Names like w.<...> are not checked: in logs of robots with a fixed base they may mean something else.
    if prefix in ("f", "p", "o") and dot:
        *first, last = [f"{prefix}.<frame>.{axis}" for axis in FRAME_AXES[prefix]]
        written = f"{', '.join(first)} or {last}"
        return f"{MEANT[prefix]} is written {written}, not {shortened(name)}"
    if folded in JOINT_QUANTITIES and (dot or folded not in ("i", "temp")):
        return f"a column of a joint is written {folded}.<joint>, not {shortened(name)}"
    if folded == "t" and (dot or prefix == "T"):
        return f"the time is written t, not {shortened(name)}"
    return None


def _contract_names(raw: RawTable) -> tuple[dict[str, Column], tuple[str, ...]]:
    """The standard columns in the file, and the names of the other columns."""
    wanted = {name: column for name in raw.names if (column := column_of(name)) is not None}
    for name in raw.names:
        sentence = None if name in wanted else name_problem(name)
        if sentence is not None and name in raw.problems:
            raise LogError(raw.problems[name])
        if sentence is not None:
            raise LogError(f"{raw.file}: {sentence}: rename the column or map it with --columns.")
    return wanted, tuple(name for name in raw.names if name not in wanted)


class UnknownNamesError(LogError):
    """A needed column is missing, perhaps because it has another name; ``names`` are the file's column names."""

    def __init__(self, message: str, names: tuple[str, ...] = ()):
        super().__init__(message)
        self.names = names


def _require_columns(raw: RawTable, wanted: Mapping[str, Column], others: tuple[str, ...]) -> None:
    """Raise an error if there is no time or no position."""
    own = listed(raw.named.get(name, name) for name in raw.names)
    if not wanted:
        raise UnknownNamesError(
            f"{raw.file} has none of a log's columns (t, q.<joint>, tau.<joint>, ...), its columns are "
            f"{listed(others)}: rename them or map them with --columns.",
            raw.names,
        )
    if "t" not in wanted:
        raise UnknownNamesError(
            f"{raw.file} has no column t (time in seconds), its columns are {own}: add it or map it with "
            "--columns; of rows at a known rate write rate: 100 [Hz] into the map.",
            raw.names,
        )
    if not any(column.quantity == "q" for column in wanted.values()):
        raise UnknownNamesError(
            f"{raw.file} has no column q.<joint> (measured position), its columns are {own}: add it or "
            "map it with --columns.",
            raw.names,
        )


def _readable(raw: RawTable, wanted: Mapping[str, Column]) -> dict[str, Array]:
    """The standard columns, after a check that they hold numbers and have the same length."""
    for name in wanted:
        if name in raw.problems:
            raise LogError(raw.problems[name])
    columns = {name: raw.columns[name] for name in wanted}
    n = len(columns["t"])
    for name, values in columns.items():
        if len(values) != n:
            raise LogError(
                f"{raw.file}: column {shortened(name)} has {len(values)} rows and t has {n}: every column needs "
                "one value a row; write them again."
            )
    if n == 0:
        raise LogError(f"{raw.file} has no rows: its columns are there but empty; record it again.")
    return columns


def _with_divergence_clipped(columns: Mapping[str, Array], wanted: Mapping[str, Column]) -> Mapping[str, Array]:
    """The columns, with the values of a simulation that diverged clipped to the limits of `LARGEST`.

    A value is impossible if it is not finite or larger than any sensor gives. A simulation diverged if, from some row
    on, every row has an impossible value, and a signal grew before. Such a log is accepted here, because the user may
    exclude its end. Other impossible values are refused by `_require_possible`.
    """
    limits = {name: LARGEST[wanted[name].quantity] for name in columns if name != "t"}
    with np.errstate(invalid="ignore"):
        bad = np.any([~(np.abs(columns[name]) <= limit) for name, limit in limits.items()], axis=0)
    first = int(np.argmax(bad))
    if first < FEWEST_ROWS or not bad[first:].all():
        return columns
    distances = [np.abs(columns[name][:first] - columns[name][0]) for name in limits]
    if not any(one[-_LAST_ROWS:].max() > _GREW * one[: first // 2].max() > 0 for one in distances):
        return columns
    clipped = {n: np.clip(np.nan_to_num(columns[n], nan=limit), -limit, limit) for n, limit in limits.items()}
    return {**columns, **clipped}


def _require_possible(raw: RawTable, columns: Mapping[str, Array], wanted: Mapping[str, Column]) -> None:
    """Raise an error for the first value that is not finite, or larger than any sensor gives."""
    for name, values in columns.items():
        largest = LARGEST[wanted[name].quantity]
        with np.errstate(invalid="ignore"):
            bad = np.flatnonzero(~(np.abs(values) <= largest))
        if not len(bad):
            continue
        row = int(bad[0])
        value = values[row]
        where = f"{raw.file}, {raw.place(row)}, column {shortened(name)}"
        if not np.isfinite(values).any():
            raise LogError(
                f"{raw.file}: column {shortened(name)} is {value} in every row: record it, or leave the column out."
            )
        if not np.isfinite(value):
            others = int(np.count_nonzero(~np.isfinite(values))) - 1
            more, rows = (f", and {others} more rows are no numbers", "these rows") if others else ("", "the row")
            raise LogError(f"{where} is {value}{more}: every value must be a number; repair or delete {rows}.")
        unit = next((unit for unit, factor in _TIME.items() if abs(value) * factor <= largest), None)
        entry = f", or write t: {{from: t, unit: {unit}}} into a column map (--columns)" if unit else ""
        others_hint = "give SI units (--columns converts), or delete the row"
        hint = f"give the time in seconds{entry}" if name == "t" else others_hint
        raise LogError(f"{where} is {value:g}, which no sensor gives (limit {largest:g}): {hint}.")


def _kept_rows(raw: RawTable, columns: Mapping[str, Array]) -> Array:
    """True for rows that differ from the row before in any column.

    Raises:
        LogError: If the time of such a row does not increase.
    """
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
            f"{where}: the time {t[row]:.9g} s is that of the row before, but {shortened(differing)} differs: every "
            "sample needs a time of its own; write the time with more digits or delete one of the rows."
        )
    raise LogError(
        f"{where}: the time goes back from {t[row - 1]:.9g} s to {t[row]:.9g} s: time must increase; sort the rows, "
        "or give each recording in a file of its own."
    )


def _require_rate(raw: RawTable, t: Array) -> None:
    """Raise an error for a sample rate that no recorder has: the time is then not in seconds."""
    step = float(np.median(np.diff(t)))
    if not SHORTEST_STEP * (1 - 1e-6) <= step <= LONGEST_STEP:
        raise LogError(
            f"{raw.file}: the time steps by {step:.3g} s (median), wanted {SHORTEST_STEP:g} s or more: "
            "give the time in seconds, or say its unit in a column map (--columns), as in t: {from: t, unit: ms}."
        )


def _poses_alone(wanted: Mapping[str, Column]) -> bool:
    """True if a file has measured poses and neither torques nor references; its rows may then be minutes apart."""
    quantities = {column.quantity for column in wanted.values()}
    return "p" in quantities and not quantities & {"tau", "i", "u", "q_ref"}


def _require_rows(raw: RawTable, rows: int, poses_alone: bool) -> None:
    """Raise an error for too few rows."""
    counted = "1 row" if rows == 1 else f"{rows} rows"
    if poses_alone and rows < FEWEST_POSES:
        raise LogError(
            f"{raw.file} has {counted}, too few poses to tell anything: record at least {FEWEST_POSES} in different "
            "postures of all joints."
        )
    if not poses_alone and rows < FEWEST_ROWS:
        raise LogError(
            f"{raw.file} has {counted}, too few to tell anything: record at least {FEWEST_ROWS}, better several "
            "seconds of motion."
        )


def _without_repeats(
    raw: RawTable, columns: Mapping[str, Float[Array, " N"]], kept: Bool[Array, " N"]
) -> tuple[Bool[Array, " N"], tuple[str, ...]]:
    """The kept rows without repeated readings, and a warning if a recorder wrote each reading several times."""
    once, each = rows_once_read({name: values[kept] for name, values in columns.items()})
    if once.all() or once.sum() < FEWEST_ROWS:
        return kept, ()
    t = columns["t"][kept]
    rate = (len(t) - 1) / (t[-1] - t[0])
    out = kept.copy()
    out[kept] = once
    return out, (
        f"{raw.file}: each reading of the robot is written {each:.2g} times, exactly: it was read at "
        f"{rate / each:.3g} Hz and logged at {rate:.3g} Hz; the repeated rows were dropped.",
    )


def contract_table(raw: RawTable) -> Table:
    """The standard columns of a file, after all checks.

    Args:
        raw: Columns under the names of the file, or renamed by a column map.

    Returns:
        Read-only columns in SI units, without repeated rows. Warnings state the number of repeated rows, and the
        columns that were left out.

    Raises:
        LogError: If a column is missing or misnamed, has no numbers or another length, a value is impossible, the time
            does not increase, or there are too few rows.
    """
    wanted, others = _contract_names(raw)
    _require_columns(raw, wanted, others)
    columns = _with_divergence_clipped(_readable(raw, wanted), wanted)
    _require_possible(raw, columns, wanted)
    kept = _kept_rows(raw, columns)
    rows = int(kept.sum())
    poses_alone = _poses_alone(wanted)
    _require_rows(raw, rows, poses_alone)
    if not poses_alone:
        _require_rate(raw, columns["t"][kept])
    warnings = raw.warnings
    dropped = len(kept) - rows
    if dropped:
        noun = "row that repeats the one before was" if dropped == 1 else "rows that repeat the one before were"
        warnings += (f"{raw.file}: {dropped} {noun} dropped.",)
    kept, repeats = _without_repeats(raw, columns, kept)
    warnings += repeats
    if others:
        noun = "column" if len(others) == 1 else "columns"
        warnings += (f"{raw.file}: {noun} {listed(others)} not used: no name of a log's columns.",)
    columns = {name: read_only(values if kept.all() else values[kept]) for name, values in columns.items()}
    return Table(raw.file, columns, warnings, raw.compensated, raw.low_pass, raw.named, raw.references_held, raw.late)
