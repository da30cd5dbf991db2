"""Noise of each joint's torque residual drawn from what its sensors make."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Series, Session
from identification.diagnosis.noise.discrepancy import shown_error
from identification.diagnosis.noise.reading_noise import reading_noise
from identification.diagnosis.noise.sensor_floor import feigned, torque_densities
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream


def sensed_noise(session: Session, columns: Columns) -> Series:
    """Noise of each log's torque, ``(n, nv)``, drawn from the sensors; zero where a sample is not usable.

    White noise of the torque, and the torque that errors of the position readings feign; zero for a joint whose record
    does not show how its torque is read. Beside it what the model was found to be wrong by in another recording, so
    that it is not found again as a new cause.

    Args:
        session: Recordings at their full rate, and their judged band.
        columns: Which samples are usable.
    """
    robot, rng = session.robot, random_stream("noise of the sensors")
    readings = tuple(tuple(reading_noise(log, j) for j in range(robot.nv)) for log in session.logs)
    densities = torque_densities(session, readings)
    density = np.array([0.0 if one is None else one.value for one in densities])
    known = np.array([one is not None for one in densities])
    out = []
    for k, (log, own, use) in enumerate(zip(session.logs, readings, columns.usable, strict=True)):
        white = rng.normal(size=log.tau.shape) * np.sqrt(0.5 * log.band.rate_hz * density)
        drawn = np.where(use & known, log.band(white + feigned(robot, log, own, rng)), 0.0)
        out.append(drawn + np.where(use, _wrong_model(session, k), 0.0))
    return tuple(out)


def _wrong_model(session: Session, log: int) -> Float[Array, "n nv"]:
    """A torque of the judged band, drawn with the deviation by which the model was found to be wrong."""
    error, own = shown_error(session, log), session.logs[log]
    if not error.any():
        return np.zeros((len(own.samples), error.shape[1]))
    white = random_stream("errors of the model").normal(size=error.shape)
    narrow = session.log_in_judged_band(own.band(white), log)
    return error[own.samples] * narrow / np.maximum(narrow.std(axis=0), 1e-300)
