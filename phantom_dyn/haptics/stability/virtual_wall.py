r"""Stiffest virtual wall and strongest virtual damper that a sampled device bears with each velocity estimator.

Linear: the loop of device, hold, delay and estimator as a filter; the estimators that are no filter, period measurement
and adaptive windowing, are put in as what they tend to for a fine encoder. Simulated: the loop in time with its
encoder, the gain raised until an oscillation lasts, which is how Cavusoglu, Feygin and Tendick (2002, section 5)
found their marginal gains.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.transfer_function import Axis
from phantom_dyn.haptics.number_checks import sample_count
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings, LoopTrace, gain_until_swinging, simulate_loop
from phantom_dyn.haptics.sensing.velocity_estimators import (
    AdaptiveWindow,
    AveragedDifference,
    Estimator,
    KalmanVelocity,
    PeriodMeasurement,
    kalman_gains,
)
from phantom_dyn.haptics.stability.sampled_loop import (
    NOTHING,
    UNFILTERED,
    CriticalGain,
    DigitalFilter,
    SampledLoop,
    critical_gain,
)


def velocity_filter(estimator: Estimator, *, step: float, period: float) -> DigitalFilter:
    """Filter from reading to velocity estimate.

    An average and a Kalman filter are filters. Period measurement is taken as the difference of two samples that its
    own average then smooths: with the encoder's period short beside the sampling period, that is half a period T later
    than it is.

    Raises:
        ParameterError: For adaptive windowing, whose window depends on the motion.
    """
    match estimator:
        case AveragedDifference(samples):
            return _average(samples, period)
        case PeriodMeasurement(samples=samples):
            return _average(samples, period)
        case KalmanVelocity():
            position, velocity = kalman_gains(estimator, step=step, period=period)
            # From prediction and correction: v/x = l (1 - 1/z) / (1 - (2 - k - l T)/z + (1 - k)/z^2).
            return DigitalFilter(
                velocity * np.array([1.0, -1.0]), np.array([1.0, position + velocity * period - 2.0, 1.0 - position])
            )
        case AdaptiveWindow():
            raise ParameterError(
                "Adaptive windowing is no linear filter, its window depends on the motion: simulate the loop instead."
            )


def critical_damping_gain(axis: Axis, settings: LoopSettings) -> CriticalGain:
    """Largest virtual damping [N s/m] of free motion, force against the estimated velocity, rounding left out.

    Raises:
        ParameterError: If the estimator is adaptive windowing.
    """
    plant = discretise(axis, period=settings.period, delay=settings.delay)
    return critical_gain(SampledLoop((plant,), scaled=_filter_of(settings)))


def critical_wall(axis: Axis, settings: LoopSettings, *, damping: float = 0.0) -> CriticalGain:
    """Largest stiffness [N/m] of a wall that the device stays in, with a virtual damping beside it, rounding left out.

    Raises:
        ParameterError: If there is damping and the estimator is adaptive windowing.
    """
    plant = discretise(axis, period=settings.period, delay=settings.delay)
    fixed = NOTHING
    if damping != 0.0:
        rate = _filter_of(settings)
        fixed = DigitalFilter(damping * rate.numerator, rate.denominator)
    return critical_gain(SampledLoop((plant,), scaled=UNFILTERED, fixed=fixed))


def simulate_damping(
    axis: Axis, settings: LoopSettings, damping: float, *, speed: float = 0.1, duration: float = 2.0
) -> LoopTrace:
    """A device pushed off at a speed [m/s] into a virtual liquid of this damping [N s/m]."""
    hand = np.zeros((sample_count(duration, settings.period), 1))
    return simulate_loop((axis,), settings, gain=0.0, damping=damping, start=(0.0,), speed=(speed,), hand=hand)


def simulate_wall(
    axis: Axis,
    settings: LoopSettings,
    stiffness: float,
    *,
    damping: float = 0.0,
    speed: float = 0.1,
    push: float = 1.0,
    duration: float = 2.0,
) -> LoopTrace:
    """A device that meets a one-sided wall at zero with a speed [m/s], pressed on it by a constant force [N]."""
    hand: Float[Array, "N d"] = np.full((sample_count(duration, settings.period), 1), push)
    return simulate_loop(
        (axis,), settings, gain=stiffness, damping=damping, start=(0.0,), speed=(speed,), hand=hand, one_sided=True
    )


def simulated_damping_gain(
    axis: Axis, settings: LoopSettings, *, low: float, high: float, speed: float = 0.1, duration: float = 2.0
) -> float:
    """Virtual damping [N s/m] at which a moving device begins to swing on, encoder and all."""
    run = partial(simulate_damping, axis, settings, speed=speed, duration=duration)
    return gain_until_swinging(run, settings.encoder.step, low=low, high=high)


def simulated_wall(
    axis: Axis,
    settings: LoopSettings,
    *,
    low: float,
    high: float,
    damping: float = 0.0,
    speed: float = 0.1,
    push: float = 1.0,
    duration: float = 2.0,
) -> float:
    """Stiffness [N/m] at which a device pressed on a wall begins to swing on, encoder and all."""
    run = partial(simulate_wall, axis, settings, damping=damping, speed=speed, push=push, duration=duration)
    return gain_until_swinging(run, settings.encoder.step, low=low, high=high)


def _filter_of(settings: LoopSettings) -> DigitalFilter:
    return velocity_filter(settings.estimator, step=settings.encoder.step, period=settings.period)


def _average(samples: int, period: float) -> DigitalFilter:
    numerator = np.zeros(samples + 1)
    numerator[0], numerator[-1] = 1.0, -1.0
    return DigitalFilter(numerator / (samples * period), np.ones(1))
