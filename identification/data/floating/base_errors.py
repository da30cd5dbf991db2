"""Usual errors of sound sensors on a floating base, and the spurious torque from each of them.

Sizes are those of sensors of legged robots (Bosch BMI088 and similar): offsets of 20 mg and 1 deg/s, scales within 1 %,
a board mounted to within a degree and a centimetre, and readings some milliseconds later than those of joints.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from identification.data.log import Log
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.moving_base import place_on_base, torque_of_base
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
_LATE = 0.003
"""Standard deviation of the delay, which may be negative [s]."""

SENSOR_ERRORS: dict[str, float] = {f"{kind} {axis}": size for kind, size in _SIZES.items() for axis in "xyz"} | {
    _DELAY: _LATE
}
"""Standard deviation of every error. Offsets and scales are in the sensor's axes, turns and places in the root's."""


def torque_per_base_error(robot: Robot, log: Log, motion: Motion) -> Mapping[str, Float[Array, "N nv"]]:
    """Change of the modelled torque if one unit of an error is removed from the readings, to first order, by error.

    Args:
        robot: The given model.
        log: Gives the frames of the sensors.
        motion: Motion of the log, or a part of it.
    """
    slopes = torque_of_base(robot, motion)
    return {name: np.einsum("njk,nk->nj", slopes, more) for name, more in _corrections(robot, log, motion).items()}


def torque_of_base_errors(robot: Robot, log: Log, sizes: Iterable[tuple[str, float]]) -> Float[Array, "N nv"]:
    """Change of the modelled torque if several errors of given sizes are removed from the readings at once."""
    more = _without(robot, log, log.motion, sizes)
    return np.einsum("njk,nk->nj", torque_of_base(robot, log.motion), more)


def base_without_errors(robot: Robot, log: Log, rows: slice, sizes: Iterable[tuple[str, float]]) -> BaseMotion | None:
    """Motion of the base at some samples after errors of given sizes are removed; None for a fixed base."""
    motion = log.motion.at(rows)
    if motion.base is None:
        return None
    return BaseMotion(*np.split(motion.base.columns + _without(robot, log, motion, sizes), 3, axis=1))


def _without(robot: Robot, log: Log, motion: Motion, sizes: Iterable[tuple[str, float]]) -> Float[Array, "N 9"]:
    """Change of `BaseMotion.columns` if errors of given sizes are removed."""
    errors = [(name, size) for name, size in sizes if size]
    corrections = _corrections(robot, log, motion) if errors else {}
    return sum((size * corrections[name] for name, size in errors), np.zeros((len(motion.t), 9)))


def _corrections(robot: Robot, log: Log, motion: Motion) -> dict[str, Float[Array, "N 9"]]:
    """Change of `BaseMotion.columns` if one unit of an error is removed, by error."""
    base, sensors = motion.base, log.base_sensors
    assert base is not None
    assert sensors is not None
    gyroscope = place_on_base(robot, sensors.gyroscope).rotation
    placed = place_on_base(robot, sensors.accelerometer)
    accelerometer, lever = placed.rotation, placed.translation
    w, dw = base.w, base.dw
    none = np.zeros_like(w)
    felt = base.f + np.cross(dw, lever) + np.cross(w, np.cross(w, lever))

    def root(w_more: Array, dw_more: Array, felt_more: Array) -> Array:
        """Change of the root's motion, in its axes, if the sensors read more by the given amounts."""
        carried = np.cross(w_more, np.cross(w, lever)) + np.cross(w, np.cross(w_more, lever))
        return np.hstack([w_more, dw_more, felt_more - np.cross(dw_more, lever) - carried])

    out = {}
    for k, axis in enumerate("xyz"):
        own, accelerations = np.tile(gyroscope[:, k], (len(w), 1)), np.tile(accelerometer[:, k], (len(w), 1))
        unit = np.tile(np.eye(3)[k], (len(w), 1))

        def along(x: Array, direction: Array) -> Array:
            return (x @ direction[0])[:, None] * direction

        out[f"accelerometer offset {axis}"] = root(none, none, accelerations)
        out[f"accelerometer scale {axis}"] = root(none, none, along(felt, accelerations))
        out[f"gyroscope offset {axis}"] = root(own, none, none)
        out[f"gyroscope scale {axis}"] = root(along(w, own), along(dw, own), none)
        out[f"turn of the base's sensors {axis}"] = root(np.cross(unit, w), np.cross(unit, dw), np.cross(unit, felt))
        out[f"place of the accelerometer {axis}"] = np.hstack(
            [none, none, -np.cross(dw, unit) - np.cross(w, np.cross(w, unit))]
        )
    out[_DELAY] = root(*(np.gradient(x, motion.t, axis=0) for x in (w, dw, felt)))
    return out
