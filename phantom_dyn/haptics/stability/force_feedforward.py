r"""Force feedforward: a device measures the force of the hand and amplifies it, so that the device feels lighter.

The motor adds :math:`K_f` times the measured force. In continuous time the hand feels mass and damper divided by
:math:`1 + K_f`, (28). With sampling, filter and hold, the loop around the impedance :math:`Z_h` of the hand has the
characteristic equation

.. math:: 1 + K_f\, D(z)\, Z\left[H(s)\, G_f(s)\, \frac{Z_h(s)}{m s^2 + b s + Z_h(s)}\, e^{-t_d s}\right] = 0
   \quad (29)

with the digital filter :math:`D`, the hold :math:`H`, the low pass :math:`G_f` of the sensor, the delay :math:`t_d`,
and :math:`Z[\cdot]` for sampling. The gain :math:`K_f` has a limit, (32). For a delay that is so long that only the
masses matter at the frequency of the crossing, the limit is :math:`1 + m / m_h`, (33).

**Comparison with the chapter.** The chapter prints a limit with which 5.4 kg feel like 0.14 kg, but no numbers of its
operator. This loop gives 0.14 kg for an operator of 0.271 kg. For 2 kg, the mass commonly cited for the named operator,
the limit is 6.64 and the felt mass 0.71 kg, which disagrees with the chapter. A short delay does not lower the limit:
half a period of delay more than doubles it. (Without a delay the phase reaches -180 degrees only at the Nyquist
frequency.) Longer delays lower it.

**The vibration determines the limit.** The chapter says that modes which its model leaves out "play an important role",
and uses a low pass at 30 Hz, below the 82 Hz of the cable. With the two masses of the LHIfAM (the chapter's device, see
`phantom_dyn.haptics.device.published`) and a hand of 2 kg the limit is 0.70 at 87 Hz instead of 6.64, and with the low
pass 6.86 at 66 Hz. The gain of 5 in the chapter is stable with the low pass and unstable without. The rigid model (23.1
with and 6.64 without the low pass) does not show this.

References:
    J. J. Gil et al., chapter on stability and transparency in "Advances in Haptics", 2010, equations (28) to (33). The
    available copy lacks (29), which is derived here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.signal import butter

from phantom_dyn.array_types import Array, Complex, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import Operator
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.held_device import Device, HeldDevice, felt_impedance
from phantom_dyn.haptics.stability.sampled_loop import (
    UNFILTERED,
    CriticalGain,
    DigitalFilter,
    SampledLoop,
    critical_gain,
)
from phantom_dyn.number_checks import require_not_negative, require_positive, require_whole

SENSOR_CUTOFF = 2 * math.pi * 200.0
"""First-order low pass of the force sensor [rad/s], (31)."""


@dataclass(frozen=True)
class Feedforward:
    """Filters, sampling and delay between measured force and motor force.

    Attributes:
        period: Sampling period T [s].
        delay: Delay in addition to the hold [s], 0 or more.
        cutoff: Cut-off of the sensor's first-order low pass [rad/s].
        filter: Digital filter on the measured force.

    Raises:
        ParameterError: If period or cutoff are not above 0, or the delay is negative.
    """

    period: float = 1e-3
    delay: float = 0.0
    cutoff: float = SENSOR_CUTOFF
    filter: DigitalFilter = UNFILTERED

    def __post_init__(self) -> None:
        require_positive("the feedforward", period=self.period, cutoff=self.cutoff)
        require_not_negative("the feedforward", delay=self.delay)

    def response(self, frequency: Float[Array, " k"]) -> Complex[Array, " k"]:
        """Motor force over the hand's force per unit of gain, without aliases of the sampling, shape ``(k,)``."""
        s = 1j * frequency
        turn = frequency * self.period
        held = np.exp(-0.5j * turn) * np.sinc(turn / (2 * np.pi))
        sensor = 1.0 / (1.0 + s / self.cutoff)
        return held * sensor * np.exp(-s * self.delay) * self.filter.response(frequency, self.period)


@dataclass(frozen=True)
class Transparency:
    """Bode data of a device in a hand, and the impedance of the device that the hand feels.

    Attributes:
        frequency: Frequencies [rad/s], shape ``(k,)``.
        response: Position over the hand's own force, X_h / F_h [m/N], shape ``(k,)``.
        ideal: Response by (28), without sampling, filter and delay, shape ``(k,)``.
        device: Impedance of the device at the hand, force over position [N/m], shape ``(k,)``.
        apparent_inertia: Real part of force over acceleration of the device at the hand [kg], shape ``(k,)``.
    """

    frequency: Float[Array, " k"]
    response: Complex[Array, " k"]
    ideal: Complex[Array, " k"]
    device: Complex[Array, " k"]
    apparent_inertia: Float[Array, " k"]


def low_pass(cutoff: float, *, period: float, order: int = 2) -> DigitalFilter:
    """Digital Butterworth low pass, such as that of second order at 30 Hz in the chapter.

    Args:
        cutoff: Cut-off frequency [rad/s].
        period: Sampling period [s].
        order: Order of the filter.

    Raises:
        ParameterError: If the cutoff is not below half the sampling frequency, the period not positive, or the order no
            whole number above 0.
    """
    require_positive(period=period)
    require_whole(1, order_of_the_filter=order)
    if not 0 < cutoff < math.pi / period:
        raise ParameterError(f"The cutoff is {cutoff:g} rad/s: give one above 0 and below {math.pi / period:g} rad/s.")
    numerator, denominator = cast("tuple[Array, Array]", butter(order, cutoff * period / math.pi))
    return DigitalFilter(numerator, denominator)


def feedforward_loop(axis: Device, hand: Operator, feedforward: Feedforward) -> SampledLoop:
    """The loop (29) from motor force to measured force, with filter, sampling and hold.

    Args:
        axis: Rigid device, as in the chapter, or a device with two masses and a vibration between motor and sensor.
        hand: The hand that holds the device.
        feedforward: Filters, sampling and delay.

    Raises:
        ParameterError: If nobody holds the device, so that there is no loop.
    """
    held = HeldDevice(axis, hand, feedforward.cutoff)
    plant = discretise(held, period=feedforward.period, delay=feedforward.delay)
    return SampledLoop((plant,), scaled=feedforward.filter)


def critical_feedforward(axis: Device, hand: Operator, feedforward: Feedforward) -> CriticalGain:
    """Largest stable force gain K_f, (32), and the frequency of the oscillation beyond it."""
    return critical_gain(feedforward_loop(axis, hand, feedforward))


def worst_critical_feedforward(mass: float, hand_mass: float) -> float:
    """Limit of the force gain for long delays, 1 + m / m_h, (33).

    Raises:
        ParameterError: If the mass is negative, or the hand's mass is not above 0.
    """
    if not (mass >= 0 and hand_mass > 0):
        raise ParameterError(f"Masses of {mass} kg and {hand_mass} kg were given: give a hand's mass above 0.")
    return 1.0 + mass / hand_mass


def felt_mass(mass: float, gain: float) -> float:
    """Mass that the hand feels under an ideal force gain, m / (1 + K_f) [kg].

    Raises:
        ParameterError: If the mass is negative, or the gain not above -1.
    """
    if not (math.isfinite(mass) and mass >= 0):
        raise ParameterError(f"The mass is {mass} kg: give a number of 0 or more.")
    _require_gain(gain)
    return mass / (1.0 + gain)


def transparency(
    axis: Device, hand: Operator, feedforward: Feedforward, gain: float, frequency: Float[Array, " k"]
) -> Transparency:
    """Bode data with force gain K_f at the frequencies [rad/s], by (28) and with filter, hold and delay.

    Aliases of the sampling are left out, so that the data are valid below half the sampling frequency. Of a device with
    two masses, the hand holds the body; the force of the motor acts on the body through the cable.

    Raises:
        ParameterError: If a frequency is not a number above 0, or the gain not above -1.
    """
    _require_gain(gain)
    if not (np.isfinite(frequency) & (frequency > 0)).all():
        raise ParameterError("A frequency of 0 or less was given: a Bode diagram needs frequencies above 0.")
    impedance = hand.impedance(frequency)
    felt = felt_impedance(axis, gain * feedforward.response(frequency), frequency)
    return Transparency(
        frequency=frequency,
        response=1.0 / (felt + impedance),
        ideal=1.0 / (felt_impedance(axis, gain, frequency) + impedance),
        device=felt,
        apparent_inertia=np.real(felt / (1j * frequency) ** 2),
    )


def _require_gain(gain: float) -> None:
    if not (math.isfinite(gain) and gain > -1):
        raise ParameterError(
            f"The force gain is {gain}: give a number above -1, at which the motor would cancel the hand's force."
        )
