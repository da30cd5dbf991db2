"""Units that a column map may name, and what turns a value in them into SI."""

from __future__ import annotations

import math

from identification.readers.names import Quantity

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
