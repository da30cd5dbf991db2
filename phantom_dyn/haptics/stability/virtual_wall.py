r"""Stiffest virtual wall, strongest virtual damper and largest loop gain that a sampled device bears.

**With each velocity estimator**, linear: the loop of device, hold, delay and estimator as a filter; the estimators that
are no filter, period measurement and adaptive windowing, are put in as what they tend to for a fine encoder. Simulated:
the loop in time with its encoder, the gain raised until an oscillation lasts, which is how Cavusoglu, Feygin and
Tendick (2002, section 5) found their marginal gains.

**A wall** is passive whoever holds the device (Colgate and Schenkel, 1997) if a device with damping b in front of a
sampled wall C(z) has

.. math:: b > \frac{T}{2} \frac{1}{1 - \cos\omega T}\, \mathrm{Re}\{(1 - e^{-j\omega T})\, C(e^{j\omega T})\}
   \quad\text{for all } 0 \le \omega \le \pi/T,

which for a spring and a damper without delay is :math:`b > KT/2 + |B|`. With a delay of :math:`dT + \tau` the power at
the aliases :math:`\omega_n` of a frequency is a Hermitian form of rank two,
:math:`b \sum |v_n|^2 - \mathrm{Re}\{\alpha\, \bar S_\tau S_0\}` with :math:`S_\tau = \sum v_n e^{j\omega_n\tau}
/(j\omega_n)`; its largest eigenvalue takes the place of the right-hand side, and is that where :math:`\tau = 0`.
Sufficient for stability with any passive operator, and far more than a free device needs if B is large.

**Teleoperation** (Cavusoglu, Feygin and Tendick, 2002, section 5): master and slave are pushed by
:math:`\mp (G + B\,\hat v)` of the difference of their positions. Only the difference is fed back, and it answers a
force as both devices in parallel do: equal devices bear half the gain of one on a wall.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.discretisation import SampledAxis, discretise, split_delay
from phantom_dyn.haptics.device.transfer_function import Axis
from phantom_dyn.haptics.number_checks import require_not_negative, require_numbers, sample_count
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


def simulated_damping_gain(axis: Axis, settings: LoopSettings, *, low: float, high: float) -> float:
    """Virtual damping [N s/m] at which a moving device begins to swing on, encoder and all."""
    return gain_until_swinging(partial(simulate_damping, axis, settings), settings.encoder.step, low=low, high=high)


def _filter_of(settings: LoopSettings) -> DigitalFilter:
    return velocity_filter(settings.estimator, step=settings.encoder.step, period=settings.period)


def _average(samples: int, period: float) -> DigitalFilter:
    numerator = np.zeros(samples + 1)
    numerator[0], numerator[-1] = 1.0, -1.0
    return DigitalFilter(numerator / (samples * period), np.ones(1))


_POINTS = 2000
"""Points between 0 and the Nyquist frequency; the greatest value is smooth there, most often at an end."""


def passive_damping(stiffness: float, *, period: float, delay: float = 0.0, virtual_damping: float = 0.0) -> float:
    """Least damping b of the device [N s/m or N m s/rad] with which this wall is passive.

    Args:
        stiffness: K of the wall [N/m or N m/rad].
        period: Sampling period T [s].
        delay: Of the loop beside the hold [s]; any number of 0 or more.
        virtual_damping: B of the wall.

    Raises:
        ParameterError: If stiffness or delay is negative, the period not positive, or a number not finite.
    """
    require_not_negative(stiffness=stiffness)
    require_numbers(virtual_damping=virtual_damping)
    steps, rest = split_delay(period, delay)
    x = np.linspace(0.0, np.pi, _POINTS + 1)[1:]
    x = np.concatenate([np.geomspace(1e-3 * x[0], x[0], 20)[:-1], x])
    back = -np.expm1(-1j * x)  # 1 - 1/z, exact where z is near one
    wall = stiffness + virtual_damping / period * back
    alpha = back * wall / period * np.exp(-1j * steps * x)
    square = (0.5 * period / np.sin(0.5 * x)) ** 2  # sum of 1/w_n^2 over all aliases
    if rest == 0:
        return float(np.max((alpha * square).real))
    # Sum of exp(-j w_n rest)/w_n^2 over the aliases: the z transform of a ramp that starts `rest` before the samples.
    cross = alpha * -period * np.conj(rest / back + period * (1.0 - back) / back**2)
    apart = np.maximum((np.abs(alpha) * square) ** 2 - cross.imag**2, 0.0)
    return float(np.max(0.5 * (cross.real + np.sqrt(apart))))


def critical_loop_gain(master: Axis, slave: Axis, settings: LoopSettings, *, damping: float = 0.0) -> CriticalGain:
    """Largest gain [N/m] of the position error, with a damping of its estimated rate beside it, rounding left out.

    Args:
        master: The device in the operator's hand; `held_by` of an axis puts the hand on it.
        slave: The other device.
        settings: Sampling and estimator of both.
        damping: Of the estimated rate of the error [N s/m].

    Raises:
        ParameterError: If there is damping and the estimator is adaptive windowing.
    """
    first, second = (discretise(axis, period=settings.period, delay=settings.delay) for axis in (master, slave))
    fixed = NOTHING
    if damping != 0.0:
        rate = velocity_filter(settings.estimator, step=settings.encoder.step, period=settings.period)
        fixed = DigitalFilter(damping * rate.numerator, rate.denominator)
    return critical_gain(SampledLoop(_difference(first, second), scaled=UNFILTERED, fixed=fixed))


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
    """Master and slave let go in free space `offset` [m] apart; column 0 of the traces is the master."""
    hand = np.zeros((sample_count(duration, settings.period), 2))
    return simulate_loop(
        (master, slave), settings, gain=gain, damping=damping, start=(offset, 0.0), speed=(0.0, 0.0), hand=hand
    )


def _difference(first: SampledAxis, second: SampledAxis) -> tuple[SampledAxis, ...]:
    """What the difference of both positions sees. Of equal devices one, twice: no force moves both together."""
    arrays = ("transition", "newer", "older", "output")
    if all(np.array_equal(getattr(first, name), getattr(second, name)) for name in arrays):
        twice = 2 * first.output
        direct = {"direct_now": 2 * first.direct_now, "direct_before": 2 * first.direct_before}
        return (replace(first, output=twice, **direct),)
    return (first, second)
