r"""Models of one axis of a haptic device: a rigid mass, or a motor and a body with a cable between them; and the hand.

The two-mass model is (18) of the chapter: motor :math:`m_r` and body :math:`m_d` have dampers to ground, and a spring
:math:`k_c` and a damper :math:`b_c` between them. The encoder measures the motor, so that stability depends on the
transfer function from motor force to motor position.

All equations hold for a rotating axis as well, with inertias, N m s/rad and N m/rad. The hand is a mass on a spring and
a damper.

References:
    .. [Gil] J. J. Gil et al., chapter on stability and transparency in "Advances in Haptics", 2010, equations (18) to
       (24). The available copy lacks (19), (23) and (24), which are derived here and checked by tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.transfer_function import StateSpace, TransferFunction
from phantom_dyn.number_checks import require_not_negative, require_positive


@dataclass(frozen=True)
class RigidAxis:
    """A mass with a damper to ground, and a spring to ground if a hand holds it.

    Attributes:
        mass: Mass or inertia [kg or kg m2].
        damping: Damping to ground [N s/m or N m s/rad].
        stiffness: Stiffness of a spring to ground [N/m or N m/rad]; 0 unless a hand holds the device.

    Raises:
        ParameterError: If the mass is not positive, or damping or stiffness is negative.
    """

    mass: float
    damping: float
    stiffness: float = 0.0

    def __post_init__(self):
        require_positive("the axis", mass=self.mass)
        require_not_negative("the axis", damping=self.damping, stiffness=self.stiffness)

    @property
    def transfer_function(self) -> TransferFunction:
        """``1 / (m s^2 + b s + k)``."""
        return TransferFunction(np.array([1.0]), np.array([self.mass, self.damping, self.stiffness]))

    @property
    def state_space(self) -> StateSpace:
        """States: position and velocity."""
        A = np.array([[0.0, 1.0], [-self.stiffness / self.mass, -self.damping / self.mass]])
        return StateSpace(A, np.array([0.0, 1.0 / self.mass]), np.array([1.0, 0.0]))

    def rest(self, position: float) -> np.ndarray:
        """State of a device at rest at ``position`` [m or rad], shape ``(2,)``."""
        return np.array([position, 0.0])

    def damped(self, damping: float) -> RigidAxis:
        """The axis with more damping to ground."""
        return replace(self, damping=self.damping + damping)

    def held_by(self, hand: Operator) -> RigidAxis:
        """The axis with the operator's mass, damper and spring added."""
        return RigidAxis(self.mass + hand.mass, self.damping + hand.damping, self.stiffness + hand.stiffness)

    @property
    def rigid(self) -> RigidAxis:
        """The axis itself, which is rigid."""
        return self


@dataclass(frozen=True)
class TwoMassAxis:
    """Motor and body with a cable between them.

    Attributes:
        motor_mass: :math:`m_r` [kg or kg m2], with everything that is fixed to the motor.
        body_mass: :math:`m_d` [kg or kg m2].
        motor_damping: :math:`b_r` to ground [N s/m or N m s/rad].
        body_damping: :math:`b_d` to ground [N s/m or N m s/rad].
        cable_stiffness: :math:`k_c` [N/m or N m/rad].
        cable_damping: :math:`b_c` [N s/m or N m s/rad].
        ground_stiffness: Stiffness of a spring from the body to ground [N/m or N m/rad]; 0 unless a hand holds it.

    Raises:
        ParameterError: If a mass or the cable's stiffness is not positive, or another value is negative.
    """

    motor_mass: float
    body_mass: float
    motor_damping: float
    body_damping: float
    cable_stiffness: float
    cable_damping: float
    ground_stiffness: float = 0.0

    def __post_init__(self):
        positive = ("motor_mass", "body_mass", "cable_stiffness")
        require_positive("the axis", **{name: getattr(self, name) for name in positive})
        others = ("motor_damping", "body_damping", "cable_damping", "ground_stiffness")
        require_not_negative("the axis", **{name: getattr(self, name) for name in others})

    @property
    def transfer_function(self) -> TransferFunction:
        """:math:`G_r = p_d / p`, motor position over motor force.

        Here :math:`p_r = m_r s^2 + (b_r + b_c) s + k_c`, :math:`p_d = m_d s^2 + (b_d + b_c) s + k_c` and
        :math:`p = p_r p_d - (k_c + b_c s)^2`. The stiffness of a spring from the body to ground is added to
        :math:`p_d`.
        """
        mr, md, br, bd = self.motor_mass, self.body_mass, self.motor_damping, self.body_damping
        k, b, kg = self.cable_stiffness, self.cable_damping, self.ground_stiffness
        # In the form p_r p_d - (k + b s)^2 terms would cancel with rounding errors; this expanded form avoids them.
        denominator = np.array(
            [
                mr * md,
                mr * (bd + b) + md * (br + b),
                (mr + md) * k + mr * kg + br * bd + b * (br + bd),
                k * (br + bd) + kg * (br + b),
                k * kg,
            ]
        )
        return TransferFunction(np.array([md, bd + b, k + kg]), denominator)

    @property
    def state_space(self) -> StateSpace:
        """States: positions of motor and body, and their velocities divided by the resonance, for similar sizes."""
        mr, md, k, b = self.motor_mass, self.body_mass, self.cable_stiffness, self.cable_damping
        w = self.free_frequency
        A = np.zeros((4, 4))
        A[0, 2] = A[1, 3] = w
        A[2] = np.array([-k / w, k / w, -(self.motor_damping + b), b]) / mr
        A[3] = np.array([k / w, -(k + self.ground_stiffness) / w, b, -(self.body_damping + b)]) / md
        return StateSpace(A, np.array([0.0, 0.0, 1.0 / (mr * w), 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))

    def rest(self, position: float) -> np.ndarray:
        """State of a device at rest at ``position`` [m or rad] with a slack cable, shape ``(4,)``."""
        return np.array([position, position, 0.0, 0.0])

    def damped(self, damping: float) -> TwoMassAxis:
        """The axis with more damping to ground at the motor."""
        return replace(self, motor_damping=self.motor_damping + damping)

    def held_by(self, hand: Operator) -> TwoMassAxis:
        """The axis with the operator's mass, damper and spring added to the body."""
        return replace(
            self,
            body_mass=self.body_mass + hand.mass,
            body_damping=self.body_damping + hand.damping,
            ground_stiffness=self.ground_stiffness + hand.stiffness,
        )

    @property
    def rigid(self) -> RigidAxis:
        """The device with a rigid cable: the sums of both masses and of both dampings."""
        return RigidAxis(
            self.motor_mass + self.body_mass, self.motor_damping + self.body_damping, self.ground_stiffness
        )

    @property
    def free_frequency(self) -> float:
        r"""Resonance :math:`\omega_n` of the two masses on the undamped cable, (22) [rad/s]."""
        return math.sqrt(self.cable_stiffness * (1.0 / self.motor_mass + 1.0 / self.body_mass))

    @property
    def blocked_frequency(self) -> float:
        """Anti-resonance [rad/s]: the body swings on the cable while the motor is at rest."""
        return math.sqrt((self.cable_stiffness + self.ground_stiffness) / self.body_mass)

    @property
    def peak_distance(self) -> float:
        r"""Distance Q [dB] of the resonant peak from 0 dB, (23), for a lightly damped cable.

        :math:`20 \log_{10}\{\omega_n [b_c ((m_r + m_d)/m_d)^2 + b_r + b_d (m_r/m_d)^2]\}`. The chapter says that the
        vibration affects stability if Q is "similar or larger" than the gain margin of the linear condition; because Q
        is a distance to 0 dB, it must be similar or *smaller*.
        """
        ratio = self.motor_mass / self.body_mass
        damping = self.cable_damping * (1 + ratio) ** 2 + self.motor_damping + self.body_damping * ratio**2
        return 20.0 * math.log10(self.free_frequency * damping)


@dataclass(frozen=True)
class Operator:
    r"""Impedance of a human operator, force over position: :math:`Z_h(s) = m_h s^2 + b_h s + k_h`.

    Equation (30) of Gil et al. (2010, "Advances in Haptics", chapter on stability and transparency).

    Attributes:
        mass: :math:`m_h` [kg, or kg m2 about a joint].
        damping: :math:`b_h` [N s/m, or N m s/rad].
        stiffness: :math:`k_h` [N/m, or N m/rad].

    Raises:
        ParameterError: If a value is negative or not finite.
    """

    mass: float
    damping: float
    stiffness: float

    def __post_init__(self) -> None:
        require_not_negative("the operator", mass=self.mass, damping=self.damping, stiffness=self.stiffness)

    def polynomial(self) -> Float[Array, "3"]:
        """Coefficients of the impedance in falling powers of s, ``[m_h, b_h, k_h]``."""
        return np.array([self.mass, self.damping, self.stiffness], dtype=np.float64)

    def impedance(self, frequency: Float[Array, " n"]) -> Complex[Array, " n"]:
        """Force over position [N/m] at the frequencies [rad/s], shape ``(n,)``."""
        return np.polyval(self.polynomial(), 1j * frequency)


def masses_from_resonance(total: float, stiffness: float, resonance: float) -> tuple[float, float]:
    """Two masses, the lighter first, from their sum and their resonance on a spring between them, (22).

    Args:
        total: Sum of both [kg or kg m2].
        stiffness: Stiffness of the spring between them [N/m or N m/rad].
        resonance: Frequency of their resonance [rad/s].

    Raises:
        ParameterError: If a value is not above 0, or the resonance is lower than that of two equal masses.
    """
    require_positive(total_of_both_masses=total, stiffness=stiffness, resonance=resonance)
    reduced = stiffness / resonance**2
    if not 0 < 4 * reduced <= total:
        raise ParameterError(
            f"No two masses of {total:g} together swing on a spring of {stiffness:g} at {resonance:g} rad/s: "
            f"give a resonance of {2 * math.sqrt(stiffness / total):g} rad/s or more."
        )
    # Solutions of m^2 - total m + reduced total = 0; the smaller one in a form without cancellation.
    half = 0.5 * total
    half_difference = math.sqrt(half**2 - reduced * total)
    return reduced * total / (half + half_difference), half + half_difference


YOKOKOHJI_YOSHIKAWA = Operator(2.0, 2.0, 10.0)
"""2 kg, 2 N s/m, 10 N/m, as commonly cited after Yokokohji and Yoshikawa (1994).

The chapter refers to this operator without printing numbers.
"""
