"""Noise floor of each joint in the judged band: its interval, and where it was read from.

The floor is what the sensors make, where a recording shows their noise. For other joints it is what flexible predictors
do not predict, with the source ``none``. That is an upper limit only: what predictors miss contains the effect that is
looked for, so no joint is called free of a gap by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.data.log import Band
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Series, Session
from identification.diagnosis.fit.gap import judged_blocks, least_noise, measured_torque, residual_sums, sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.noise.discrepancy import discrepancy, drive_noise
from identification.diagnosis.noise.repetitions import repeated_noise
from identification.diagnosis.noise.sensor_floor import SensorFloor, sensor_floor
from identification.diagnosis.noise.sensor_noise import Density, torque_noise
from identification.engine import contract_levels
from identification.engine.resampling import block_counts
from identification.gates import fair_part
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

ABOVE_BAND, REPETITIONS, PREDICTORS = "above_band", "repetitions", "predictors"
SENSORS, NONE = "sensors", "none"


@dataclass(frozen=True)
class Floor:
    """Noise floor of each joint.

    Attributes:
        value: Noise, root mean square, ``(nv,)``.
        low, high: Interval at 95 % over all joints together, ``(nv,)``.
        source: Where the floor of each joint was read from: ``repetitions`` where the motion is repeated. For other
            joints, `floor_by_predictors` writes ``above_band`` if the noise above the judged band agrees with the
            unpredicted residual inside it, else ``predictors``, an upper limit. `floor_by_sensors` replaces these two
            by ``sensors`` if the sensors show their noise, else by ``none``.
        discrepancy: Error of a sound model on each joint, ``(nv,)``; None before `floor_by_sensors`.
        in_doubt: Residual by which ``high`` was raised because friction is uncertain, root mean square, ``(nv,)``;
            None: it was not raised.
    """

    value: Float[Array, " nv"]
    low: Float[Array, " nv"]
    high: Float[Array, " nv"]
    source: tuple[str, ...]
    discrepancy: Float[Array, " nv"] | None = None
    in_doubt: Float[Array, " nv"] | None = None

    @property
    def predictable(self) -> Float[Array, " nv"] | None:
        """The largest residual that a flexible model may predict on a sound joint, ``(nv,)``; None: not known."""
        if self.discrepancy is None or self.in_doubt is None:
            return self.discrepancy
        return np.hypot(self.discrepancy, self.in_doubt)

    @property
    def allowed(self) -> Float[Array, " nv"]:
        """The largest residual of each joint that may still be noise and discrepancy, ``(nv,)``."""
        return self.high if self.discrepancy is None else np.hypot(self.high, self.discrepancy)

    def without(self, squares: Float[Array, " nv"]) -> Floor:
        """The floor less the rounding of coarse encoders, but no less than `COARSE_REMAINDER` times itself.

        Args:
            squares: Mean square of the torque that the rounding makes, ``(nv,)``.
        """
        if not np.any(squares):
            return self
        kept = np.sqrt(np.maximum(1.0 - squares / self.value**2, rules.COARSE_REMAINDER**2))
        return replace(self, value=self.value * kept, low=self.low * kept, high=self.high * kept)

    def raised_by(self, squares: Float[Array, " nv"]) -> Floor:
        """The floor with a mean square added to its upper end."""
        return replace(self, high=np.sqrt(self.high**2 + squares))


def floor_by_predictors(
    problem: Problem,
    noise: Series,
    residual: Series,
    doubt: Series,
    encoders: Float[Array, " nv"] | None = None,
) -> Floor:
    """Noise floor of each joint in the judged band.

    The value is the residual of flexible predictors on held-out blocks, with an interval by block bootstrap: an upper
    limit, as it contains events that nothing predicts. It is then corrected, in this order:

    1. White noise of the torque readings above the band is extrapolated into the band. If it is smaller than the value,
       the lower end is at most this noise. If it is smaller by more than `SENSOR_TIMES`, it replaces the value. If it
       agrees with the value, or has replaced it, the source is ``above_band``.
    2. Without agreement in step 1: if the residual is by more than `SENSOR_TIMES` larger than its usual size (from the
       median of its squares), as with impacts of play, the usual size replaces the value.
    3. Steps 1 and 2 replace nothing where torque that is read at instants is so large above the band in motion that,
       aliased into the band, it may be the value.
    4. If the motion is repeated and the difference of the repetitions is smaller than the value, that difference
       replaces it.
    5. The residual where friction is uncertain is added to the upper end, up to that uncertainty: flexible predictors
       learn how one robot sticks and creeps, a model does not.

    The value is replaced only if the residual of the explanation is larger by as much, too.

    Args:
        problem: Recordings, blocks and columns.
        noise: Residual of flexible predictors of each log's torque.
        residual: Residual of the explanation of each log's torque, in the judged band.
        doubt: Variance of the friction torque of joints that stand still, creep or reverse.
        encoders: Torque that the noise of the encoders makes in the judged band, ``(nv,)``; None: not known.
    """
    from scipy.special import ndtri

    session, robot = problem.session, problem.session.robot
    unpredicted = residual_sums(problem, session.in_judged_band(noise))
    value = np.maximum(unpredicted.rms(), least_noise(problem.columns))
    draws = block_counts(len(unpredicted.counts), random_stream("bootstrap of the noise floor"))
    mean = (draws @ unpredicted.squares) / np.maximum(draws @ unpredicted.counts, 1e-12)
    relative = np.sqrt(mean) / np.maximum(unpredicted.rms(), 1e-300)
    wrong = 100.0 * rules.FLOOR_ERROR / len(value)
    low, high = (value * np.percentile(relative, side, axis=0) for side in (wrong / 2, 100.0 - wrong / 2))
    low, high = np.minimum(low, value), np.maximum(high, value)
    encoder_noise = np.zeros(robot.nv) if encoders is None else encoders
    torque = residual_sums(problem, measured_torque(problem)).rms()
    unexplained = residual_sums(problem, residual).rms()
    sensors, source = reading_noise(session), []
    aliased = _aliased_torque(problem, sensors)
    for j, seen in enumerate(sensors):
        if seen is None:
            source.append(PREDICTORS)
            continue
        least, most = (np.sqrt(x * session.cutoff_hz + encoder_noise[j] ** 2) for x in (seen.low, seen.high))
        plausible = np.hypot(np.hypot(most, aliased[j]), np.sqrt(fair_part.ACCURACY) * torque[j])
        if min(low[j], unexplained[j]) > rules.SENSOR_TIMES * plausible:
            # Sensor noise in the band is not several times that above it: the rest is an unpredicted gap.
            value[j] = np.sqrt(seen.value * session.cutoff_hz + encoder_noise[j] ** 2)
            low[j], high[j] = least, most
        source.append(ABOVE_BAND if least <= high[j] and most >= low[j] else PREDICTORS)
        low[j] = min(low[j], least)
    # Sensor noise is not several times larger at some times than usual: the rest is an unpredicted gap, too.
    usual = np.sqrt(_usual_size(problem, noise) ** 2 + encoder_noise**2 + fair_part.ACCURACY * torque**2)
    has_events = np.minimum(low, unexplained) > rules.SENSOR_TIMES * np.hypot(usual, aliased)
    factor = np.where((np.array(source) == PREDICTORS) & has_events, usual / value, 1.0)
    value, low, high = value * factor, low * factor, high * factor
    moving = zip(problem.columns.usable, problem.columns.standstill_std, strict=True)
    free = tuple(use & (held == 0.0) for use, held in moving)
    counts = tuple(sample_weights(problem, k) for k in range(len(residual)))
    for j, seen in enumerate(repeated_noise(session, residual, free, counts)):
        if seen is None:
            continue
        reach = float(np.exp(ndtri(1.0 - wrong / 200.0) * seen.error))
        least, most = seen.value / reach, seen.value * reach
        if min(low[j], unexplained[j]) > np.hypot(most, np.sqrt(fair_part.ACCURACY) * torque[j]):
            value[j], low[j], high[j] = seen.value, least, most
        if least <= high[j]:
            # Otherwise something drifts between the repetitions, which predictors, an upper limit, can predict.
            low[j], source[j] = min(low[j], least), REPETITIONS
    # Derivatives and filters have errors, however quiet the sensors are.
    high = np.hypot(high, rules.MODEL_SHARE * torque)
    wide = np.maximum(high / value, contract_levels.FLOORS_LEFT)
    uncertain = uncertain_squares(problem, session.in_judged_band(noise), residual, doubt, value, wide)
    return Floor(value, low, np.sqrt(high**2 + uncertain), tuple(source), in_doubt=np.sqrt(uncertain))


def _usual_size(problem: Problem, noise: Series) -> Float[Array, " nv"]:
    """Size of each joint's noise in the judged band at most times, by the median of its squares.

    For stationary normal noise it is the root mean square.
    """
    from scipy.special import chdtri

    usable, out = np.concatenate(problem.columns.usable), []
    for series, use in zip(np.concatenate(problem.session.in_judged_band(noise)).T, usable.T, strict=True):
        out.append(np.sqrt(np.median(series[use] ** 2) / chdtri(1, 0.5)) if use.any() else 0.0)
    return np.array(out)


def torque_above_band(problem: Problem, sensors: list[Density | None]) -> Float[Array, " nv"]:
    """Mean square of each joint's torque above the filter's band in motion, less the noise of its sensors, ``(nv,)``.

    A controller answers the steps of its encoder at its own rate, and only in motion. In a log with a lower rate that
    reads torque at instants, this torque is aliased to any frequency, and has no effect on the motion. A torque that is
    held between readings is read as often as it changes: all of it acts, and nothing is aliased.

    Args:
        problem: Recordings and which samples are usable.
        sensors: White noise of the torque readings of each joint, see `reading_noise`.
    """
    session = problem.session
    squares, counts = np.zeros((2, session.robot.nv))
    if session.robot.torque_hold == "zoh":
        return squares
    white = np.array([0.0 if seen is None else seen.value for seen in sensors])
    for log, use in zip(session.logs, problem.columns.usable, strict=True):
        above = log.tau[log.samples] - log.band(log.tau)
        squares += np.sum(np.where(use, above**2 - white * _width_above_band(log.band), 0.0), axis=0)
        counts += use.sum(axis=0)
    return np.maximum(squares / np.maximum(counts, 1), 0.0)


def _aliased_torque(problem: Problem, sensors: list[Density | None]) -> Float[Array, " nv"]:
    """Root mean square in the judged band of `torque_above_band`, if aliasing spreads it over all frequencies."""
    width = float(np.mean([_width_above_band(log.band) for log in problem.session.logs]))
    return np.sqrt(torque_above_band(problem, sensors) * problem.session.cutoff_hz / width)


def _width_above_band(band: Band) -> float:
    """Frequencies [Hz] above a filter's band, at least as many as in it."""
    return max(0.5 * band.rate_hz - band.cutoff_hz, band.cutoff_hz)


def uncertain_squares(
    problem: Problem,
    noise: Series,
    residual: Series,
    doubt: Series,
    floor: Float[Array, " nv"],
    wide: Float[Array, " nv"],
) -> Float[Array, " nv"]:
    """Mean square of the residual where friction is uncertain by more than the floor, ``(nv,)``.

    The residual counts up to two standard deviations of the friction. Samples have the weights of the figures of a gap.
    It is zero on a joint whose residual is above ``wide`` times the noise even where friction is certain: then friction
    is not the cause.

    Args:
        problem: Recordings, blocks and columns.
        noise: Residual of flexible predictors of each log's torque, in the judged band.
        residual: Residual of the explanation of each log's torque, in the judged band.
        doubt: Variance of the friction torque of joints that stand still, creep or reverse.
        floor: Noise floor of each joint.
        wide: Upper end of each joint's floor over the floor, at least `FLOORS_LEFT`, ``(nv,)``.
    """
    out = np.zeros(len(floor))
    weights = tuple(sample_weights(problem, k) for k in range(len(residual)))
    for j in range(len(floor)):
        use = np.concatenate([use[:, j] for use in problem.columns.usable])
        left, own, variance, weight = (
            np.concatenate([part[:, j] for part in series])[use] for series in (residual, noise, doubt, weights)
        )
        sure = variance <= floor[j] ** 2
        enough = np.count_nonzero(sure) >= max(rules.SURE_SHARE * len(sure), 1.0)
        if enough and np.mean(left[sure] ** 2) > wide[j] ** 2 * max(np.mean(own[sure] ** 2), floor[j] ** 2):
            continue
        uncertain = weight[~sure] @ np.minimum(left[~sure] ** 2, 4.0 * variance[~sure])
        out[j] = uncertain / max(weight.sum(), 1e-300)
    return out


def reading_noise(session: Session) -> list[Density | None]:
    """White noise of each joint's torque readings above the band; None for all joints if fewer than half have it.

    A drive or a recorder smooths all joints alike: if the noise of most is not white, that of one is by chance.
    """
    robot = session.robot
    shown = [torque_noise(session.logs, j, held=robot.torque_hold == "zoh") for j in range(robot.nv)]
    count = sum(density is not None for density in shown)
    return shown if 2 * count >= robot.nv else [None] * robot.nv


@dataclass(frozen=True)
class SensorFloors:
    """Noise of the sensors and error of a sound model, which do not depend on any effect.

    Attributes:
        floor: Noise of the sensors on each joint in the judged band.
        discrepancy: Error of a sound model on each joint, root mean square, ``(nv,)``.
        torque: Measured torque of each joint in the judged band, root mean square, ``(nv,)``.
    """

    floor: SensorFloor
    discrepancy: Float[Array, " nv"]
    torque: Float[Array, " nv"]


def sensor_floors(problem: Problem) -> SensorFloors:
    """Noise of the sensors in the judged band, and the discrepancy of drives of this class.

    Args:
        problem: Recordings, blocks and columns.
    """
    from scipy.special import ndtri

    torque, usable = residual_sums(problem, measured_torque(problem)).rms(), judged_weights(problem)
    deviations = float(ndtri(1.0 - 0.5 * rules.FLOOR_ERROR / len(torque)))
    session = problem.session
    return SensorFloors(sensor_floor(session, usable, deviations), discrepancy(session, usable, torque), torque)


def floor_by_sensors(
    floor: Floor, sensed: SensorFloors, problem: Problem, noise: Series, residual: Series, doubt: Series
) -> Floor:
    """The floor of each joint by its sensors, with the discrepancy that a sound model is allowed.

    Floors by repetitions are kept. So are those by predictors, as upper limits, where they are more than a sound joint
    with white noise leaves, but its noise is not white and may be as large. Where the residual of predictors is
    smaller than the noise of the sensors, it is the noise. The residual where friction is uncertain, and errors of
    derivatives and filters, are added to the upper end.

    Args:
        floor: By repetitions and predictors.
        sensed: Noise of the sensors.
        problem: Recordings, blocks and columns.
        noise: Residual of flexible predictors of each log's torque.
        residual: Residual of the explanation of each log's torque, in the judged band.
        doubt: Variance of the friction torque of joints that stand still, creep or reverse.
    """
    own_floor = sensed.floor
    repeated = np.array([source == REPETITIONS for source in floor.source])
    known = own_floor.known & ~repeated
    taken = known & (own_floor.value < floor.value)
    # Where both agree, that of predictors is more accurate: noise of encoders may hide that of the torque.
    agree = (floor.value >= own_floor.low) & (floor.value <= own_floor.high)
    value, low, high = (
        np.where(use, own, given)
        for use, own, given in (
            (taken & ~agree, own_floor.value, floor.value),
            (taken, own_floor.low, floor.low),
            (taken, own_floor.high, floor.high),
        )
    )
    high = np.where(taken, np.hypot(high, rules.MODEL_SHARE * sensed.torque), high)
    wide = np.maximum(high / value, contract_levels.FLOORS_LEFT)
    uncertain = uncertain_squares(problem, problem.session.in_judged_band(noise), residual, doubt, value, wide)
    high = np.where(taken, np.sqrt(high**2 + uncertain), high)
    of_drive = drive_noise(problem.session.robot, sensed.torque)
    beyond = floor.value > np.hypot(np.maximum(high, of_drive), sensed.discrepancy)
    coloured = taken & beyond & (floor.value <= own_floor.rising)
    known, taken = known & ~coloured, taken & ~coloured
    value, low, high = (
        np.where(coloured, given, own) for own, given in ((value, floor.value), (low, floor.low), (high, floor.high))
    )
    source = tuple(
        REPETITIONS if again else SENSORS if own else NONE for again, own in zip(repeated, known, strict=True)
    )
    in_doubt = np.where(taken, np.sqrt(uncertain), 0.0 if floor.in_doubt is None else floor.in_doubt)
    return replace(
        floor, value=value, low=low, high=high, source=source, discrepancy=sensed.discrepancy, in_doubt=in_doubt
    )


def judged_weights(problem: Problem) -> tuple[Float[Array, "n nv"], ...]:
    """Weight of each sample of each log in the figures of a gap; zero outside the cores of the held-out blocks."""
    out = tuple(np.zeros(use.shape) for use in problem.columns.usable)
    for k in judged_blocks(problem):
        block = problem.blocks[k]
        part = slice(block.core, block.stop)
        out[block.log][part] = sample_weights(problem, block.log, part)
    return out
