"""Estimates the white noise of measured minus modelled torque (the balance), above the band of the motion.

The band of the motion contains the frequencies at which the robot moves noticeably; the frequencies above it are
divided into sub-bands. The noise of the balance has two sources: noise of the torque readings, and torque ripple of a
drive that does not follow its command exactly. Above the band of the motion, jumps of friction, backlash and contacts
add power too, but only for short times. So the power is estimated by the median over the time in which the joint
travels. The contribution of encoder noise is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage

from identification.data.derivatives import differentiate
from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.motion.standstill import standing_still
from identification.diagnosis.noise.reading_noise import ReadingNoise
from identification.diagnosis.noise.sensor_noise import ABOVE_MOTION, Density
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.model.robot import Robot
from phantom_dyn.random_streams import random_stream

# Highest frequency used, as a share of the sample rate. Above it, derivatives of a spline lose more than 2 %.
_HIGHEST_FREQUENCY = 0.2
# Ratio of the two ends of a sub-band. The filter of an octave rings for one period, that of a narrower band for longer.
_SUB_BAND_RATIO = 2.0
# Time before and after a stop or a reversal in which friction adds power, in periods of a sub-band's lowest frequency.
_PERIODS_BESIDE_STOPS = 1.0
# Smallest number of independent values in a sub-band. With fewer, its power is uncertain by more than a third.
_FEWEST_VALUES = 40.0
# From this share of a sub-band's power on, encoder noise dominates: the torque noise, a difference, is too uncertain.
_DOMINANT_SHARE = 0.5
_MEDIAN_EFFICIENCY = 0.37  # efficiency of the median of squares relative to their mean
# Uncertainty of the computed encoder noise, as a share of the power of a sub-band in which encoder noise dominates. If
# the remaining power is smaller, there may be no torque noise at all.
_ENCODER_UNCERTAINTY = 0.3
# If encoder noise dominates in all sub-bands, the torque noise is assumed to have this share of its largest possible
# power, which is a quarter of its largest possible amplitude.
_ASSUMED_SHARE = 1.0 / 16.0
# Largest slope of a density that falls with frequency, as a power of frequency: the slope behind a first-order lag.
_STEEPEST_SLOPE = 2.0
# At most this many sub-bands, those with the least power, are averaged. Motion and effects add power to the others.
_AVERAGED_SUB_BANDS = 2


@dataclass(frozen=True)
class SubBand:
    """Power density of a joint's measured minus modelled torque between two frequencies above the motion.

    Attributes:
        centre: Centre frequency [Hz].
        balance: Density of measured minus modelled torque [(N m)^2/Hz].
        encoders: Part of it that the noise of the position readings causes [(N m)^2/Hz].
        count: Number of independent values.
    """

    centre: float
    balance: float
    encoders: float
    count: float

    @property
    def torque(self) -> float:
        """Density of the torque noise: the part that encoder noise does not cause [(N m)^2/Hz]."""
        return self.balance - self.encoders


def balance_noise(bands: list[SubBand], deviations: float) -> Density | None:
    """Density of the white noise of measured minus modelled torque, and its interval; None without any sub-band.

    White noise has the same density in every sub-band, and other causes, such as a resonance, only add to it. So the
    value is the mean density of the two sub-bands with the least density if these two agree, and the least density if
    they do not. It is at most the density of the balance in any sub-band in which encoder noise dominates. The interval
    extends from the least density to that of the sub-band next to the motion, because the ripple of a drive may rise
    towards lower frequencies. Both ends include the uncertainty of a median.

    If encoder noise dominates every sub-band, the upper end is the remaining density plus the uncertainty of the
    computed encoder noise, and the lower end is zero. If the remaining density is within this uncertainty, the value
    is a sixteenth of the upper end, which is a quarter of the amplitude.

    Args:
        bands: Power in each sub-band above the motion, from `balance_bands`.
        deviations: Half width of the interval in standard errors.
    """
    if not bands:
        return None
    clear = sorted((one for one in bands if not _encoders_dominate(one)), key=lambda one: one.torque)
    dominated = [one for one in bands if one not in clear]
    if not clear:
        # A small remaining density may be an error of the computed encoder noise. But torque noise of zero is unlikely.
        least = min(dominated, key=lambda one: one.balance)
        most = max(least.torque, 0.0) + _ENCODER_UNCERTAINTY * least.balance
        if least.torque > _ENCODER_UNCERTAINTY * least.balance:
            return Density(least.torque, 0.0, most)
        return Density(_ASSUMED_SHARE * most, 0.0, most, only_high_known=True)
    lowest = clear[:_AVERAGED_SUB_BANDS]
    if lowest[-1].torque > lowest[0].torque * _error_factor(lowest, deviations) ** 2:
        lowest = clear[:1]
    factor = _error_factor(lowest, deviations)
    value = min([float(np.mean([one.torque for one in lowest])), *(one.balance for one in dominated)])
    near_motion = min(clear, key=lambda one: one.centre).torque
    nearest = min(bands, key=lambda one: one.centre)
    near_motion = min(near_motion, nearest.balance) if nearest in dominated else near_motion
    low = clear[0].torque / factor
    return Density(value, low if low <= value else 0.0, max(value, near_motion) * factor)


def rising_density(bands: list[SubBand], judged_hz: float, lowest_hz: float, deviations: float) -> tuple[bool, float]:
    """Whether noise rises towards the motion, and an upper limit of its mean density in the judged band [(N m)^2/Hz].

    The noise of a drive falls with the square of the frequency above the drive's corner frequency. If this corner is
    below the sub-bands, they do not show where the density stops rising. So the slope between the two sub-bands next to
    the motion is extended to the lowest frequency of the recording. The noise rises if the slope is larger than its
    uncertainty. The limit is computed with the steepest slope within the uncertainty.

    Args:
        bands: Power in each sub-band above the motion, from `balance_bands`; at least one.
        judged_hz: Edge of the band of the motion [Hz].
        lowest_hz: Lowest frequency of the recording [Hz], one over its length.
        deviations: Half width of an interval in standard errors.
    """
    nearest = sorted(bands, key=lambda one: one.centre)[:2]
    first, rises, steepest = nearest[0], False, _STEEPEST_SLOPE
    if len(nearest) > 1 and not _encoders_dominate(first):
        second = nearest[1]
        # If encoder noise dominates in the second sub-band, its torque noise is at most the density of the balance.
        second_density = second.balance if _encoders_dominate(second) else second.torque
        rise = float(np.log(first.torque / max(second_density, 1e-300)))
        error = float(np.hypot(*(np.log(_error_factor([one], deviations)) for one in nearest)))
        rises = rise > error
        if not _encoders_dominate(second):
            steepest = min(max(rise + error, 0.0) / float(np.log(second.centre / first.centre)), _STEEPEST_SLOPE)
    f = np.geomspace(min(lowest_hz, judged_hz), judged_hz, 200)
    mean = float(np.trapezoid((first.centre / f) ** steepest, f)) / judged_hz
    density = first.balance if _encoders_dominate(first) else first.torque
    return rises, density * _error_factor([first], deviations) * mean


def _encoders_dominate(band: SubBand) -> bool:
    """True if at least half of a sub-band's power is encoder noise."""
    return band.encoders >= _DOMINANT_SHARE * band.balance


def _error_factor(bands: list[SubBand], deviations: float) -> float:
    """Factor by which the mean power of the sub-bands is uncertain, because the power of each is a median."""
    return float(np.exp(deviations * np.sqrt(2.0 / (_MEDIAN_EFFICIENCY * sum(one.count for one in bands)))))


def balance_bands(
    robot: Robot, log: Log, judged_hz: float, readings: tuple[ReadingNoise | None, ...]
) -> tuple[list[SubBand], ...]:
    """Power density of measured minus modelled torque in each sub-band above the motion, a list for each joint.

    Args:
        robot: The given model.
        log: A recording at its full rate.
        judged_hz: Edge of the band of the motion [Hz].
        readings: Noise of each joint's position readings; None where it is unknown.
    """
    out: tuple[list[SubBand], ...] = tuple([] for _ in range(robot.nv))
    rate = log.band.rate_hz
    low, high = ABOVE_MOTION * judged_hz, _HIGHEST_FREQUENCY * rate
    count = int(np.log(high / low) / np.log(_SUB_BAND_RATIO)) if high > low else 0
    if count < 1:
        return out
    # Friction is modelled at the smooth velocity, because sign changes by noise would add power above the motion.
    raw = log.motion.q if log.raw_q is None else log.raw_q
    balance = log.tau - _rigid_torque(robot, log, raw) - modelled_friction(robot, log.motion)
    if log.external is not None:
        balance = balance + log.external
    noise = reading_errors(log, readings, random_stream("errors of readings above the band"))
    encoder_torque = _rigid_torque(robot, log, log.motion.q + noise) - _rigid_torque(robot, log, log.motion.q)
    # Sub-bands are widened to fill the range. For legged robots, whose contacts are known, they stay one octave wide:
    # the judged band of leg swings is wide, and encoder noise dominates at all frequencies except those next to it.
    step = (high / low) ** (1 / count) if log.touched is None else _SUB_BAND_RATIO
    for lower, upper in pairwise(low * step ** np.arange(count + 1)):
        in_sub_band = [band_passed(x, rate, lower, upper) for x in (balance, encoder_torque)]
        travels = _travels(log, _PERIODS_BESIDE_STOPS / lower)
        for j, bands in enumerate(out):
            use = travels[:, j]
            independent = float(2.0 * (upper - lower) * use.sum() / rate)
            if independent >= _FEWEST_VALUES:
                centre = float(np.sqrt(lower * upper))
                width = (upper - lower) * float(log.noise_gain(np.array([centre]))[0])
                # The median of the magnitudes of normal noise, times 1.4826, is its standard deviation.
                whole, own = ((1.4826 * float(np.median(np.abs(x[use, j])))) ** 2 / width for x in in_sub_band)
                bands.append(SubBand(centre, whole, own, independent))
    return out


def reading_errors(
    log: Log, readings: tuple[ReadingNoise | None, ...], rng: np.random.Generator
) -> Float[Array, "N nv"]:
    """Random errors of position readings of a log's smooth motion [rad or m]; zero for joints with unknown noise."""
    q = log.motion.q
    return np.column_stack(
        [np.zeros(len(q)) if own is None else own.errors(q[:, j], rng) for j, own in enumerate(readings)]
    )


def band_passed(x: Float[Array, "N nv"], rate_hz: float, low: float, high: float) -> Float[Array, "N nv"]:
    """Part of a series between two frequencies [Hz], from a filter without delay whose smooth edges hardly ring.

    The result is scaled so that white noise keeps its power between the two frequencies.
    """
    f = np.fft.rfftfreq(len(x), 1.0 / rate_hz)
    width = 0.15 * (high - low)
    gain = 0.25 * (1.0 + np.tanh((f - low) / width)) * (1.0 - np.tanh((f - high) / width))
    # The line from the first to the last sample is subtracted, because the jump from end to start would ring.
    line = x[0] + np.linspace(0.0, 1.0, len(x))[:, None] * (x[-1] - x[0])
    out = np.fft.irfft(np.fft.rfft(x - line, axis=0) * gain[:, None], len(x), axis=0)
    return out * np.sqrt((high - low) / (np.sum(gain**2) * f[1]))


def _rigid_torque(robot: Robot, log: Log, q: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Modelled torque without friction of positions whose derivatives are computed without smoothing."""
    rate = log.band.rate_hz
    motion = log.motion.with_joints(*differentiate(q, rate, 0.4 * rate))
    return inverse_dynamics(robot, motion) - modelled_friction(robot, motion)


def _travels(log: Log, seconds: float) -> Bool[Array, "N nv"]:
    """True where a joint has no rest, reversal or contact within ``seconds`` before and after the sample."""
    speed = np.abs(log.motion.v)
    slow = standing_still(log) | (speed < rules.CREEPING_SPEED * np.percentile(speed, 99, axis=0)) | ~log.valid[:, None]
    slow = slow if log.touched is None else slow | log.touched
    reach = max(1, round(seconds * log.band.rate_hz))
    out = np.logical_not(ndimage.maximum_filter1d(slow, 2 * reach + 1, axis=0))
    out[:reach], out[len(out) - reach :] = False, False
    return out
