r"""Drives of a haptic device: heat of a motor that holds a torque, and cogging of a brush motor.

**Heat.** Cavusoglu, Feygin and Tendick (2002, section 4.1.1): if the current is switched between 0 and its maximum with
a duty cycle D, the heat is :math:`I_{max}^2 D R`. A linear amplifier with the same mean current gives :math:`(I_{max}
D)^2 R`, so that the ratio of the two is :math:`1 / D`. This assumes that the current follows the switch without delay,
but the inductance of the winding smooths the current. `switched_current` includes the inductance: the ratio falls from
1/D to 1 as the time constant of the winding becomes longer than the period of the pulses.

**Cogging.** Cavusoglu, Feygin and Tendick (2002, section 4.1.1): "when these brushes switch, the resistance of the
windings changes. If the amplifier regulates voltage, the change in resistance causes a change in the current, and thus
a change in the motor torque. This is called cogging". A current amplifier causes no cogging. The paper has no
equations; the equations here are those of a lap winding.

A commutator of n bars, n odd, connects n equal coils to a ring. If each brush touches one bar, the ring is divided into
:math:`(n-1)/2` and :math:`(n+1)/2` coils. While a brush touches two bars, one coil is shorted and the others are
divided evenly. The resistance then falls by the factor :math:`n / (n + 1)`, :math:`2n` times per revolution. Under a
constant voltage the torque is therefore higher by :math:`1/n` while a brush touches two bars. The change is
proportional to the command, unlike cogging by magnets (`phantom_dyn.effects.drive.cogging`). At high speed the
inductance of the winding smooths the change: :math:`L\,di/dt = U - k\,\omega - R(\theta)\,i`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.number_checks import require_not_negative, require_numbers, require_positive, require_whole

PUBLISHED_RISE_PULSES, PUBLISHED_RISE_LINEAR = 34.5, 14.5
"""Rise of the casing's temperature [K] after 10 min at 2 N: stock amplifier and linear one (section 5)."""


@dataclass(frozen=True)
class Winding:
    """Winding of a motor.

    Attributes:
        resistance: Resistance [ohm].
        inductance: Inductance [H]; the paper assumes 0.
    """

    resistance: float
    inductance: float = 0.0

    def __post_init__(self) -> None:
        require_positive("the winding", resistance=self.resistance)
        require_not_negative("the winding", inductance=self.inductance)


@dataclass(frozen=True)
class SwitchedCurrent:
    """One period of the steady current under pulses, and its heat.

    Attributes:
        t: Times from the switch-on [s], shape ``(n,)``.
        current: Current [A], shape ``(n,)``.
        mean: Mean current [A].
        heat: Mean heat in the winding [W].
        heat_linear: Heat in the winding with a linear amplifier and the same mean current [W].
    """

    t: Float[Array, " n"]
    current: Float[Array, " n"]
    mean: float
    heat: float
    heat_linear: float

    @property
    def ratio(self) -> float:
        """Heat under pulses over the heat with a linear amplifier."""
        return self.heat / self.heat_linear


@dataclass(frozen=True)
class Warming:
    """Temperature rise of a motor under two drives.

    Attributes:
        t: Times [s], shape ``(n,)``.
        pulses: Rise under pulses [K], shape ``(n,)``.
        linear: Rise under the linear amplifier [K], shape ``(n,)``.
    """

    t: Float[Array, " n"]
    pulses: Float[Array, " n"]
    linear: Float[Array, " n"]


def duty_of_heat_ratio(ratio: float) -> float:
    """Duty cycle at which pulses cause ``ratio`` times the heat of a linear amplifier.

    The published rises of 34.5 K and 14.5 K give 0.42, if the rise of the casing is proportional to the heat. The paper
    states no duty cycle for this experiment.

    Raises:
        ParameterError: If the ratio is below 1, because no duty cycle has such a ratio.
    """
    if not (math.isfinite(ratio) and ratio >= 1):
        raise ParameterError(f"A heat ratio of {ratio} belongs to no duty cycle: give a number of 1 or more.")
    return 1.0 / ratio


def switched_current(winding: Winding, *, voltage: float, duty: float, frequency: float) -> SwitchedCurrent:
    """Steady current of a motor at rest whose supply is on for the duty cycle and short-circuited for the rest.

    Args:
        winding: Resistance and inductance.
        voltage: Voltage of the supply [V].
        duty: Duty cycle in (0, 1].
        frequency: Frequency of the pulses [Hz].

    Raises:
        ParameterError: If the duty cycle is not in (0, 1], or voltage or frequency are not above 0.
    """
    if not 0 < duty <= 1:
        raise ParameterError(f"The duty cycle is {duty}: give a share above 0 and at most 1.")
    require_positive("the pulses", voltage=voltage, frequency=frequency)
    period, highest = 1 / frequency, voltage / winding.resistance
    t = np.linspace(0.0, period, 1001)
    on = t < duty * period
    if duty == 1.0:
        current, mean_square = np.full(t.size, highest), highest**2
    elif winding.inductance == 0.0:
        current, mean_square = np.where(on, highest, 0.0), highest**2 * duty
    else:
        x, y = duty * period * winding.resistance / winding.inductance, period * winding.resistance / winding.inductance
        peak = -math.expm1(-x) / -math.expm1(-y)  # current at the switch-off, as a share of the highest
        low = peak * math.exp(x - y)
        rate = winding.resistance / winding.inductance
        rising = 1 - (1 - low) * np.exp(-rate * t)
        falling = peak * np.exp(-rate * np.maximum(t - duty * period, 0.0))
        current = highest * np.where(on, rising, falling)
        # The winding converts all energy of the supply to heat. So R times the mean square of the current is the
        # voltage times the charge while the supply is on, divided by the period.
        charge = x - (1 - low) * -math.expm1(-x)
        mean_square = highest**2 * charge / y
    return SwitchedCurrent(
        t=t,
        current=current,
        mean=duty * highest,
        heat=winding.resistance * mean_square,
        heat_linear=winding.resistance * (duty * highest) ** 2,
    )


def warming(
    *, heat_pulses: float, heat_linear: float, resistance: float, time_constant: float, t: Float[Array, " n"]
) -> Warming:
    """Temperature rise of one thermal mass under the heat of two drives; the paper gives no thermal constants.

    Args:
        heat_pulses: Heat under pulses [W].
        heat_linear: Heat under the linear amplifier [W].
        resistance: Thermal resistance to the room [K/W].
        time_constant: Thermal time constant [s].
        t: Times [s], shape ``(n,)``.

    Raises:
        ParameterError: If the time constant is not above 0, or heat, resistance or a time is negative.
    """
    require_positive(thermal_time_constant=time_constant)
    require_not_negative(heat_under_pulses=heat_pulses, heat_of_the_linear_drive=heat_linear, resistance=resistance)
    if not (t >= 0).all():
        raise ParameterError(
            "The times of the warming hold one that is negative or no number: give seconds of 0 or more."
        )
    share = -np.expm1(-t / time_constant)
    return Warming(t, heat_pulses * resistance * share, heat_linear * resistance * share)


# Number of intervals into which a switching period is divided; torques are given at their ends.
_POINTS = 400


@dataclass(frozen=True)
class BrushMotor:
    """A motor with brushes.

    Attributes:
        winding: Inductance, and resistance while each brush touches one bar.
        torque_constant: Torque constant [N m/A], equal to the back-EMF constant [V s/rad].
        bars: Number of bars of the commutator, an odd number of 3 or more.
        joined: Share of the angle over which a brush touches two bars, between 0 and 1.

    Raises:
        ParameterError: If the torque constant is not above 0, the bars are even or too few, or the share is not
            between 0 and 1.
    """

    winding: Winding
    torque_constant: float
    bars: int
    joined: float = 0.3

    def __post_init__(self) -> None:
        require_positive(torque_constant=self.torque_constant)
        require_whole(3, bars_of_the_commutator=self.bars)
        if self.bars % 2 == 0:
            raise ParameterError(f"The commutator has {self.bars} bars: give an odd number of 3 or more.")
        if not 0 < self.joined < 1:
            raise ParameterError(
                f"A brush joins two bars over a share of {self.joined} of the angle: give one between 0 and 1."
            )

    @property
    def period(self) -> float:
        """Angle from one switching of either brush to the next [rad]."""
        return math.pi / self.bars

    @property
    def joined_resistance(self) -> float:
        """Resistance of the winding while a brush touches two bars [ohm]."""
        return self.winding.resistance * self.bars / (self.bars + 1)


@dataclass(frozen=True)
class SteadyTorque:
    """Torque of a motor that turns at a constant speed, over one switching period.

    Attributes:
        angle: Angle of the rotor from the point at which a brush begins to touch two bars [rad], shape ``(n,)``.
        torque: Torque under a constant voltage [N m], shape ``(n,)``.
        mean: Mean torque over the angle [N m]; a current amplifier would give this torque without ripple.
    """

    angle: Float[Array, " n"]
    torque: Float[Array, " n"]
    mean: float

    @property
    def ripple(self) -> float:
        """Largest minus smallest torque, divided by the mean."""
        return float(np.ptp(self.torque)) / abs(self.mean)


def steady_torque(motor: BrushMotor, *, speed: float, voltage: float) -> SteadyTorque:
    """Torque under a constant voltage at a constant speed, with the winding's inductance.

    Args:
        motor: The motor.
        speed: Speed of the rotor, above 0 [rad/s].
        voltage: Voltage at the motor [V].

    Raises:
        ParameterError: If the speed is not above 0, or if the voltage equals the back-EMF.
    """
    require_positive(speed_of_the_rotor=speed)
    require_numbers(voltage=voltage)
    remaining_voltage = voltage - motor.torque_constant * speed
    if remaining_voltage == 0:
        raise ParameterError(
            f"At {speed:g} rad/s the back-EMF is {voltage:g} V, so that no current flows: give another voltage."
        )
    turn, L = np.linspace(0.0, 1.0, _POINTS + 1), motor.winding.inductance
    resistances = (motor.joined_resistance, motor.winding.resistance)
    # Currents that the two resistances approach.
    ends = [remaining_voltage / R for R in resistances]
    if L == 0:
        current = np.where(turn < motor.joined, *ends)
        mean = motor.joined * ends[0] + (1 - motor.joined) * ends[1]
    else:
        spans = [share * motor.period / speed for share in (motor.joined, 1 - motor.joined)]
        rates = [R / L for R in resistances]
        decays = [math.exp(-rate * span) for rate, span in zip(rates, spans, strict=True)]
        # Periodic solution: currents at the angles where a brush begins and ends to touch two bars.
        begin = (ends[1] * (1 - decays[1]) + decays[1] * ends[0] * (1 - decays[0])) / (1 - decays[0] * decays[1])
        middle = ends[0] + (begin - ends[0]) * decays[0]
        t = turn * motor.period / speed
        first = ends[0] + (begin - ends[0]) * np.exp(-rates[0] * t)
        second = ends[1] + (middle - ends[1]) * np.exp(-rates[1] * np.maximum(t - spans[0], 0.0))
        current = np.where(turn < motor.joined, first, second)
        charges = [
            end * span + (start - end) * (1 - decay) / rate
            for end, span, start, decay, rate in zip(ends, spans, (begin, middle), decays, rates, strict=True)
        ]
        mean = sum(charges) / sum(spans)
    return SteadyTorque(turn * motor.period, motor.torque_constant * current, motor.torque_constant * mean)
