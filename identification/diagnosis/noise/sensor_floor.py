"""Noise floor of each joint: the noise of its sensors, propagated to the torque in the judged band.

The judged band, also called the band of the motion, has the low frequencies in which the corrected model is judged. New
encoder noise is drawn for the smooth motion and propagated through derivatives, model and filters. The noise of the
torque is assumed to be white. Its density (power per hertz) is measured above the judged band, where there is hardly
any motion. It is the smaller of two densities: that of the noise in the torque readings (a commanded torque has none),
and that of measured minus modelled torque (the balance). If the density of the balance rises towards the judged band,
the noise is not white, and may be larger inside the band than above it. Then only an upper limit is known. The same
holds for torques that are read in coarse steps: the rounding error is constant while the torque stays within a step. No
fitted model and no flexible predictor is used, because a torque that these do not predict need not be noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.data.derivatives import differentiate, motion_edge, position_edges
from identification.data.floating.base_columns import with_redrawn_noise
from identification.data.log import Log
from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Series, Session
from identification.diagnosis.noise.balance_noise import (
    SubBand,
    balance_bands,
    balance_noise,
    reading_errors,
    rising_density,
)
from identification.diagnosis.noise.certain_samples import root_weights
from identification.diagnosis.noise.discrepancy import earlier_model_error
from identification.diagnosis.noise.reading_noise import ReadingNoise, reading_noise
from identification.diagnosis.noise.sensor_noise import Density, torque_noise
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.effects.support.encoder_lattice import reading_step
from phantom_dyn.model.robot import Robot
from phantom_dyn.random_streams import random_stream

# Noise of each joint's position readings in each log; None where it is unknown.
Readings = tuple[tuple[ReadingNoise | None, ...], ...]

_DENSITY_UNCERTAINTY = 1.25  # largest factor between estimated and true density (benchmarks/noise_floor.py)
# Torque steps are coarse if more than this share of the readings equal the one before.
_REPEATED_SHARE = 0.5  # noise of half a step leaves fewer equal readings
_DRAWS = 4  # number of draws of reading errors: with one, their rms torque in a narrow band is uncertain by a tenth


@dataclass(frozen=True)
class SensorFloor:
    """Noise of each joint's torque in the judged band from its sensors: root mean squares [N m or N], ``(nv,)`` each.

    Attributes:
        value: Estimate; NaN for a joint whose noise the recording does not show.
        low, high: Interval of the estimate.
        torque: Part from noise of the torque readings or of the drive.
        encoders: Part from noise of the position readings.
        limit_if_rising: Upper limit for noise that is not white and whose density may also rise inside the band; zero
            for white noise.
    """

    value: Float[Array, " nv"]
    low: Float[Array, " nv"]
    high: Float[Array, " nv"]
    torque: Float[Array, " nv"]
    encoders: Float[Array, " nv"]
    limit_if_rising: Float[Array, " nv"]

    @property
    def known(self) -> Bool[Array, " nv"]:
        """True for joints whose noise the recording shows."""
        return np.isfinite(self.value)


def sensor_floor(session: Session, usable: tuple[Float[Array, "n nv"], ...], deviations: float = 2.0) -> SensorFloor:
    """Noise floor of each joint in the judged band, propagated from the noise of its sensors.

    Args:
        session: Recordings at their full rate, and their judged band.
        usable: Weight of each sample in the band, for each log.
        deviations: Half width of the interval in standard errors.
    """
    robot, readings = session.robot, _readings_of(session)
    encoders = _encoders_in_band(session, readings, usable)
    gain = _noise_gain(session)
    value, low, high, torque = np.full((4, robot.nv), np.nan)
    limit, rounding = np.zeros(robot.nv), _rounding_errors(session)
    densities = torque_densities(session, readings, deviations)
    rises = joints_with_rising_noise(densities)
    for j, density in enumerate(densities):
        if density is not None:
            torque[j] = np.sqrt(density.value * gain)
            value[j] = np.hypot(torque[j], encoders[j])
            low[j] = np.hypot(np.sqrt(density.low / _DENSITY_UNCERTAINTY * gain), encoders[j])
            high[j] = np.hypot(np.sqrt(density.high * _DENSITY_UNCERTAINTY * gain), encoders[j])
            if rises[j]:
                limit[j] = np.hypot(np.sqrt(density.limit_if_rising * _DENSITY_UNCERTAINTY * gain), encoders[j])
            high[j] = max(high[j], np.hypot(rounding[j], encoders[j]))
    return SensorFloor(value, low, high, torque, encoders, limit)


def _rounding_errors(session: Session) -> Float[Array, " nv"]:
    """Root mean square rounding error of each joint's torque readings; zero unless their steps are coarse."""
    out = np.zeros(session.robot.nv)
    for recording in session.recordings:
        for j, torque in enumerate(() if recording.tau is None else recording.tau.T):
            if np.mean(np.diff(torque) == 0) > _REPEATED_SHARE:
                out[j] = max(out[j], (reading_step(torque, None) or 0.0) / np.sqrt(12.0))
    return out


def _readings_of(session: Session) -> Readings:
    """Noise of each joint's position readings in each log; None where it is unknown."""
    return tuple(tuple(reading_noise(log, j) for j in range(session.robot.nv)) for log in session.logs)


def torque_densities(session: Session, readings: Readings, deviations: float = 2.0) -> list[Density | None]:
    """Density of each joint's torque noise, from torque readings or measured minus modelled torque; None if unknown.

    Args:
        session: Recordings at their full rate, and their judged band.
        readings: Noise of each joint's readings in each log, from `reading_noise`.
        deviations: Half width of a density's interval in standard errors.
    """
    robot, logs = session.robot, session.logs
    bands = [balance_bands(robot, log, session.cutoff_hz, own) for log, own in zip(logs, readings, strict=True)]
    seconds = [len(log.motion.t) / log.band.rate_hz for log in logs]
    out: list[Density | None] = []
    for j in range(robot.nv):
        each = [
            _balance_density(own[j], session.cutoff_hz, long, deviations)
            for own, long in zip(bands, seconds, strict=True)
        ]
        balance = _mean_density(each, seconds)
        # A commanded torque has no reading noise. Above the band of the motion it is the response of the controller.
        by_sensor = None if robot.torque_source == "command" else torque_noise(logs, j, held=robot.torque_hold == "zoh")
        out.append(_smaller_density(by_sensor, balance))
    return out


def joints_with_rising_noise(densities: list[Density | None]) -> list[bool]:
    """True for joints whose noise is not white, but rises towards the band of the motion.

    The drives of a robot are alike. So if the noise of most joints rises, that of every joint is assumed to rise.
    """
    rises = [density.rises for density in densities if density is not None]
    most_rise = 2 * sum(rises) > len(rises)
    return [density is not None and (density.rises or most_rise) for density in densities]


def _balance_density(bands: list[SubBand], judged_hz: float, seconds: float, deviations: float) -> Density | None:
    """Noise of measured minus modelled torque in a recording, and whether it rises towards the motion."""
    density = balance_noise(bands, deviations)
    if density is None:
        return None
    rises, limit = rising_density(bands, judged_hz, 1.0 / seconds, deviations)
    return replace(density, rises=rises, limit_if_rising=limit)


def _smaller_density(of_readings: Density | None, balance: Density | None) -> Density | None:
    """The smaller of two estimates, each of which may be too large; None if both are unknown.

    Jumps of friction increase the density of the readings, errors of the model increase that of the balance. If encoder
    noise dominates in the balance, the result is the density of the readings, but at most the upper end for the
    balance.

    Args:
        of_readings: Density of the torque readings.
        balance: Density of measured minus modelled torque.
    """
    if of_readings is not None and balance is not None and balance.only_high_known:
        return Density(min(of_readings.value, balance.high), balance.low, balance.high)
    if of_readings is None or balance is None:
        return of_readings or balance
    smaller = min(of_readings, balance, key=lambda one: one.value)
    return replace(smaller, rises=balance.rises, limit_if_rising=balance.limit_if_rising)


def _mean_density(each: list[Density | None], weights: list[float]) -> Density | None:
    """Weighted mean density over the recordings with a known density; None if there is no such recording."""
    known = [(one, weight) for one, weight in zip(each, weights, strict=True) if one is not None]
    if not known:
        return None
    values = [(one.value, one.low, one.high, one.limit_if_rising) for one, _ in known]
    value, low, high, limit = np.average(values, axis=0, weights=[weight for _, weight in known]).tolist()
    only_high_known, rises = all(one.only_high_known for one, _ in known), any(one.rises for one, _ in known)
    return Density(value, low, high, only_high_known, rises, limit)


def _encoders_in_band(
    session: Session, readings: Readings, usable: tuple[Float[Array, "n nv"], ...]
) -> Float[Array, " nv"]:
    """Rms spurious torque of each joint in the judged band from errors of the position readings, ``(nv,)``."""
    squares, counts = np.zeros(session.robot.nv), np.zeros(session.robot.nv)
    rng = random_stream("motions that are read once more")
    for k, (log, own) in enumerate(zip(session.logs, readings, strict=True)):
        for _ in range(_DRAWS):
            error = log.band(reading_error_torque(session.robot, log, own, rng))
            squares += np.sum(usable[k] * session.log_in_judged_band(error, k) ** 2, axis=0)
            counts += np.sum(usable[k], axis=0)
    return np.sqrt(squares / np.maximum(counts, 1e-12))


def reading_error_torque(
    robot: Robot, log: Log, readings: tuple[ReadingNoise | None, ...], rng: np.random.Generator
) -> Float[Array, "N nv"]:
    """Spurious torque from one draw of reading errors: modelled torque with the errors minus that without them.

    Args:
        robot: The given model.
        log: A recording at its full rate.
        readings: Noise of each joint's readings.
        rng: Draws the errors of the readings.
    """
    error = reading_errors(log, readings, rng)
    q, v, a = differentiate(log.motion.q + error, log.band.rate_hz, position_edges(log))
    noisy = log.motion.with_joints(q, v, a)
    if log.motion.base is not None:
        noisy = replace(noisy, base=with_redrawn_noise(log, rng, motion_edge(log.band)))
    with_errors, smooth = (
        inverse_dynamics(robot, motion) - modelled_friction(robot, motion) for motion in (noisy, log.motion)
    )
    return with_errors - smooth


def _noise_gain(session: Session) -> float:
    """Mean square [Hz] in the judged band of white noise of density one, simulated with the filters of the logs."""
    squares = []
    for k, log in enumerate(session.logs):
        white = random_stream("white noise of density one").normal(size=(len(log.motion.t), 8))
        # White noise of unit variance has the density 2 / rate.
        noise = white * np.sqrt(0.5 * log.band.rate_hz)
        squares.append(np.mean(session.log_in_judged_band(log.band(noise), k) ** 2))
    return float(np.mean(squares))


def sensed_noise(session: Session, columns: Columns, unpredicted: Series) -> Series:
    """One draw of the sensors' noise in each log's torque, ``(n, nv)``; zero where a sample is not usable.

    It is the sum of white noise of the torque and spurious torque from errors of the position readings. Both are zero
    for a joint whose recording does not show the noise of its torque. Errors of the model that were found in another
    recording are added, so that they are not reported again as a new cause.

    The density of the white noise is measured above the judged band. If a controller responds to the noise of its
    encoder, the torque is much noisier there than in the band. So the white noise is limited to the size of the
    unpredicted residual in the judged band.

    Args:
        session: Recordings at their full rate, and their judged band.
        columns: Columns with the usable samples.
        unpredicted: Part of each joint's residual that no model predicts on held-out blocks in the judged band.
    """
    robot, rng = session.robot, random_stream("noise of the sensors")
    readings = _readings_of(session)
    densities = torque_densities(session, readings)
    density = np.array([0.0 if one is None else one.value for one in densities])
    known = np.array([one is not None for one in densities])
    white, encoders = [], []
    for log, own, use in zip(session.logs, readings, columns.usable, strict=True):
        drawn = rng.normal(size=log.tau.shape) * np.sqrt(0.5 * log.band.rate_hz * density)
        white.append(np.where(use & known, log.band(drawn), 0.0))
        encoders.append(np.where(use & known, log.band(reading_error_torque(robot, log, own, rng)), 0.0))
    share = _share_in_band(session, columns, tuple(white), unpredicted)
    return tuple(
        share * white[k] + encoders[k] + np.where(use, _model_error_noise(session, k), 0.0)
        for k, use in enumerate(columns.usable)
    )


def _share_in_band(session: Session, columns: Columns, white: Series, unpredicted: Series) -> Float[Array, " nv"]:
    """Factor, at most one, that limits each joint's white noise in the judged band to the unpredicted residual."""
    weights = [root_weights(columns, [part[:, j] for part in unpredicted], j) for j in range(white[0].shape[1])]
    squares = []
    for series in (white, unpredicted):
        narrow, size = session.in_judged_band(series), np.zeros(len(weights))
        for k, use in enumerate(columns.usable):
            weighed = narrow[k] * np.column_stack([own[k] for own in weights])
            size += np.sum(np.where(use, weighed, 0.0) ** 2, axis=0)
        squares.append(size)
    return np.sqrt(np.minimum(squares[1] / np.maximum(squares[0], 1e-300), 1.0))


def _model_error_noise(session: Session, log: int) -> Float[Array, "n nv"]:
    """A random torque in the judged band with the standard deviation of the model error from an earlier diagnosis."""
    error, own = earlier_model_error(session, log), session.logs[log]
    if not error.any():
        return np.zeros((len(own.samples), error.shape[1]))
    white = random_stream("errors of the model").normal(size=error.shape)
    narrow = session.log_in_judged_band(own.band(white), log)
    return error[own.samples] * narrow / np.maximum(narrow.std(axis=0), 1e-300)
