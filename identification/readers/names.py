"""The contract's names of columns: ``t``, ``q.<joint>``, ``f.<frame>.x`` and so on."""

from __future__ import annotations

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
