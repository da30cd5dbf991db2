"""Coulomb friction: ``torque = -T sign(v)``, with ``sign(0) = 0``.

At every reversal the measured torque jumps by ``2 T``, whatever the position and the load.
URDF: ``<dynamics friction>``; MJCF: joint ``frictionloss``.
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
    torque_unit,
)
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.effects.support.rows import (
    dry_range,
    modelled_friction_of,
    on_any_joint,
    speed_of,
    torque_on_any_joint,
)


class CoulombFriction(Effect):
    """Coulomb friction of an active or passive joint."""

    name = "coulomb_friction"
    regime = "velocity_reversal"
    acts_as = "dry friction"
    changes_with = "friction"
    words = EffectWords(
        name="Coulomb friction",
        meaning="friction torque of constant size that opposes the motion",
        next_step="Add the torque to the joint's friction in the model; slow reversals in several postures confirm it.",
        less="less Coulomb friction than modelled",
        size="of {torque}",
        parameters={"torque": "friction torque at any speed"},
        shown_over=("velocity",),
    )

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """All joints, including the passive ones of a closed chain."""
        return (*robot.joint_names, *robot.passive_names)

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``torque``, which is T."""
        return (dry_range(robot, joint, "torque"),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column: the sign of the velocity."""
        s = np.sign(speed_of(robot, operation, joint))
        return on_any_joint(robot, operation, joint, torque=(s, torque_unit(robot, joint)))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bound: minus the modelled Coulomb torque, so that the sum is not negative."""
        return ((-modelled_friction_of(robot, joint)[1], np.inf),)

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """One term: the sign of the velocity."""
        return (FormulaTerm("friction", "sign(v)", lambda v: np.sign(v)),)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """``-T sign(v)`` on the joint."""
        return torque_on_any_joint(robot, operation, joint, -theta.item() * np.sign(speed_of(robot, operation, joint)))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The robot with this friction added, which sticks at rest."""
        return Simulated(robot=lambda moved: with_friction(moved, joint, coulomb=theta.item()))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The torque, which describes the effect completely."""
        return ModelNumbers(whole=True, coulomb=theta.item())
