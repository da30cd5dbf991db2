r"""White-noise and swept-sine experiments on a device, simulated or recorded, for its frequency response and coherence.

**White noise**: the force is noise, and the position is recorded.

**Swept sine**: the force is a sine whose frequency rises over a period P, :math:`f(t) = f_1 (f_2/f_1)^{t/P}`, and
starts again. All of its power is between f1 and f2, and its standard deviation is 0.71 of its greatest force. For white
noise the standard deviation is only a third of the greatest force (if this is three standard deviations), and the power
extends to the Nyquist frequency. The sweep is periodic, so that its spectrum has no leakage, needs no window, and has
independent lines. Differences between periods are noise, from which the coherence follows.

As in `phantom_dyn.haptics.experiments.frequency_response`, the second difference of the position is used, because a
free device drifts. The first period, in which the vibration builds up, is left out.

References:
    A. Farina, Simultaneous measurement of impulse response and distortion with a swept-sine technique, 108th AES
    Convention, 2000 (the exponential sweep; recalled, not read). Cavusoglu, Feygin and Tendick (2002, section 4.3)
    measured the PHANToM's response at discrete frequencies, sampled at 10 kHz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.experiments.frequency_response import (
    MOST_COHERENT,
    FrequencyResponse,
    estimate_frequency_response,
)
from phantom_dyn.haptics.experiments.relay import held_forces
from phantom_dyn.number_checks import (
    require_columns,
    require_not_negative,
    require_positive,
    require_whole,
    sample_count,
)


@dataclass(frozen=True)
class WhiteNoiseExperiment(ReadOnlyArrays):
    """Recorded force and position.

    Attributes:
        period: Sampling period [s].
        force: Force commanded by the computer [N or N m], shape ``(N,)``.
        position: Position read by the encoder [m or rad], shape ``(N,)``.
    """

    period: float
    force: Float[Array, " N"]
    position: Float[Array, " N"]

    def frequency_response(self, *, segment: float) -> FrequencyResponse:
        """Empirical transfer function from segments of this length [s]."""
        return estimate_frequency_response(self.force, self.position, period=self.period, segment=segment)


def simulate_white_noise(
    axis: RigidAxis | TwoMassAxis,
    *,
    period: float,
    delay: float = 0.0,
    force: float,
    position_noise: float,
    duration: float,
    rng: np.random.Generator,
) -> WhiteNoiseExperiment:
    """Simulated experiment: white noise drives a device at rest behind hold and delay; readings have noise.

    Args:
        axis: Model of the device.
        period: Sampling period [s].
        delay: Delay of the loop in addition to the hold [s].
        force: Standard deviation of the force [N or N m].
        position_noise: Standard deviation of the reading [m or rad].
        duration: Duration of the experiment [s].
        rng: Generator of force and noise.

    Raises:
        ParameterError: If a deviation is negative, or period or duration are not positive.
    """
    require_not_negative(force=force, position_noise=position_noise)
    given = force * rng.standard_normal(sample_count(duration, period))
    s = discretise(axis, period=period, delay=delay)
    position = held_forces(s.transition, s.newer, s.older, s.output, s.steps, axis.rest(0.0), given, 0.0)
    return WhiteNoiseExperiment(period, given, position + position_noise * rng.standard_normal(len(given)))


@dataclass(frozen=True)
class Sweep:
    """A sine of rising frequency, repeated.

    Attributes:
        lowest: Frequency at the start of a period [rad/s].
        highest: Frequency at the end of a period [rad/s].
        duration: Duration of one period [s].
        periods: Number of periods that are evaluated, two or more; one more runs before them.

    Raises:
        ParameterError: If the frequencies do not rise from above 0, a period is shorter than four cycles of the lowest
            frequency, or there are fewer than two periods.
    """

    lowest: float
    highest: float
    duration: float
    periods: int = 4

    def __post_init__(self) -> None:
        require_positive(lowest_frequency=self.lowest, duration_of_a_sweep=self.duration)
        require_whole(2, periods_of_the_sweep=self.periods)
        if not (math.isfinite(self.highest) and self.highest > self.lowest):
            raise ParameterError(
                f"A sweep from {self.lowest:g} to {self.highest:g} rad/s was given: give a higher frequency at its end."
            )
        if self.duration * self.lowest < 8 * math.pi:
            raise ParameterError(
                f"A sweep of {self.duration:g} s starts at {self.lowest:g} rad/s: give one of at least four cycles of "
                f"that frequency, {8 * math.pi / self.lowest:.3g} s."
            )

    def force(self, amplitude: float, period: float) -> Float[Array, " n"]:
        """Force at the samples of one period of the sweep [N or N m], shape ``(n,)``.

        Args:
            amplitude: Greatest force [N or N m].
            period: Sampling period [s].

        Raises:
            ParameterError: If the highest frequency is not below half the sampling frequency.
        """
        count = sample_count(self.duration, period)
        if self.highest >= math.pi / period:
            raise ParameterError(
                f"The sweep ends at {self.highest:g} rad/s and is sampled every {period:g} s: give one that ends below "
                f"{math.pi / period:.5g} rad/s."
            )
        log_ratio = math.log(self.highest / self.lowest)
        t = period * np.arange(count)
        phase = self.lowest * self.duration / log_ratio * np.expm1(t / self.duration * log_ratio)
        return amplitude * np.sin(phase)


@dataclass(frozen=True)
class SweptSineExperiment(ReadOnlyArrays):
    """Recorded force and position of a repeated sweep, including the first period.

    Attributes:
        period: Sampling period [s].
        sweep: The sweep that drove the device.
        force: Force commanded by the computer [N or N m], shape ``(N,)``.
        position: Position read by the encoder [m or rad], shape ``(N,)``.
    """

    period: float
    sweep: Sweep
    force: Float[Array, " N"]
    position: Float[Array, " N"]

    def frequency_response(self) -> FrequencyResponse:
        """Position over force at the spectral lines within the sweep."""
        response = response_of_periods(
            self.force, self.position, sampling_period=self.period, periods=self.sweep.periods
        )
        return response.between(self.sweep.lowest, self.sweep.highest)


def simulate_swept_sine(
    axis: RigidAxis | TwoMassAxis,
    sweep: Sweep,
    *,
    period: float,
    delay: float = 0.0,
    force: float,
    position_noise: float,
    rng: np.random.Generator,
) -> SweptSineExperiment:
    """Simulated experiment: a repeated sweep drives a device at rest behind hold and delay; readings have noise.

    Args:
        axis: Model of the device.
        sweep: Frequencies, duration and number of periods.
        period: Sampling period [s].
        delay: Delay of the loop in addition to the hold [s].
        force: Greatest force [N or N m].
        position_noise: Standard deviation of the reading [m or rad].
        rng: Generator of the noise.

    Raises:
        ParameterError: If force or noise is negative, or the sweep is too fast for the sampling.
    """
    require_not_negative(force=force, position_noise=position_noise)
    given = np.tile(sweep.force(force, period), sweep.periods + 1)
    s = discretise(axis, period=period, delay=delay)
    position = held_forces(s.transition, s.newer, s.older, s.output, s.steps, axis.rest(0.0), given, 0.0)
    return SweptSineExperiment(period, sweep, given, position + position_noise * rng.standard_normal(len(given)))


def response_of_periods(
    force: Float[Array, " N"], position: Float[Array, " N"], *, sampling_period: float, periods: int
) -> FrequencyResponse:
    r"""Frequency response from force and position over ``periods + 1`` equal periods of a sweep, without the first one.

    With the spectra :math:`U_i, Y_i` of the i-th period of the sweep, the response is
    :math:`H = \sum Y_i \bar U_i / \sum |U_i|^2` and the coherence is
    :math:`|\sum Y_i \bar U_i|^2 / (\sum |U_i|^2 \sum |Y_i|^2)`.

    Args:
        force: Force [N or N m], shape ``(N,)``.
        position: Position [m or rad], shape ``(N,)``.
        sampling_period: Time between two samples [s].
        periods: Number of periods of the sweep that are evaluated, two or more.

    Returns:
        All lines between 0 and the Nyquist frequency at which the force has more than a millionth of its largest
        amplitude.

    Raises:
        ParameterError: If the columns are not ``periods + 1`` equal lengths of 16 samples or more, or force or position
            never changes.
    """
    require_positive(period=sampling_period)
    require_whole(2, periods=periods)
    require_columns(np.size(force), force=force, position=position)
    length, over = divmod(len(force), periods + 1)
    if over or length < 16:
        raise ParameterError(
            f"{len(force)} samples were given for {periods} periods and one before them: give {periods + 1} periods of "
            "equal length, at least 16 samples each."
        )
    # Periods start one sample earlier, so that each second difference has both neighbours.
    now = slice(length - 1, len(force) - 1)
    second_difference = position[length:] - 2.0 * position[now] + position[length - 2 : -2]
    drive, answer = (np.fft.rfft(part.reshape(periods, length), axis=1) for part in (force[now], second_difference))
    inside = slice(1, (length + 1) // 2)
    drive, answer = drive[:, inside], answer[:, inside]
    w = 2 * np.pi * np.fft.rfftfreq(length, sampling_period)[inside]
    drive_power, answer_power = (np.sum(np.abs(part) ** 2, axis=0) for part in (drive, answer))
    if not drive_power.any() or not answer_power.any():
        what = "force" if not drive_power.any() else "position"
        raise ParameterError(f"The {what} never changes: record the device while its motor is driven by the sweep.")
    cross = np.sum(answer * np.conj(drive), axis=0)
    driven = drive_power > 1e-12 * drive_power.max()
    w, drive_power, answer_power, cross = w[driven], drive_power[driven], answer_power[driven], cross[driven]
    response = cross / drive_power / (-4.0 * np.sin(0.5 * w * sampling_period) ** 2)
    coherence = np.clip(np.abs(cross) ** 2 / (drive_power * answer_power), 0.0, MOST_COHERENT)
    # Each of n periods is compared with their mean, which leaves n - 1 degrees of freedom.
    scatter = (1.0 - coherence) / coherence / (2.0 * (periods - 1))
    return FrequencyResponse(sampling_period, w, response, coherence, np.sqrt(scatter), float(periods), 1.0)
