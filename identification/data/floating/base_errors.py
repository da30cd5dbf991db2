"""Typical errors of the sensors on a floating base, and the change of the modelled torque that each of them causes.

The sizes are those of sensors of legged robots (Bosch BMI088 and similar): offsets of 20 mg and 1 deg/s, scales within
1 %, a board mounted to within a degree and a centimetre, and readings some milliseconds later than those of joints.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from identification.data.log import Log
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.moving_base import place_on_base, torque_jacobian_of_base
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion, Motion

_SIZES = {
    "accelerometer offset": 0.2,
    "accelerometer scale": 0.01,
    "gyroscope offset": 0.0175,
    "gyroscope scale": 0.01,
    "turn of the base's sensors": 0.0175,
    "place of the accelerometer": 0.01,
}
"""Standard deviation of each error along one axis [m/s^2, 1, rad/s, 1, rad, m]."""
_DELAY = "delay of the base's sensors"
_DELAY_STD = 0.003
"""Standard deviation of the delay, which may be negative [s]."""

SENSOR_ERRORS: dict[str, float] = {f"{kind} {axis}": size for kind, size in _SIZES.items() for axis in "xyz"} | {
    _DELAY: _DELAY_STD
}
"""Standard deviation of every error. Offsets and scales are in the sensor's axes, turns and places in the base's."""


def torque_per_base_error(robot: Robot, log: Log, motion: Motion) -> Mapping[str, Float[Array, "N nv"]]:
    """For each error, the first-order change of the modelled torque if one unit of it is removed from the readings.

    Args:
        robot: The given model.
        log: The log, with the frames of the sensors.
        motion: Motion of the log, or a part of it.
    """
    slopes = torque_jacobian_of_base(robot, motion)
    changes = _corrections(robot, log, motion)
    return {name: np.einsum("njk,nk->nj", slopes, change) for name, change in changes.items()}


def torque_of_base_errors(robot: Robot, log: Log, sizes: Iterable[tuple[str, float]]) -> Float[Array, "N nv"]:
    """Change of the modelled torque if several errors of given sizes are removed from the readings at once."""
    change = _change_without(robot, log, log.motion, sizes)
    return np.einsum("njk,nk->nj", torque_jacobian_of_base(robot, log.motion), change)


def base_without_errors(robot: Robot, log: Log, rows: slice, sizes: Iterable[tuple[str, float]]) -> BaseMotion | None:
    """Motion of the base in some rows after errors of given sizes were removed; None for a fixed base."""
    motion = log.motion.at(rows)
    if motion.base is None:
        return None
    return BaseMotion(*np.split(motion.base.columns + _change_without(robot, log, motion, sizes), 3, axis=1))


def _change_without(robot: Robot, log: Log, motion: Motion, sizes: Iterable[tuple[str, float]]) -> Float[Array, "N 9"]:
    """Change of `BaseMotion.columns` if errors of given sizes are removed from the readings."""
    errors = [(name, size) for name, size in sizes if size]
    corrections = _corrections(robot, log, motion) if errors else {}
    return sum((size * corrections[name] for name, size in errors), np.zeros((len(motion.t), 9)))


def _corrections(robot: Robot, log: Log, motion: Motion) -> dict[str, Float[Array, "N 9"]]:
    """For each error, the change of `BaseMotion.columns` if one unit of the error is removed from the readings."""
    base, sensors = motion.base, log.base_sensors
    assert base is not None
    assert sensors is not None
    gyroscope = place_on_base(robot, sensors.gyroscope).rotation
    placed = place_on_base(robot, sensors.accelerometer)
    accelerometer, lever = placed.rotation, placed.translation
    w, dw = base.w, base.dw
    none = np.zeros_like(w)
    force = base.f + np.cross(dw, lever) + np.cross(w, np.cross(w, lever))

    def base_change(w_change: Array, dw_change: Array, force_change: Array) -> Array:
        """Change of the base's motion, in its axes, if the sensors' readings change by the given amounts."""
        centripetal = np.cross(w_change, np.cross(w, lever)) + np.cross(w, np.cross(w_change, lever))
        return np.hstack([w_change, dw_change, force_change - np.cross(dw_change, lever) - centripetal])

    def along(x: Array, direction: Array) -> Array:
        """Component of vectors along an axis of a sensor, which is repeated in every row of ``direction``."""
        return (x @ direction[0])[:, None] * direction

    out = {}
    for k, axis in enumerate("xyz"):
        of_gyroscope, of_accelerometer = (np.tile(axes[:, k], (len(w), 1)) for axes in (gyroscope, accelerometer))
        unit = np.tile(np.eye(3)[k], (len(w), 1))
        out[f"accelerometer offset {axis}"] = base_change(none, none, of_accelerometer)
        out[f"accelerometer scale {axis}"] = base_change(none, none, along(force, of_accelerometer))
        out[f"gyroscope offset {axis}"] = base_change(of_gyroscope, none, none)
        out[f"gyroscope scale {axis}"] = base_change(along(w, of_gyroscope), along(dw, of_gyroscope), none)
        turned = (np.cross(unit, x) for x in (w, dw, force))
        out[f"turn of the base's sensors {axis}"] = base_change(*turned)
        out[f"place of the accelerometer {axis}"] = np.hstack(
            [none, none, -np.cross(dw, unit) - np.cross(w, np.cross(w, unit))]
        )
    out[_DELAY] = base_change(*(np.gradient(x, motion.t, axis=0) for x in (w, dw, force)))
    return out
