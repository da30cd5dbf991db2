r"""Compensation of weight and friction: how much friction a drive may take away, the dead zone that this needs, dither.

A drive that pushes along with ``s (T sgn v + c v)`` makes a device light to move. Two facts bound the share ``s``.

Power: a force of at most :math:`f` puts in at most :math:`f |v|`, however late its sign and however it is estimated,
and dry friction :math:`T` takes :math:`T |v|`. With :math:`f \le T` nothing can grow, at any delay. If the model of the
friction may be wrong by a share :math:`u`, the largest safe share of it is :math:`1 / (1 + u)`; up to
:math:`2u / (1 + u)` of the true friction is then left. What is more than the friction drives the device: free, to the
speed at which viscous friction takes it; on a hand's spring :math:`k`, to a swing of
:math:`4 (f - T) / (\pi b \omega)`, :math:`\omega = \sqrt{k / m}`.

Rest: before it slips, dry friction yields as a spring of stiffness :math:`T / d` that takes next to nothing, so that a
force along with the speed makes the device tremble there. Below a dead zone of speed there is none: its own swing on
that spring reaches :math:`\sqrt{T d / m}`, and an estimate of speed jumps by a step of the encoder over its window. The
hand still has to break the whole friction to start from rest. Dither does not leave that: a force of frequency
:math:`\omega` and amplitude :math:`A > 4 T / \pi` keeps the device moving at the speed
:math:`V = \sqrt{A^2 - (4T/\pi)^2} / (m \omega)`, and dry friction acts on slow motion as a damper
:math:`2 T / (\pi V)` (describing function of a relay).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.dynamics.tree_motion import project, tree_friction, tree_motion
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.number_checks import require_columns, require_not_negative, require_positive, require_whole
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion, ReadOnlyArrays

_SUBSTEPS = 50
"""Steps of a sample: the spring of the friction swings at some 50 Hz, a sample is a millisecond."""


@dataclass(frozen=True)
class FrictionCompensation:
    """A force along with the speed that takes a share of modelled friction away.

    Attributes:
        share: Of the modelled friction, see `largest_share`.
        dead_zone: Speed up to which nothing is given [m/s or rad/s], see `least_dead_zone`.
        ramp: Further speed over which it rises to the whole; 0 for a jump.

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
        """Force along with the estimated velocities [N or N m], of their shape.

        Args:
            velocity: Estimates [m/s or rad/s].
            coulomb: Modelled dry friction [N or N m], one number or one a joint.
            viscous: Modelled viscous coefficients.
        """
        beyond = np.abs(velocity) - self.dead_zone
        risen = np.clip(beyond / self.ramp, 0.0, 1.0) if self.ramp > 0 else (beyond > 0).astype(float)
        return self.share * risen * (coulomb * np.sign(velocity) + viscous * velocity)


def largest_share(uncertainty: float) -> float:
    """Largest share of modelled friction that is never more than the true one: ``1 / (1 + u)``.

    Args:
        uncertainty: By which share of the true friction the modelled one may be wrong, either way (temperature, wear).
    """
    require_not_negative(uncertainty=uncertainty)
    return 1.0 / (1.0 + uncertainty)


def friction_left(share: float, uncertainty: float) -> tuple[float, float]:
    """Least and most of the true friction that a share of the modelled one leaves; negative: it drives the device.

    Args:
        share: Of the modelled friction.
        uncertainty: By which share of the true friction the modelled one may be wrong, at most 1.

    Raises:
        ParameterError: If a number is negative, or the uncertainty above 1.
    """
    require_not_negative(share=share, uncertainty=uncertainty)
    if uncertainty > 1:
        raise ParameterError(f"The uncertainty of the friction is {uncertainty:g}: give a share of 0 to 1.")
    return 1.0 - share * (1.0 + uncertainty), 1.0 - share * (1.0 - uncertainty)


def least_dead_zone(
    mass: float, coulomb: float, displacement: float, *, step: float = 0.0, window: int = 1, period: float = 1e-3
) -> float:
    """Speed [m/s or rad/s] below which no friction may be compensated.

    Args:
        mass: [kg or kg m2].
        coulomb: Dry friction T [N or N m].
        displacement: d [m or rad] over which it rises before the device slips.
        step: Of the encoder [m or rad].
        window: Samples over which positions are differenced for the speed.
        period: Sampling period [s].

    Raises:
        ParameterError: If a number cannot be.
    """
    require_positive(mass=mass, period=period)
    require_not_negative(coulomb=coulomb, displacement=displacement, step=step)
    require_whole(1, window=window)
    return max(math.sqrt(coulomb * displacement / mass), step / (window * period))


def dithered_damping(mass: float, coulomb: float, *, amplitude: float, frequency: float) -> float:
    """Coefficient [N s/m or N m s/rad] with which dry friction acts on motion that is slow beside a dither.

    Args:
        mass: [kg or kg m2].
        coulomb: Dry friction T [N or N m].
        amplitude: Of the dither's force [N or N m].
        frequency: Of the dither [rad/s].

    Raises:
        ParameterError: If the dither does not break the friction.
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
    """Drive torque that takes weight and a share of the modelled friction away, shape ``(N, nv)`` [N m or N].

    Friction of passive joints of a closed chain is compensated at the speed of each: the power that is put in at a
    joint is never more than a share of what its friction takes.

    Args:
        robot: Gives weights and friction.
        q: Measured joint positions [rad or m].
        v: Estimated joint velocities.
        compensation: Share and dead zone, the same for all joints.

    Raises:
        ParameterError: If positions or velocities are not a row a sample and a column a joint.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    if q.ndim != 2 or q.shape[1] != robot.nv or v.shape != q.shape:
        raise ParameterError(
            f"Positions of shape {q.shape} and velocities of shape {v.shape} were given, wanted (N, {robot.nv}) of "
            "both: give a row a sample, as in [q] and [v] for one."
        )
    tree = tree_motion(robot, Motion(np.arange(float(len(q))), q, v, np.zeros_like(v)))
    viscous, coulomb = tree_friction(robot)
    return gravity_torque(robot, q) + project(tree.G, compensation.force(tree.v, coulomb, viscous))


@dataclass(frozen=True)
class DryFriction:
    """True friction of an axis: it rises over a displacement before the device slips (Dahl).

    Attributes:
        torque: In slip [N or N m].
        displacement: [m or rad].

    Raises:
        ParameterError: If a number is not above 0.
    """

    torque: float
    displacement: float

    def __post_init__(self) -> None:
        require_positive(torque=self.torque, displacement=self.displacement)


@dataclass(frozen=True)
class Sampling:
    """How an axis is sampled.

    Attributes:
        period: [s].
        delay: Samples by which the force is late.
        window: Samples over which positions are differenced.
        step: Of the encoder [m or rad], 0 for none.

    Raises:
        ParameterError: If a number cannot be.
    """

    period: float = 1e-3
    delay: int = 0
    window: int = 1
    step: float = 0.0

    def __post_init__(self) -> None:
        require_positive(period=self.period)
        require_whole(0, delay=self.delay)
        require_whole(1, window=self.window)
        require_not_negative(step=self.step)


@dataclass(frozen=True)
class CompensatedMotion(ReadOnlyArrays):
    """What a compensated axis does.

    Attributes:
        t: Times of the samples [s], shape ``(N,)``.
        position: [m or rad], shape ``(N,)``.
        velocity: True one, shape ``(N,)``.
        force: Of the compensation [N or N m], shape ``(N,)``.
    """

    t: Float[Array, " N"]
    position: Float[Array, " N"]
    velocity: Float[Array, " N"]
    force: Float[Array, " N"]

    @property
    def swing(self) -> float:
        """Half the way between the ends of the motion in the last third [m or rad], when the start has died out."""
        return 0.5 * float(np.ptp(self.position[-(len(self.t) // 3) :]))


def simulate_compensation(
    axis: RigidAxis,
    friction: DryFriction,
    compensation: FrictionCompensation,
    modelled: tuple[float, float],
    sampling: Sampling,
    hand: Float[Array, " N"],
    *,
    speed: float = 0.0,
) -> CompensatedMotion:
    """An axis whose friction is compensated at samples, in time.

    Args:
        axis: Mass, viscous friction, and the spring of a hand.
        friction: Its true dry friction.
        compensation: What is given.
        modelled: Dry friction and viscous coefficient of the model.
        sampling: Period, delay, encoder and window.
        hand: Force of the hand at each sample, held [N or N m].
        speed: At the start [m/s or rad/s], from position zero.

    Raises:
        ParameterError: If a number is not finite.
    """
    require_columns(len(hand), force_of_the_hand=hand)
    require_not_negative(modelled_friction=modelled[0], modelled_coefficient=modelled[1], speed=abs(speed))
    out = np.zeros((3, len(hand)))
    numbers = np.array(
        [
            *(axis.mass, axis.damping, axis.stiffness, friction.torque, friction.displacement),
            *(compensation.share * modelled[0], compensation.share * modelled[1]),
            *(compensation.dead_zone, compensation.ramp, sampling.period, sampling.step, speed),
        ]
    )
    _run(numbers, sampling.delay, sampling.window, np.ascontiguousarray(hand, dtype=float), out)
    return CompensatedMotion(np.arange(len(hand)) * sampling.period, *out)


@jit
def _run(numbers: Array, delay: int, window: int, hand: Array, out: Array) -> None:
    """Write position, velocity and force of each sample."""
    mass, damping, stiffness, torque, displacement = numbers[:5]
    dry, viscous, dead, ramp, period, step, v = numbers[5:]
    N, dt = len(hand), period / _SUBSTEPS
    x, bristle, reading = 0.0, 0.0, np.zeros(N)
    asked = np.zeros(N)
    for k in range(N):
        reading[k] = np.round(x / step) * step if step > 0 else x
        # Before the first sample the device stood: a window that is not full sees less than the speed.
        rate = (reading[k] - (reading[k - window] if k >= window else 0.0)) / (window * period)
        beyond = abs(rate) - dead
        risen = min(max(beyond / ramp, 0.0), 1.0) if ramp > 0 else (1.0 if beyond > 0 else 0.0)
        asked[k] = risen * (dry * np.sign(rate) + viscous * rate)
        force = asked[k - delay] if k >= delay else 0.0
        out[0, k], out[1, k], out[2, k] = x, v, force
        for _ in range(_SUBSTEPS):
            v += dt / mass * (force + hand[k] - damping * v - stiffness * x - torque * bristle)
            x += dt * v
            end = np.sign(v)
            bristle = end + (bristle - end) * np.exp(-abs(v) * dt / displacement)
