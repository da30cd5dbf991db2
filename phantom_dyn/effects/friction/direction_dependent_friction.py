"""Friction that differs by direction: ``-(T+ + c+ v)`` for ``v > 0``, ``T- - c- v`` for ``v < 0``.

Coulomb friction, viscous friction and a torque offset are special cases. If the viscous coefficients are equal, the law
equals Coulomb and viscous friction plus an offset, so that no data can separate the two explanations.
URDF and MJCF have a place for the mean of both directions only; in MJCF half the difference of the torques can be
``biasprm`` of the actuator.
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
    damping_unit,
    on_one_joint,
    row_of,
    torque_law,
    torque_on_joint,
    torque_unit,
)
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.effects.support.rows import dry_range, modelled_friction_of, viscous_range


class DirectionDependentFriction(Effect):
    """Friction of one joint that differs by direction."""

    name = "direction_dependent_friction"
    regime = "one_direction"
    acts_as = "dry friction"
    words = EffectWords(
        name="direction-dependent friction",
        meaning="friction that is larger in one direction than in the other",
        next_step=(
            "Put both directions into the model, and look at the drive for a cause that prefers one direction "
            "(cable, seal, amplifier offset)."
        ),
        less="less friction than modelled, by direction",
        size="of {torque_positive} forward and {torque_negative} backward",
        parameters={
            "torque_positive": "constant friction torque in the positive direction",
            "torque_negative": "constant friction torque in the negative direction",
            "coefficient_positive": "friction torque per unit of speed in the positive direction",
            "coefficient_negative": "friction torque per unit of speed in the negative direction",
        },
        shown_over=("velocity",),
        kept="of friction that depends on direction, the mean of both",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Torque and viscous coefficient of each direction."""
        return (
            dry_range(robot, joint, "torque_positive"),
            dry_range(robot, joint, "torque_negative"),
            viscous_range(robot, joint, "coefficient_positive"),
            viscous_range(robot, joint, "coefficient_negative"),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Four columns: the sign of the velocity for each direction, then the velocity for each direction."""
        v = operation.v[:, row_of(robot, joint)]
        torque, damping = torque_unit(robot, joint), damping_unit(robot, joint)
        forward, backward = (v > 0).astype(float), (v < 0).astype(float)
        return on_one_joint(
            robot,
            joint,
            torque_positive=(forward, torque),
            torque_negative=(-backward, torque),
            coefficient_positive=(forward * v, damping),
            coefficient_negative=(backward * v, damping),
        )

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bounds: minus the modelled friction, so that the sum is not negative in either direction."""
        viscous, coulomb = modelled_friction_of(robot, joint)
        return ((-coulomb, np.inf), (-coulomb, np.inf), (-viscous, np.inf), (-viscous, np.inf))

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """Coulomb friction, viscous friction, or their sum, each without difference between the directions.

        Coulomb friction with an offset is not among them, because it is the same law under another name.
        """
        torque, viscous = coefficients[0] - coefficients[1], coefficients[2] - coefficients[3]
        return (
            SpecialCase(("coulomb_friction",), np.array([torque, *coefficients[2:]])),
            SpecialCase(("viscous_friction",), np.array([*coefficients[:2], viscous])),
            SpecialCase(("coulomb_friction", "viscous_friction"), np.array([torque, viscous])),
        )

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: the viscous coefficient of one direction, which no simpler law has."""
        return "coefficient_positive", np.array([0.0, 0.0, 1.0, 0.0])

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Friction for the direction of motion; zero at rest."""
        v = operation.v[:, row_of(robot, joint)]
        law = np.where(v > 0, -(theta[0] + theta[2] * v), np.where(v < 0, theta[1] - theta[3] * v, 0.0))
        return torque_on_joint(robot, joint, law)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Mean Coulomb torque as friction of the robot, which sticks at rest; the remainder as a torque law."""
        row = row_of(robot, joint)
        mean, half = 0.5 * (theta[0] + theta[1]), 0.5 * (theta[0] - theta[1])
        law = Law(two_way_law, row, (float(half), float(theta[2]), float(theta[3])))
        return Simulated(robot=lambda moved: with_friction(moved, joint, coulomb=mean), laws=(law,))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The mean of both directions, and half the difference of the torques as an offset."""
        return ModelNumbers(
            viscous=float(0.5 * (theta[2] + theta[3])),
            coulomb=float(0.5 * (theta[0] + theta[1])),
            offset=-0.5 * float(theta[0] - theta[1]),
        )


@torque_law
@jit
def two_way_law(v: float, half: float, positive: float, negative: float) -> float:
    """Torque in addition to the mean Coulomb torque: half the difference of both torques, and viscous friction."""
    return -half - (positive if v > 0 else negative) * v
