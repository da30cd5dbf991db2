r"""Cogging of a brush motor that comes from its amplifier: brushes change the winding's resistance as they switch.

Cavusoglu, Feygin and Tendick (2002, section 4.1.1): "when these brushes switch, the resistance of the windings changes.
If the amplifier regulates voltage, the change in resistance causes a change in the current, and thus a change in the
motor torque. This is called cogging"; under a current amplifier there is none. The paper has no equations; these are
those of a lap winding.

A commutator of n bars, n odd, closes n equal coils into a ring. With both brushes on one bar each the ring is parted
into :math:`(n-1)/2` and :math:`(n+1)/2` coils; while a brush joins two bars one coil is shorted and the rest parts
evenly. The resistances are as :math:`1` to

.. math:: \frac{n}{n + 1},

:math:`2n` times a revolution. A held voltage so gives a torque that is higher by :math:`1/n` while a brush joins two
bars; it is proportional to the command, unlike cogging by magnets (`phantom_dyn.effects.drive.cogging`). The winding's
inductance smooths it where the motor turns fast: :math:`L\,di/dt = U - k\,\omega - R(\theta)\,i`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.drives import Winding
from phantom_dyn.haptics.number_checks import require_numbers, require_positive, require_whole

_POINTS = 400
"""Points of one switching period that a steady torque is given at."""


@dataclass(frozen=True)
class BrushMotor:
    """A motor with brushes.

    Attributes:
        winding: Resistance with both brushes on one bar each, and inductance.
        torque_constant: [N m/A], which is its back-EMF constant, too [V s/rad].
        bars: Of the commutator, an odd number from 3 on.
        joined: Share of the angle in which a brush joins two bars, between 0 and 1.

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
        """Angle from one switching to the next, at either brush [rad]."""
        return math.pi / self.bars

    @property
    def joined_resistance(self) -> float:
        """Of the winding while a brush joins two bars [ohm]."""
        return self.winding.resistance * self.bars / (self.bars + 1)

    def resistance(self, angle: Float[Array, " N"]) -> Float[Array, " N"]:
        """Of the winding at the angles of the rotor [rad], shape ``(N,)``; at 0 a brush is in the middle of joining."""
        place = np.mod(np.asarray(angle) / self.period + 0.5 * self.joined, 1.0)
        return np.where(place < self.joined, self.joined_resistance, self.winding.resistance)


@dataclass(frozen=True)
class SteadyTorque:
    """Torque of a motor that turns at a constant speed, over one switching period.

    Attributes:
        angle: Of the rotor from where a brush begins to join [rad], shape ``(n,)``.
        torque: Under a held voltage [N m], shape ``(n,)``.
        mean: Mean of it over the angle, which a current amplifier would give without any change [N m].
    """

    angle: Float[Array, " n"]
    torque: Float[Array, " n"]
    mean: float

    @property
    def ripple(self) -> float:
        """Largest less smallest torque over the mean."""
        return float(np.ptp(self.torque)) / abs(self.mean)


def steady_torque(motor: BrushMotor, *, speed: float, voltage: float) -> SteadyTorque:
    """Torque under a held voltage at a constant speed, the winding's inductance included.

    Args:
        motor: With brushes.
        speed: Of the rotor, above 0 [rad/s].
        voltage: [V].

    Raises:
        ParameterError: If the speed is not above 0, or the voltage is that of the motor's own back-EMF.
    """
    require_positive(speed_of_the_rotor=speed)
    require_numbers(voltage=voltage)
    left = voltage - motor.torque_constant * speed
    if left == 0:
        raise ParameterError(
            f"At {speed:g} rad/s the motor gives {voltage:g} V itself, so no current flows: give another voltage."
        )
    turn, L = np.linspace(0.0, 1.0, _POINTS + 1), motor.winding.inductance
    resistances = (motor.joined_resistance, motor.winding.resistance)
    ends = [left / R for R in resistances]
    if L == 0:
        current = np.where(turn < motor.joined, *ends)
        mean = motor.joined * ends[0] + (1 - motor.joined) * ends[1]
    else:
        spans = [share * motor.period / speed for share in (motor.joined, 1 - motor.joined)]
        rates = [R / L for R in resistances]
        kept = [math.exp(-rate * span) for rate, span in zip(rates, spans, strict=True)]
        # Periodic: what the current is where a brush begins to join, and where it ends.
        begin = (ends[1] * (1 - kept[1]) + kept[1] * ends[0] * (1 - kept[0])) / (1 - kept[0] * kept[1])
        middle = ends[0] + (begin - ends[0]) * kept[0]
        t = turn * motor.period / speed
        first = ends[0] + (begin - ends[0]) * np.exp(-rates[0] * t)
        second = ends[1] + (middle - ends[1]) * np.exp(-rates[1] * np.maximum(t - spans[0], 0.0))
        current = np.where(turn < motor.joined, first, second)
        charges = [
            end * span + (start - end) * (1 - keep) / rate
            for end, span, start, keep, rate in zip(ends, spans, (begin, middle), kept, rates, strict=True)
        ]
        mean = sum(charges) / sum(spans)
    return SteadyTorque(turn * motor.period, motor.torque_constant * current, motor.torque_constant * mean)
