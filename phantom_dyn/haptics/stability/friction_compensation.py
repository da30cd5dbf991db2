r"""Compensation of weight and friction: the largest safe share of friction, the necessary dead zone, and dither.

A drive that pushes in the direction of motion with ``s (T sgn v + c v)`` makes a device easy to move. Two facts limit
this compensation.

Power: a force of at most :math:`f` supplies at most the power :math:`f |v|`, for any delay and any velocity estimator,
while dry friction :math:`T` takes the power :math:`T |v|`. With :math:`f \le T` no motion can grow. If the modelled
friction may be wrong by a share :math:`u`, the largest safe share ``s`` is :math:`1 / (1 + u)`; then up to
:math:`2u / (1 + u)` of the true friction remains. A force larger than the friction drives the device: a free device
reaches the speed at which viscous friction balances the excess; a device on a hand's spring :math:`k` oscillates with
an amplitude of :math:`4 (f - T) / (\pi b \omega)`, :math:`\omega = \sqrt{k / m}`.

Rest: before the device slips, dry friction acts as a spring of stiffness :math:`T / d` that takes nearly no power, so
that a force in the direction of motion makes the device tremble. So there is no force below a certain speed, the dead
zone. The dead zone must exceed the speed of the device's oscillation on this spring, :math:`\sqrt{T d / m}`, and the
smallest nonzero estimated speed, which is a step of the encoder over the window. The hand has to overcome the whole
friction to start from rest.

Dither removes this friction, too: a force of frequency :math:`\omega` and amplitude :math:`A > 4 T / \pi` keeps the
device moving at the speed :math:`V = \sqrt{A^2 - (4T/\pi)^2} / (m \omega)`. Dry friction then acts on slow motion as a
damper :math:`2 T / (\pi V)` (describing function of a relay).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.dynamics.tree_motion import project, tree_friction, tree_motion
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.number_checks import require_not_negative, require_positive, require_whole


@dataclass(frozen=True)
class FrictionCompensation:
    """A force in the direction of motion that compensates a share of the modelled friction.

    Attributes:
        share: Share of the modelled friction, see `largest_share`.
        dead_zone: Speed up to which there is no force [m/s or rad/s], see `least_dead_zone`.
        ramp: Range of speed above the dead zone over which the force rises to its full value [m/s or rad/s].

    Raises:
        ParameterError: If a number is negative or not finite.
    """

    share: float
    dead_zone: float
    ramp: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(share=self.share, dead_zone=self.dead_zone, ramp=self.ramp)

    def force(
        self, velocity: Float[Array, "*n"], coulomb: Float[Array, "*m"] | float, viscous: Float[Array, "*m"] | float
    ) -> Float[Array, "*n"]:
        """Force in the direction of the estimated velocities [N or N m], with the shape of ``velocity``.

        Args:
            velocity: Estimated velocities [m/s or rad/s].
            coulomb: Modelled dry friction [N or N m], one number or one per joint.
            viscous: Modelled viscous coefficients [N s/m or N m s/rad], one number or one per joint.
        """
        beyond = np.abs(velocity) - self.dead_zone
        risen = np.clip(beyond / self.ramp, 0.0, 1.0) if self.ramp > 0 else (beyond > 0).astype(float)
        return self.share * risen * (coulomb * np.sign(velocity) + viscous * velocity)


def largest_share(uncertainty: float) -> float:
    """Largest share of the modelled friction that never exceeds the true one: ``1 / (1 + u)``.

    Args:
        uncertainty: u, the share by which the modelled friction may be too large or too small (temperature, wear).
    """
    require_not_negative(uncertainty=uncertainty)
    return 1.0 / (1.0 + uncertainty)


def least_dead_zone(
    mass: float, coulomb: float, displacement: float, *, step: float = 0.0, window: int = 1, period: float = 1e-3
) -> float:
    """Speed [m/s or rad/s] below which friction must not be compensated.

    Args:
        mass: Mass or inertia [kg or kg m2].
        coulomb: Dry friction T [N or N m].
        displacement: Displacement d over which the friction rises before the device slips [m or rad].
        step: Step of the encoder [m or rad].
        window: Number of samples over which positions are differenced.
        period: Sampling period [s].

    Raises:
        ParameterError: If mass or period is not above 0, another number is negative, or the window is less than 1.
    """
    require_positive(mass=mass, period=period)
    require_not_negative(coulomb=coulomb, displacement=displacement, step=step)
    require_whole(1, window=window)
    return max(math.sqrt(coulomb * displacement / mass), step / (window * period))


def dithered_damping(mass: float, coulomb: float, *, amplitude: float, frequency: float) -> float:
    """Damping coefficient [N s/m or N m s/rad] of dry friction for motion that is slow compared with a dither.

    Args:
        mass: Mass or inertia [kg or kg m2].
        coulomb: Dry friction T [N or N m].
        amplitude: Amplitude of the dither's force [N or N m].
        frequency: Frequency of the dither [rad/s].

    Raises:
        ParameterError: If the dither is too weak to overcome the friction.
    """
    require_positive(mass=mass, amplitude=amplitude, frequency=frequency)
    require_not_negative(coulomb=coulomb)
    least = 4.0 * coulomb / math.pi
    if amplitude <= least:
        raise ParameterError(
            f"A dither of {amplitude:g} does not keep a device with a dry friction of {coulomb:g} moving: give more "
            f"than {least:.3g}."
        )
    speed = math.sqrt(amplitude**2 - least**2) / (mass * frequency)
    return 2.0 * coulomb / (math.pi * speed)


def assisting_torque(
    robot: Robot, q: Float[Array, "N nv"], v: Float[Array, "N nv"], compensation: FrictionCompensation
) -> Float[Array, "N nv"]:
    """Drive torque that compensates weight and a share of the modelled friction, shape ``(N, nv)`` [N m or N].

    Friction of passive joints of a closed chain is compensated too, each according to its own speed. So the power
    supplied for a joint is at most this share of the power that its friction takes.

    Args:
        robot: Robot with its modelled friction.
        q: Measured joint positions [rad or m], shape ``(N, nv)``.
        v: Estimated joint velocities [rad/s or m/s], shape ``(N, nv)``.
        compensation: Share and dead zone, the same for all joints.

    Raises:
        ParameterError: If positions or velocities do not have one row per sample and one column per joint.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    if q.ndim != 2 or q.shape[1] != robot.nv or v.shape != q.shape:
        raise ParameterError(
            f"Positions of shape {q.shape} and velocities of shape {v.shape} were given, wanted (N, {robot.nv}) of "
            "both: give a row per sample, as in [q] and [v] for one."
        )
    tree = tree_motion(robot, Motion(np.arange(float(len(q))), q, v, np.zeros_like(v)))
    viscous, coulomb = tree_friction(robot)
    return gravity_torque(robot, q) + project(tree.G, compensation.force(tree.v, coulomb, viscous))
