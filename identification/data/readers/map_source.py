"""One entry of a column map: the column of the file, and the factor and offset that make SI units of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import msgspec

from identification.data.readers.contract_columns import COUNTED, JOINT_QUANTITIES, LARGEST, UNITS, Quantity, column_of
from phantom_dyn.errors import LogError, known_names, listed, shortened
from phantom_dyn.model.files.settings_file import describe

JOINT, NUMBER = "{joint}", "{number}"
"""Placeholders for the name and for the number of any joint in the name of a column."""
COMPENSATED, LOW_PASS, LATE = "compensated", "low_pass", "late"
"""Keys of an entry that say what a controller or a recorder did to a torque."""
ENTRY_KEYS = (COMPENSATED, LOW_PASS, LATE, "from", "unit", "sign", "counts", "gear", "offset")
SMALLEST, LARGEST_NUMBER = 1e-6, 1e12
"""Limits of gear ratios, counts, cut-offs and times, so that products of two of them are finite floats."""
# Quantities that a gear ratio multiplies from the motor's to the joint's side; it divides positions and speeds.
_TORQUES: tuple[Quantity, ...] = ("tau",)
# Quantities whose zero is a convention, so that they may have an offset.
_WITH_OFFSET: tuple[Quantity, ...] = ("q", "q_ref", "x")


class _Source(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One entry of a map as the user writes it."""

    name: str = msgspec.field(name="from")
    unit: str | None = None
    sign: int = 1
    counts: float | None = None
    gear: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Source:
    """Column of the file for one entry of a map.

    Attributes:
        name: Name of the column; ``{joint}`` stands for the name of any joint, ``{number}`` for any joint's number.
        factor: Factor to SI units on the joint's side.
        offset: Offset of a position [rad or m], added after the factor.
    """

    name: str
    factor: float
    offset: float = 0.0


def _factor(where: str, quantity: Quantity, source: _Source) -> float:
    """Factor to SI units on the joint's side."""
    if source.sign not in (1, -1):
        raise LogError(f"{where}.sign is {shortened(str(source.sign))}, wanted 1 or -1.")
    if not SMALLEST <= source.gear <= LARGEST_NUMBER:
        raise LogError(f"{where}.gear is {source.gear:g}, wanted the ratio of the gear, above 0 (1e-6 to 1e12).")
    if source.gear != 1 and quantity not in (*_TORQUES, *COUNTED):
        wanted = listed((*_TORQUES, *COUNTED))
        raise LogError(f"{where}.gear is for what has a motor's side ({wanted}): leave it out.")
    gear_factor = source.gear if quantity in _TORQUES else 1 / source.gear
    return gear_factor * _plain_factor(where, quantity, source)


def _offset(where: str, quantity: Quantity, source: _Source) -> float:
    """Offset of a position [rad or m]; the entry states it in its own unit, on the joint's side."""
    if source.offset and quantity not in _WITH_OFFSET:
        raise LogError(f"{where}.offset is for positions ({listed(_WITH_OFFSET)}): leave it out.")
    offset = source.offset * abs(_plain_factor(where, quantity, source))
    if not abs(offset) <= LARGEST[quantity]:
        raise LogError(f"{where}.offset is {source.offset:g}, wanted the position at which the log has zero.")
    return offset


def _plain_factor(where: str, quantity: Quantity, source: _Source) -> float:
    """Factor to SI units, without the gear ratio."""
    if source.counts is not None:
        if source.unit is not None:
            raise LogError(f"{where} has both unit and counts: give one of them.")
        if quantity not in COUNTED:
            raise LogError(f"{where}.counts is for positions and speeds ({', '.join(COUNTED)}): give a unit instead.")
        if not SMALLEST <= source.counts <= LARGEST_NUMBER:
            raise LogError(f"{where}.counts is {source.counts:g}, wanted the counts per revolution, above 0, to 1e12.")
        return source.sign * 2 * math.pi / source.counts
    if source.unit is None:
        return float(source.sign)
    units = UNITS[quantity]
    if source.unit not in units:
        raise LogError(
            f"{where}.unit is {shortened(source.unit)!r}: {known_names(source.unit, units, 'units of ' + quantity)}"
        )
    return source.sign * units[source.unit]


def source_of(file: str, key: str, value: Any) -> Source:
    """The source that an entry of a map states.

    Args:
        file: Name of the map, for messages.
        key: Standard name, or a quantity for all joints.
        value: The entry as the user wrote it.

    Raises:
        LogError: If the entry is not valid; one sentence says why.
    """
    where = f"{file}: {shortened(key)}"
    given = {"from": value} if isinstance(value, str) else value
    if not isinstance(given, dict):
        raise LogError(f"{where} is {describe(value)}, wanted a column name or {{from: NAME, unit: UNIT}}.")
    unknown = [str(name) for name in given if name not in ENTRY_KEYS]
    if unknown:
        known = known_names(unknown[0], ENTRY_KEYS, "keys")
        raise LogError(f"{where} has the unknown key {shortened(unknown[0])}: {known}")
    if "from" not in given:
        raise LogError(f"{where} does not say which column it is: add from: NAME.")
    try:
        source = msgspec.convert(given, _Source)
    except msgspec.ValidationError as error:
        reason = str(error).replace("`", "")
        raise LogError(f"{where}: {reason}: correct it, as in {{from: NAME, unit: UNIT}}.") from error
    column = column_of(key)
    if column is None and key in JOINT_QUANTITIES:
        if source.name.count(JOINT) + source.name.count(NUMBER) != 1:
            raise LogError(
                f"{where} is meant for every joint, but from is {shortened(source.name)!r}: put {JOINT} into it once, "
                f"or {NUMBER}, or write {key}.<joint>."
            )
        quantity = cast("Quantity", key)
    elif column is not None:
        quantity = column.quantity
    else:
        raise LogError(
            f"{where} is no column of a log: write t, f.<frame>.x/.y/.z, p.<frame>.x/.y/.z, "
            "o.<frame>.qx/.qy/.qz/.qw, w.<frame>.x/.y/.z, sf.<frame>.x/.y/.z, contact.<frame>, "
            f"or one of {', '.join(JOINT_QUANTITIES)} followed by .<joint>."
        )
    return Source(source.name, _factor(where, quantity, source), _offset(where, quantity, source))
