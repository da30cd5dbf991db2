r"""Stiffest virtual wall, strongest virtual damper and largest loop gain for which a sampled device is stable.

**Each velocity estimator** has a linear and a simulated limit. The linear limit is that of a loop in which the
estimator is a linear filter. Period measurement and adaptive windowing are not linear filters: the former is replaced
by the filter that it approaches for a fine encoder, and the latter is refused. The simulated limit is the smallest gain
with which an oscillation does not decay in a simulation with the encoder, as in the experiments of Cavusoglu, Feygin
and Tendick (2002, section 5).

**A wall** C(z) in front of a device with damping b is passive, so that the loop is stable whoever holds the device, if
(Colgate and Schenkel, 1997)

.. math:: b > \frac{T}{2} \frac{1}{1 - \cos\omega T}\, \mathrm{Re}\{(1 - e^{-j\omega T})\, C(e^{j\omega T})\}
   \quad\text{for all } 0 \le \omega \le \pi/T,

which for a spring and a damper without delay is :math:`b > KT/2 + |B|`. With a delay of :math:`dT + \tau` the power at
the aliases :math:`\omega_n` of a frequency is a Hermitian form of rank two,
:math:`b \sum |v_n|^2 - \mathrm{Re}\{\alpha\, \bar S_\tau S_0\}` with :math:`S_\tau = \sum v_n e^{j\omega_n\tau}
/(j\omega_n)`. Its largest eigenvalue replaces the right-hand side; for :math:`\tau = 0` the two are equal. The
condition is sufficient for stability with any passive operator; if B is large, a device that nobody holds is stable
with far less damping.

**Teleoperation** (Cavusoglu, Feygin and Tendick, 2002, section 5): the forces on master and slave are
:math:`\mp (G + B\,\hat v)` times the difference of their positions. Only the difference is fed back. With equal devices
a force changes the difference by twice the motion of one device, so that the limit is half of that of a wall.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.discretisation import SampledAxis, discretise
from phantom_dyn.haptics.device.transfer_function import Axis
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
from phantom_dyn.number_checks import sample_count


def velocity_filter(estimator: Estimator, *, step: float, period: float) -> DigitalFilter:
    """Filter from reading to velocity estimate.

    An average and a Kalman filter are linear filters. Period measurement is replaced by an average of differences over
    its own number of samples; if edges are frequent, this filter has half a sampling period more lag than the estimate.

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
    """Largest stable virtual damping of free motion [N s/m], without rounding.

    Raises:
        ParameterError: If the estimator is adaptive windowing.
    """
    plant = discretise(axis, period=settings.period, delay=settings.delay)
    return critical_gain(SampledLoop((plant,), scaled=_filter_of(settings)))


def critical_wall(axis: Axis, settings: LoopSettings, *, damping: float = 0.0) -> CriticalGain:
    """Largest stable stiffness of a two-sided wall with virtual damping [N/m], without rounding.

    Raises:
        ParameterError: If there is damping and the estimator is adaptive windowing.
    """
    plant = discretise(axis, period=settings.period, delay=settings.delay)
    return critical_gain(SampledLoop((plant,), scaled=UNFILTERED, fixed=_damper(settings, damping)))


def simulate_damping(
    axis: Axis, settings: LoopSettings, damping: float, *, speed: float = 0.1, duration: float = 2.0
) -> LoopTrace:
    """Simulation of a free device with this virtual damping [N s/m] that starts with a speed [m/s]."""
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
    """Simulation of a device that hits a one-sided wall at zero with a speed [m/s] under a constant force [N]."""
    hand: Float[Array, "N d"] = np.full((sample_count(duration, settings.period), 1), push)
    return simulate_loop(
        (axis,), settings, gain=stiffness, damping=damping, start=(0.0,), speed=(speed,), hand=hand, one_sided=True
    )


def simulated_damping_gain(axis: Axis, settings: LoopSettings, *, low: float, high: float) -> float:
    """Smallest virtual damping [N s/m] with which an oscillation does not decay, with encoder and rounding."""
    return gain_until_swinging(partial(simulate_damping, axis, settings), settings.encoder.step, low=low, high=high)


def _filter_of(settings: LoopSettings) -> DigitalFilter:
    return velocity_filter(settings.estimator, step=settings.encoder.step, period=settings.period)


def _damper(settings: LoopSettings, damping: float) -> DigitalFilter:
    """Filter from reading to the force of a virtual damper."""
    if damping == 0.0:
        return NOTHING
    rate = _filter_of(settings)
    return DigitalFilter(damping * rate.numerator, rate.denominator)


def _average(samples: int, period: float) -> DigitalFilter:
    """Filter from reading to ``(x[k] - x[k - n]) / (n T)``, with n = ``samples`` and T = ``period`` [s]."""
    numerator = np.zeros(samples + 1)
    numerator[0], numerator[-1] = 1.0, -1.0
    return DigitalFilter(numerator / (samples * period), np.ones(1))


def critical_loop_gain(master: Axis, slave: Axis, settings: LoopSettings, *, damping: float = 0.0) -> CriticalGain:
    """Largest stable gain on the position error [N/m], with damping on its estimated rate, without rounding.

    Args:
        master: The device in the operator's hand; `held_by` of an axis adds the hand.
        slave: The other device.
        settings: Sampling and estimator of both.
        damping: Damping on the estimated rate of the error [N s/m].

    Raises:
        ParameterError: If there is damping and the estimator is adaptive windowing.
    """
    first, second = (discretise(axis, period=settings.period, delay=settings.delay) for axis in (master, slave))
    return critical_gain(SampledLoop(_difference(first, second), scaled=UNFILTERED, fixed=_damper(settings, damping)))


def simulate_teleoperation(
    master: Axis,
    slave: Axis,
    settings: LoopSettings,
    gain: float,
    *,
    damping: float = 0.0,
    offset: float = 2e-3,
    duration: float = 2.0,
) -> LoopTrace:
    """Simulation of a free master and slave, released at a distance ``offset`` [m]; the master is column 0."""
    hand = np.zeros((sample_count(duration, settings.period), 2))
    return simulate_loop(
        (master, slave), settings, gain=gain, damping=damping, start=(offset, 0.0), speed=(0.0, 0.0), hand=hand
    )


def _difference(first: SampledAxis, second: SampledAxis) -> tuple[SampledAxis, ...]:
    """Plants whose sum is the difference of both positions; two equal devices are one plant with twice the output."""
    arrays = ("transition", "newer", "older", "output")
    if all(np.array_equal(getattr(first, name), getattr(second, name)) for name in arrays):
        twice = 2 * first.output
        direct = {"direct_now": 2 * first.direct_now, "direct_before": 2 * first.direct_before}
        return (replace(first, output=twice, **direct),)
    return (first, second)
