"""The contract's names of columns, such as ``t`` and ``q.<joint>``, and the units that a column map may name.

The contract's names of columns: ``t``, ``q.<joint>``, ``f.<frame>.x`` and so on.

Units that a column map may name, and what turns a value in them into SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, cast

Quantity = Literal["t", "q", "tau", "v", "i", "u", "q_ref", "x", "f"]

JOINT_QUANTITIES: tuple[Quantity, ...] = ("q", "tau", "v", "i", "u", "q_ref", "x")

# Larger than anything a sensor gives, in SI units: such a value is a broken sample or a wrong unit.
LARGEST: dict[Quantity, float] = {
    "t": 1e11,
    "q": 1e6,
    "tau": 1e9,
    "v": 1e6,
    "i": 1e6,
    "u": 1e6,
    "q_ref": 1e6,
    "x": 1e6,
    "f": 1e9,
}


@dataclass(frozen=True)
class Column:
    """What a column of the contract holds: quantity, joint or frame, and the axis of a force."""

    quantity: Quantity
    of: str = ""
    axis: str = ""


def column_of(name: str) -> Column | None:
    """Meaning of a column name, or None if it is none of the contract's."""
    if name == "t":
        return Column("t")
    prefix, _, rest = name.partition(".")
    if prefix in JOINT_QUANTITIES and rest:
        return Column(cast("Quantity", prefix), rest)
    frame, _, axis = rest.rpartition(".")
    if prefix == "f" and frame and axis in ("x", "y", "z"):
        return Column("f", frame, axis)
    return None


def shape_problem(name: str) -> str | None:
    """What is wrong with a name that starts as the contract's do but is none of them; None for any other name."""
    prefix, dot, _ = name.partition(".")
    folded = prefix.lower()
    if column_of(name) is not None:
        return None
    if prefix == "f" and dot:
        return f"a force is written f.<frame>.x, f.<frame>.y or f.<frame>.z, not {name}"
    if folded in JOINT_QUANTITIES and (dot or folded != "i"):
        return f"a column of a joint is written {folded}.<joint>, not {name}"
    if folded == "t" and (dot or prefix == "T"):
        return f"the time is written t, not {name}"
    return None


_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_POSITION = {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi, "m": 1.0, "mm": 1e-3, "um": 1e-6}
_SPEED = {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "rev/s": 2 * math.pi, "m/s": 1.0, "mm/s": 1e-3}
_FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
_TORQUE = {"Nm": 1.0, "N m": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}

UNITS: dict[Quantity, dict[str, float]] = {
    "t": _TIME,
    "q": _POSITION,
    "q_ref": _POSITION,
    "x": _POSITION,
    "v": _SPEED,
    "tau": {**_TORQUE, **_FORCE},
    "i": {"A": 1.0, "mA": 1e-3},
    "u": {"V": 1.0, "mV": 1e-3},
    "f": _FORCE,
}

# A count is a position; a speed in counts is per second.
COUNTED: tuple[Quantity, ...] = ("q", "q_ref", "x", "v")
