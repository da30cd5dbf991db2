r"""Response of a force sensor between device and hand to the motor force, for a rigid device or one with two masses.

The sensor is between hand and body. If the hand has the impedance :math:`Z_h` and does not push, the sensor reads
:math:`F_u = -Z_h X_d`, and a motor force :math:`u` moves the body by

.. math:: \frac{X_d}{U} = \frac{k_c + b_c s}{p_r (p_d + Z_h) - (k_c + b_c s)^2}

for the two masses of `phantom_dyn.haptics.device.axis`, with the polynomials of the motor,
:math:`p_r = m_r s^2 + (b_r + b_c) s + k_c`, and of the body, :math:`p_d = m_d s^2 + (b_d + b_c) s + k_c`. For a rigid
device :math:`X_d / U = 1 / (m s^2 + b s + k + Z_h)`. With two masses the motor acts on one and the sensor measures at
the other, so that above the resonance the phase of the loop is 180 degrees lower than that of a rigid model. The sensor
has a first-order low pass, as in equation (31) of [Gil]_.

References:
    Equations (18), (30) and (31) of [Gil]_ (`phantom_dyn.haptics.device.axis`). The chapter models the vibration for
    walls (section 4). For force feedforward (section 5.1) its equations have no vibration; those here are derived.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import Operator, RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.transfer_function import StateSpace, TransferFunction
from phantom_dyn.number_checks import require_positive

Device = RigidAxis | TwoMassAxis


@dataclass(frozen=True)
class HeldDevice:
    """Device, hand and force sensor as one system.

    Its input is the motor force, and its output is the negative reading of the sensor.

    Attributes:
        device: Rigid device, or a device with two masses.
        hand: The hand that holds it.
        cutoff: Cut-off of the sensor's first-order low pass [rad/s].

    Raises:
        ParameterError: If nobody holds the device, or the cutoff is not above 0.
    """

    device: Device
    hand: Operator
    cutoff: float

    def __post_init__(self) -> None:
        require_positive(cutoff_of_the_sensor=self.cutoff)
        if self.hand.mass == 0 and self.hand.damping == 0 and self.hand.stiffness == 0:
            raise ParameterError("Nobody holds the device, so force feedforward has no loop: give an operator.")

    @property
    def transfer_function(self) -> TransferFunction:
        """Negative reading over the motor force, [N/N] or [N m/(N m)]."""
        numerator = np.trim_zeros(self.hand.polynomial(), "f")
        if isinstance(self.device, TwoMassAxis):
            cable = np.trim_zeros([self.device.cable_damping, self.device.cable_stiffness], "f")
            numerator = np.polymul(numerator, cable)
        held = self.device.held_by(self.hand).transfer_function.denominator
        return TransferFunction(numerator, np.polymul(held, [1.0 / self.cutoff, 1.0]))

    @property
    def state_space(self) -> StateSpace:
        """States: those of the held device, then the reading over `force_unit`."""
        mechanics = self.device.held_by(self.hand).state_space
        n = len(mechanics.B)
        force = self._hand_force(mechanics)
        A, B, C = np.zeros((n + 1, n + 1)), np.zeros(n + 1), np.zeros(n + 1)
        A[:n, :n], B[:n] = mechanics.A, mechanics.B
        A[n, :n], A[n, n] = self.cutoff * force[0] / self.force_unit, -self.cutoff
        B[n] = self.cutoff * force[1] / self.force_unit
        C[n] = -self.force_unit
        return StateSpace(A, B, C)

    @property
    def force_unit(self) -> float:
        """Force per unit of the last state [N/m or N m/rad], so that entries of the state matrix have similar sizes."""
        if isinstance(self.device, TwoMassAxis):
            return self.device.cable_stiffness
        return self.cutoff**2 * self.device.held_by(self.hand).mass

    @property
    def push(self) -> Float[Array, " n"]:
        """Derivative of the states under a unit force of the hand, shape ``(n,)``."""
        mechanics = self.device.held_by(self.hand).state_space
        pushed = np.zeros(len(mechanics.B) + 1)
        if isinstance(self.device, TwoMassAxis):
            held = self.device.held_by(self.hand)
            # States: positions of motor and body, then their velocities divided by the resonance.
            pushed[3] = 1.0 / (held.body_mass * held.free_frequency)
            share = self.hand.mass / held.body_mass
        else:
            # States: position and velocity, on which hand and motor act alike.
            pushed[1] = mechanics.B[1]
            share = self.hand.mass * mechanics.B[1]
        # The sensor reads the force of the hand less the force that moves the hand's own mass. A unit force changes the
        # latter at once by that mass times the acceleration.
        pushed[-1] = self.cutoff * (1.0 - share) / self.force_unit
        return pushed

    @property
    def tip(self) -> Float[Array, " n"]:
        """Row that gives the position of the body from the states, shape ``(n,)``."""
        row = np.zeros(len(self.state_space.B))
        row[1 if isinstance(self.device, TwoMassAxis) else 0] = 1.0
        return row

    def _hand_force(self, mechanics: StateSpace) -> tuple[Array, float]:
        """Reading before the low pass, ``-Z_h x_d``: row for the states, and factor of the motor force."""
        n = len(mechanics.B)
        place = np.zeros(n)
        place[1 if isinstance(self.device, TwoMassAxis) else 0] = 1.0
        speed = place @ mechanics.A
        acceleration, direct = speed @ mechanics.A, float(speed @ mechanics.B)
        hand = self.hand
        row = -(hand.mass * acceleration + hand.damping * speed + hand.stiffness * place)
        return row, -hand.mass * direct


def felt_impedance(
    device: Device, helped: Complex[Array, " k"] | float, frequency: Float[Array, " k"]
) -> Complex[Array, " k"]:
    r"""Impedance of the device at the hand, force over position [N/m], shape ``(k,)``.

    The motor force per force of the hand is :math:`G = K_f C(s)`, with the force gain :math:`K_f` and the response
    :math:`C(s)` of sensor, filter, hold and delay. The impedance is :math:`(m s^2 + b s + k) / (1 + G)` for a rigid
    device. For two masses it is :math:`p / (p_r + (k_c + b_c s) G)` with :math:`p = p_r p_d - (k_c + b_c s)^2` and the
    polynomials of the module; it approaches that of a rigid device for a stiff cable.

    Args:
        device: Rigid device, or a device with two masses, without a hand.
        helped: G, motor force per force of the hand, at the frequencies, shape ``(k,)``, or one number for all.
        frequency: Frequencies [rad/s], shape ``(k,)``.
    """
    s = 1j * frequency
    if isinstance(device, RigidAxis):
        return (device.mass * s**2 + device.damping * s + device.stiffness) / (1.0 + helped)
    cable = device.cable_damping * s + device.cable_stiffness
    motor = device.motor_mass * s**2 + device.motor_damping * s + cable
    both = np.polyval(device.transfer_function.denominator, s)
    return both / (motor + cable * helped)
