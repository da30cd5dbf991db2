"""Viscous friction: ``torque = -c v``.

The residual is proportional to velocity. No other effect on one joint is linear in ``v``; a delay under a
proportional controller looks similar, and motion with other accelerations separates the two.
URDF: ``<dynamics damping>``; MJCF: joint ``damping``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    FormulaTerm,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    damping_unit,
)
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.effects.support.rows import (
    modelled_friction_of,
    on_any_joint,
    speed_of,
    torque_on_any_joint,
    viscous_range,
)


class ViscousFriction(Effect):
    """Viscous friction of an active or passive joint."""

    name = "viscous_friction"
    regime = "high_speed"
    shows_with = "velocity"
    changes_with = "friction"
    words = EffectWords(
        name="viscous friction",
        meaning="friction torque that grows in proportion to speed",
        next_step=(
            "Add the coefficient to the joint's damping in the model, and record once cold and once warm: "
            "it changes with the lubricant's temperature."
        ),
        less="less viscous friction than modelled",
        size="of {coefficient}",
        parameters={"coefficient": "friction torque per unit of speed"},
        shown_over=("velocity",),
    )

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """All joints, including the passive ones of a closed chain."""
        return (*robot.joint_names, *robot.passive_names)

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``coefficient``, which is c."""
        return (viscous_range(robot, joint, "coefficient"),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column: the velocity."""
        v = speed_of(robot, operation, joint)
        return on_any_joint(robot, operation, joint, coefficient=(v, damping_unit(robot, joint)))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bound: minus the modelled coefficient, so that the sum is not negative."""
        return ((-modelled_friction_of(robot, joint)[0], np.inf),)

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """One term: the velocity."""
        return (FormulaTerm("damping", "v", lambda v: v, "{speed}"),)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """``-c v`` on the joint."""
        return torque_on_any_joint(robot, operation, joint, -theta.item() * speed_of(robot, operation, joint))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The robot with this friction added."""
        return Simulated(robot=lambda moved: with_friction(moved, joint, viscous=theta.item()))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The coefficient, which describes the effect completely."""
        return ModelNumbers(whole=True, viscous=theta.item())
