"""Noise floor of each joint in the judged band, with its interval and its source.

If a recording shows the noise of the sensors, the floor is the torque that this noise makes. Otherwise its source is
``none``, and it is the part of the torque that flexible predictors cannot predict from the state. That is an upper
limit of the noise, because predictors also miss a part of the effects that are searched for. So such a joint is never
called free of a gap.
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
from identification.diagnosis.noise.repetitions import repetition_noise
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
        low, high: Interval with 95 % confidence for all joints together, ``(nv,)``.
        source: Source of each joint's floor: ``repetitions`` if the motion is repeated. For other joints,
            `floor_by_predictors` sets ``above_band`` if the noise above the judged band agrees with the unpredicted
            torque inside the band, else ``predictors``, an upper limit. `floor_by_sensors` replaces these two by
            ``sensors`` if the recording shows the noise of the sensors, else by ``none``.
        discrepancy: Error of a sound model on each joint, root mean square, ``(nv,)``; None before `floor_by_sensors`.
        uncertain_friction: Residual where friction is uncertain, root mean square, ``(nv,)``; ``high`` includes it.
            None counts as zero.
    """

    value: Float[Array, " nv"]
    low: Float[Array, " nv"]
    high: Float[Array, " nv"]
    source: tuple[str, ...]
    discrepancy: Float[Array, " nv"] | None = None
    uncertain_friction: Float[Array, " nv"] | None = None

    @property
    def predictable(self) -> Float[Array, " nv"] | None:
        """Largest predictable part of each joint's residual with a sound model, ``(nv,)``; None: not known."""
        if self.discrepancy is None or self.uncertain_friction is None:
            return self.discrepancy
        return np.hypot(self.discrepancy, self.uncertain_friction)

    @property
    def allowed(self) -> Float[Array, " nv"]:
        """Largest residual of each joint with a sound model, noise included, ``(nv,)``."""
        return self.high if self.discrepancy is None else np.hypot(self.high, self.discrepancy)

    def without(self, squares: Float[Array, " nv"]) -> Floor:
        """The floor without the rounding of coarse encoders, but at least `COARSE_REMAINDER` times the floor with it.

        Args:
            squares: Mean square of the torque that the rounding causes, ``(nv,)``.
        """
        if not np.any(squares):
            return self
        factor = np.sqrt(np.maximum(1.0 - squares / self.value**2, rules.COARSE_REMAINDER**2))
        return replace(self, value=self.value * factor, low=self.low * factor, high=self.high * factor)

    def raised_by(self, squares: Float[Array, " nv"]) -> Floor:
        """The floor with a mean square added to that of its upper end."""
        return replace(self, high=np.sqrt(self.high**2 + squares))


def floor_by_predictors(
    problem: Problem,
    noise: Series,
    residual: Series,
    friction_variance: Series,
    encoders: Float[Array, " nv"] | None = None,
) -> Floor:
    """Noise floor of each joint in the judged band, from the torque that flexible predictors do not predict.

    The first value is the residual of these predictors on held-out blocks, with an interval by block bootstrap. It
    contains events that nothing predicts, so it is an upper limit. It is corrected in this order:

    1. White noise of the torque readings above the band is extrapolated into the band. If the lower end of the interval
       is more than `SENSOR_TIMES` times the upper end of this noise, the noise replaces value and interval. If the two
       intervals overlap, or after a replacement, the source is ``above_band``. A lower end above that of this noise is
       lowered to it.
    2. For joints without the source ``above_band``: if the value is larger by more than `SENSOR_TIMES` than the usual
       size of the residual (from the median of its squares), as with impacts of play, the usual size replaces it.
    3. If the motion is repeated and the difference of the repetitions is smaller than the value, that difference
       replaces the value.
    4. The errors of derivatives and filters are added to the upper end of the interval.
    5. The residual where friction is uncertain, up to its uncertainty, is added to the upper end: flexible predictors
       learn how one robot sticks and creeps, but the laws of a model do not describe that.

    A value is replaced only if the residual of the model with the chosen effects is larger by as much, too. Steps 1 and
    2 also replace no value that may be aliased torque: torque that is read at instants and is large above the band in
    motion.

    Args:
        problem: Recordings, blocks and columns.
        noise: Residual of flexible predictors of each log's torque.
        residual: Residual of each log with the chosen effects in the model, in the judged band.
        friction_variance: Variance of the friction torque of joints that stand still, creep or reverse.
        encoders: Torque that the noise of the encoders causes in the judged band, ``(nv,)``; None: not known.
    """
    from scipy.special import ndtri

    session, robot = problem.session, problem.session.robot
    unpredicted = residual_sums(problem, session.in_judged_band(noise))
    value = np.maximum(unpredicted.rms(), least_noise(problem.columns))
    draws = block_counts(len(unpredicted.counts), random_stream("bootstrap of the noise floor"))
    mean = (draws @ unpredicted.squares) / np.maximum(draws @ unpredicted.counts, 1e-12)
    relative = np.sqrt(mean) / np.maximum(unpredicted.rms(), 1e-300)
    # Per cent of replicates outside the interval of one joint (Bonferroni over the joints).
    outside = 100.0 * rules.FLOOR_ERROR / len(value)
    low, high = (value * np.percentile(relative, side, axis=0) for side in (outside / 2, 100.0 - outside / 2))
    low, high = np.minimum(low, value), np.maximum(high, value)
    encoder_noise = np.zeros(robot.nv) if encoders is None else encoders
    torque = residual_sums(problem, measured_torque(problem)).rms()
    unexplained = residual_sums(problem, residual).rms()
    sensors, source = reading_noise(session), []
    aliased = _aliased_torque(problem, sensors)
    # Step 1: white noise above the band.
    for j, white in enumerate(sensors):
        if white is None:
            source.append(PREDICTORS)
            continue
        least, most = (
            np.sqrt(density * session.cutoff_hz + encoder_noise[j] ** 2) for density in (white.low, white.high)
        )
        plausible = np.hypot(np.hypot(most, aliased[j]), np.sqrt(fair_part.ACCURACY) * torque[j])
        if min(low[j], unexplained[j]) > rules.SENSOR_TIMES * plausible:
            # Sensor noise is not several times larger in the band than above it, so the rest is a gap.
            value[j] = np.sqrt(white.value * session.cutoff_hz + encoder_noise[j] ** 2)
            low[j], high[j] = least, most
        source.append(ABOVE_BAND if least <= high[j] and most >= low[j] else PREDICTORS)
        low[j] = min(low[j], least)
    # Step 2: sensor noise is not several times larger at some times than usual, so the rest is a gap.
    usual = np.sqrt(_usual_size(problem, noise) ** 2 + encoder_noise**2 + fair_part.ACCURACY * torque**2)
    has_events = np.minimum(low, unexplained) > rules.SENSOR_TIMES * np.hypot(usual, aliased)
    factor = np.where((np.array(source) == PREDICTORS) & has_events, usual / value, 1.0)
    value, low, high = value * factor, low * factor, high * factor
    # Step 3: repetitions, compared where static friction does not hold a joint.
    standstill = zip(problem.columns.usable, problem.columns.standstill_std, strict=True)
    free = tuple(use & (std == 0.0) for use, std in standstill)
    counts = tuple(sample_weights(problem, k) for k in range(len(residual)))
    for j, repetition in enumerate(repetition_noise(session, residual, free, counts)):
        if repetition is None:
            continue
        reach = float(np.exp(ndtri(1.0 - outside / 200.0) * repetition.error))
        least, most = repetition.value / reach, repetition.value * reach
        if min(low[j], unexplained[j]) > np.hypot(most, np.sqrt(fair_part.ACCURACY) * torque[j]):
            value[j], low[j], high[j] = repetition.value, least, most
        if least <= high[j]:
            # If not, the repetitions differ by more than the upper limit: something drifts between them, which is
            # predictable. Then they do not show the noise.
            low[j], source[j] = min(low[j], least), REPETITIONS
    # Step 4: derivatives and filters have errors, however small the noise of the sensors is.
    high = np.hypot(high, rules.MODEL_SHARE * torque)
    # Step 5: uncertain friction.
    high_ratio = np.maximum(high / value, contract_levels.FLOORS_LEFT)
    noise_in_band = session.in_judged_band(noise)
    uncertain = uncertain_squares(problem, noise_in_band, residual, friction_variance, value, high_ratio)
    return Floor(value, low, np.sqrt(high**2 + uncertain), tuple(source), uncertain_friction=np.sqrt(uncertain))


def _usual_size(problem: Problem, noise: Series) -> Float[Array, " nv"]:
    """Usual size of each joint's noise in the judged band, from the median of its squares, ``(nv,)``.

    For stationary normal noise the result is the root mean square. Rare large values have little influence.
    """
    from scipy.special import chdtri

    usable, out = np.concatenate(problem.columns.usable), []
    for series, use in zip(np.concatenate(problem.session.in_judged_band(noise)).T, usable.T, strict=True):
        out.append(np.sqrt(np.median(series[use] ** 2) / chdtri(1, 0.5)) if use.any() else 0.0)
    return np.array(out)


def torque_above_band(problem: Problem, sensors: list[Density | None]) -> Float[Array, " nv"]:
    """Mean square of each joint's torque above the filter's band in motion, without the noise of sensors, ``(nv,)``.

    In motion a controller responds to each step of its encoder, at its own rate. If the log has a lower rate and reads
    the torque at instants, this torque is aliased to any frequency, although it has no effect on the motion. If the
    torque is held between readings (``torque_hold`` is ``zoh``), each of its changes is in the log: nothing is aliased,
    and the result is zero.

    Args:
        problem: Recordings and usable samples.
        sensors: White noise of the torque readings of each joint (`reading_noise`).
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
    """Root mean square of `torque_above_band` in the judged band if aliasing spreads it over all frequencies."""
    width = float(np.mean([_width_above_band(log.band) for log in problem.session.logs]))
    return np.sqrt(torque_above_band(problem, sensors) * problem.session.cutoff_hz / width)


def _width_above_band(band: Band) -> float:
    """Width [Hz] of the frequencies between a filter's cutoff and half the rate; at least the cutoff."""
    return max(0.5 * band.rate_hz - band.cutoff_hz, band.cutoff_hz)


def uncertain_squares(
    problem: Problem,
    noise: Series,
    residual: Series,
    friction_variance: Series,
    floor: Float[Array, " nv"],
    high_ratio: Float[Array, " nv"],
) -> Float[Array, " nv"]:
    """Part of each joint's mean square residual from samples whose friction is uncertain by more than the floor.

    The residual of such a sample counts up to two standard deviations of its friction. The result is zero on a joint
    whose residual exceeds ``high_ratio`` times the noise where friction is certain: then uncertain friction is not the
    cause. Samples have the same weights as in the figures of a gap.

    Args:
        problem: Recordings, blocks and columns.
        noise: Residual of flexible predictors of each log's torque, in the judged band.
        residual: Residual of each log with the chosen effects in the model, in the judged band.
        friction_variance: Variance of the friction torque of joints that stand still, creep or reverse.
        floor: Noise floor of each joint, ``(nv,)``.
        high_ratio: Upper end of each joint's floor divided by the floor, at least `FLOORS_LEFT`, ``(nv,)``.
    """
    out = np.zeros(len(floor))
    weights = tuple(sample_weights(problem, k) for k in range(len(residual)))
    for j in range(len(floor)):
        use = np.concatenate([use[:, j] for use in problem.columns.usable])
        error, noise_of_joint, variance, weight = (
            np.concatenate([part[:, j] for part in series])[use]
            for series in (residual, noise, friction_variance, weights)
        )
        certain = variance <= floor[j] ** 2
        enough = np.count_nonzero(certain) >= max(rules.SURE_SHARE * len(certain), 1.0)
        if enough:
            noise_square = max(np.mean(noise_of_joint[certain] ** 2), floor[j] ** 2)
            if np.mean(error[certain] ** 2) > high_ratio[j] ** 2 * noise_square:
                continue
        uncertain = weight[~certain] @ np.minimum(error[~certain] ** 2, 4.0 * variance[~certain])
        out[j] = uncertain / max(weight.sum(), 1e-300)
    return out


def reading_noise(session: Session) -> list[Density | None]:
    """White noise of each joint's torque readings above the band; None for a joint without such noise.

    If fewer than half of the joints have it, the result is None for all: a drive or a recorder smooths the torque of
    all joints alike, so the noise of the few is white by chance.
    """
    robot = session.robot
    shown = [torque_noise(session.logs, j, held=robot.torque_hold == "zoh") for j in range(robot.nv)]
    count = sum(density is not None for density in shown)
    return shown if 2 * count >= robot.nv else [None] * robot.nv


@dataclass(frozen=True)
class SensorFloors:
    """Noise of the sensors and error of a sound model; neither depends on the chosen effects.

    Attributes:
        floor: Noise of the sensors on each joint in the judged band.
        discrepancy: Error of a sound model on each joint, root mean square, ``(nv,)``.
        torque: Measured torque of each joint in the judged band, root mean square, ``(nv,)``.
    """

    floor: SensorFloor
    discrepancy: Float[Array, " nv"]
    torque: Float[Array, " nv"]


def sensor_floors(problem: Problem) -> SensorFloors:
    """Noise of the sensors in the judged band, and the error of a sound model with drives of this kind.

    Args:
        problem: Recordings, blocks and columns.
    """
    from scipy.special import ndtri

    torque, usable = residual_sums(problem, measured_torque(problem)).rms(), judged_weights(problem)
    deviations = float(ndtri(1.0 - 0.5 * rules.FLOOR_ERROR / len(torque)))
    session = problem.session
    return SensorFloors(sensor_floor(session, usable, deviations), discrepancy(session, usable, torque), torque)


def floor_by_sensors(
    floor: Floor, of_sensors: SensorFloors, problem: Problem, noise: Series, residual: Series, friction_variance: Series
) -> Floor:
    """The floor of each joint from the noise of its sensors, with the error of a sound model (discrepancy).

    The given floor remains in three cases: if it comes from repetitions; if the sensors do not show their noise; and if
    it is smaller than the noise of the sensors. It also remains, as an upper limit, if white noise and the error of a
    sound model do not explain it, but noise that rises towards the motion may.

    Errors of derivatives and filters, and the residual where friction is uncertain, are added to the upper end.

    Args:
        floor: Floor from repetitions and predictors.
        of_sensors: Noise of the sensors.
        problem: Recordings, blocks and columns.
        noise: Residual of flexible predictors of each log's torque.
        residual: Residual of each log with the chosen effects in the model, in the judged band.
        friction_variance: Variance of the friction torque of joints that stand still, creep or reverse.
    """
    by_sensors = of_sensors.floor
    repeated = np.array([source == REPETITIONS for source in floor.source])
    known = by_sensors.known & ~repeated
    taken = known & (by_sensors.value < floor.value)
    # If both floors agree, that of the predictors is more accurate: noise of encoders may conceal that of the torque.
    agree = (floor.value >= by_sensors.low) & (floor.value <= by_sensors.high)
    value = np.where(taken & ~agree, by_sensors.value, floor.value)
    low = np.where(taken, by_sensors.low, floor.low)
    high = np.where(taken, by_sensors.high, floor.high)
    high = np.where(taken, np.hypot(high, rules.MODEL_SHARE * of_sensors.torque), high)
    high_ratio = np.maximum(high / value, contract_levels.FLOORS_LEFT)
    noise_in_band = problem.session.in_judged_band(noise)
    uncertain = uncertain_squares(problem, noise_in_band, residual, friction_variance, value, high_ratio)
    high = np.where(taken, np.sqrt(high**2 + uncertain), high)
    # Joints with noise that is not white: the floor of the predictors is too large for a sound joint with white noise,
    # but possible with noise whose density rises towards the motion.
    of_drive = drive_noise(problem.session.robot, of_sensors.torque)
    beyond = floor.value > np.hypot(np.maximum(high, of_drive), of_sensors.discrepancy)
    coloured = taken & beyond & (floor.value <= by_sensors.limit_if_rising)
    known, taken = known & ~coloured, taken & ~coloured
    value = np.where(coloured, floor.value, value)
    low = np.where(coloured, floor.low, low)
    high = np.where(coloured, floor.high, high)
    source = tuple(np.where(repeated, REPETITIONS, np.where(known, SENSORS, NONE)).tolist())
    previous = 0.0 if floor.uncertain_friction is None else floor.uncertain_friction
    return Floor(value, low, high, source, of_sensors.discrepancy, np.where(taken, np.sqrt(uncertain), previous))


def judged_weights(problem: Problem) -> tuple[Float[Array, "n nv"], ...]:
    """Weight of each sample of each log in the figures of a gap; zero outside the cores of the judged blocks."""
    out = tuple(np.zeros(use.shape) for use in problem.columns.usable)
    for k in judged_blocks(problem):
        block = problem.blocks[k]
        part = slice(block.core, block.stop)
        out[block.log][part] = sample_weights(problem, block.log, part)
    return out
