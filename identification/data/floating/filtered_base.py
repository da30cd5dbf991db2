"""Motion of a base that is not bolted down, through the filter that the positions of the joints went through.

What white noise of its sensors makes of it is drawn by reading it once more.
"""

from __future__ import annotations

import numpy as np

from identification.data.log import BaseSensors, Log
from identification.data.recording import Recording
from phantom_dyn.array_types import Float
from phantom_dyn.dynamics.moving_base import base_motion
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion
from phantom_dyn.signals.recursive import low_passed
from phantom_dyn.signals.splines import quintic_derivatives

Array = np.ndarray


def filtered_base(
    recording: Recording, robot: Robot, t: Float[Array, " N"], rate_hz: float, cutoff_hz: float
) -> BaseMotion:
    """Motion of the root on a uniform grid, its angular acceleration that of a spline through the gyroscope.

    Args:
        recording: Of a base that is not bolted down.
        robot: Says where its sensors are.
        t: The grid [s].
        rate_hz: Of the grid.
        cutoff_hz: Up to which the motion is kept.
    """
    base = recording.base
    assert base is not None
    both = np.hstack([base.w, base.sf])
    if t is not recording.t:
        both = np.column_stack([np.interp(t, recording.t, column) for column in both.T])
    w, dw, sf = _filtered(both, rate_hz, cutoff_hz)
    return base_motion(robot, base.gyroscope, base.accelerometer, w, dw, sf)


def _filtered(both: Float[Array, "N 6"], rate_hz: float, cutoff_hz: float) -> tuple[Array, Array, Array]:
    """Angular velocity, its derivative, and specific force, below an edge [Hz]."""
    if cutoff_hz < 0.4 * rate_hz:
        both = low_passed(both, cutoff_hz, rate_hz, order=4, padding=int(3 * rate_hz / cutoff_hz))
    w = both[:, :3]
    return w, quintic_derivatives(w, rate_hz)[0], both[:, 3:]


def sensors_of_base(recording: Recording) -> BaseSensors | None:
    """Gyroscope and accelerometer with their white noise, from differences in which motion cancels.

    It is that of their median, as impacts are no noise. None for a base that is bolted down.
    """
    base = recording.base
    if base is None:
        return None
    w, sf = (1.4826 * float(np.median(np.abs(np.diff(x, 3, axis=0)))) / np.sqrt(20.0) for x in (base.w, base.sf))
    return BaseSensors(base.gyroscope, base.accelerometer, (float(w), float(sf)))


def read_once_more(log: Log, rng: np.random.Generator, cutoff_hz: float) -> BaseMotion | None:
    """Motion of the base of a log as its sensors would read it once more; None where it is bolted down."""
    base, sensors = log.motion.base, log.base_sensors
    if base is None or sensors is None:
        return base
    errors = np.repeat(sensors.noise, 3) * rng.normal(size=(len(base.w), 6))
    w, dw, sf = _filtered(errors, log.band.rate_hz, cutoff_hz)
    return BaseMotion(base.w + w, base.dw + dw, base.f + sf)
