"""Stribeck friction: ``-(Tc + (Ts - Tc) exp(-(v/vs)^2)) sign(v)``.

``Ts`` is the torque at rest, ``Tc`` the torque at high speed. Coulomb friction is the special case ``Ts = Tc``. Slow
constant speeds in both directions separate the two, because they show how the torque decreases with speed. URDF and
MJCF have a place for the torque at high speed only.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Law,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    SpecialCase,
    on_one_joint,
    row_of,
    torque_law,
    torque_on_joint,
    torque_unit,
    velocity_unit,
)
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.effects.support.rows import dry_range, modelled_friction_of

# Speed above which no joint is in mixed lubrication [rad/s, m/s].
_FASTEST, _FASTEST_LINEAR = 3.0, 0.5


class StribeckFriction(Effect):
    """Friction of one joint that decreases with speed after the joint starts to move."""

    name = "stribeck_friction"
    regime = "low_speed"
    acts_as = "dry friction"
    shows_with = "slow motion"
    words = EffectWords(
        name="Stribeck friction",
        meaning="friction that falls as the joint starts to move and then levels off",
        next_step="Record at least five slow constant speeds in both directions to fix the curve, then put it into "
        "the model.",
        size="that falls from {static_torque} to {coulomb_torque}",
        parameters={
            "coulomb_torque": "friction torque at speed",
            "static_torque": "friction torque as the motion begins",
            "stribeck_velocity": "speed at which about a third of the difference is left",
        },
        shown_over=("velocity",),
        kept="of Stribeck friction, the level at high speed",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Torque at high speed, torque at rest, and the velocity at which the difference has fallen to 1/e."""
        unit = velocity_unit(robot, joint)
        fastest = _FASTEST_LINEAR if unit == "m/s" else _FASTEST
        return (
            dry_range(robot, joint, "coulomb_torque"),
            dry_range(robot, joint, "static_torque"),
            Parameter(
                "stribeck_velocity",
                unit,
                0.0,
                plausible=(0.0, fastest),
                plausible_because="in a bearing or gear the film of lubricant already carries the load at a small "
                "share of its top speed",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Stribeck velocities from 2 % to 50 % of the top speed; others look like Coulomb or viscous friction."""
        top = float(np.percentile(np.abs(operation.v[:, row_of(robot, joint)]), 99))
        return tuple((float(x),) for x in np.geomspace(0.02, 0.5, 7) * max(top, 1e-9))

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The same Stribeck velocity, one a sixth smaller and one a sixth larger."""
        return tuple((factor * shape[0],) for factor in (0.85, 1.0, 1.18))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Two columns: ``sign(v)``, and ``sign(v) exp(-(v/vs)^2)``; ``shape`` is vs."""
        v, unit = operation.v[:, row_of(robot, joint)], torque_unit(robot, joint)
        s = np.sign(v)
        return on_one_joint(robot, joint, coulomb_torque=(s, unit), excess=(s * np.exp(-((v / shape[0]) ** 2)), unit))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """``Tc``, ``Ts`` (which is ``Tc`` plus the excess) and vs."""
        return np.array([coefficients[0], coefficients[0] + coefficients[1], shape[0]])

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bounds: minus the modelled torque for ``Tc``, and zero for the excess at rest."""
        return ((-modelled_friction_of(robot, joint)[1], np.inf), (0.0, np.inf))

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """Coulomb friction, if the excess at rest is zero."""
        return (SpecialCase(("coulomb_friction",), coefficients[1:2]),)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: torque at rest minus torque at high speed."""
        return "static_torque", np.array([0.0, 1.0])

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Stribeck friction on the joint; zero at rest."""
        v = operation.v[:, row_of(robot, joint)]
        level = theta[0] + (theta[1] - theta[0]) * np.exp(-((v / theta[2]) ** 2))
        return torque_on_joint(robot, joint, -level * np.sign(v))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Torque at rest as Coulomb friction of the robot, which sticks; its decrease with speed as a torque law."""
        row = row_of(robot, joint)
        law = Law(falling_law, row, (float(theta[1] - theta[0]), float(theta[2])))
        return Simulated(robot=lambda moved: with_friction(moved, joint, coulomb=theta[1]), laws=(law,))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The torque at high speed."""
        return ModelNumbers(coulomb=float(theta[0]))


@torque_law
@jit
def falling_law(v: float, fall: float, velocity: float) -> float:
    """Friction torque at rest minus that at velocity ``v``."""
    return fall * (1.0 - np.exp(-((v / velocity) ** 2))) * np.sign(v)
