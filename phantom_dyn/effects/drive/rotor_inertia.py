"""Rotor inertia that the model lacks, on the joint side of the gear: ``torque = -I a``.

Its torque is proportional to the joint's own acceleration, and gravity does not act on it. On the first joint, and on
every other joint where only its sum with the link inertia can be identified, the two cannot be separated.
URDF has no place for it; MJCF: joint ``armature``.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    inertia_unit,
    on_one_joint,
    row_of,
    torque_on_joint,
)
from phantom_dyn.effects.support.changed_robot import with_rotor_inertia

# Smallest acceleration that a drive can give to its own rotor [rad/s^2]: a third of the smallest value in the public
# models of docs/plausible_ranges.md.
_SLOWEST = 10.0


class RotorInertia(Effect):
    """Rotor inertia of one joint that the model lacks."""

    name = "rotor_inertia"
    regime = "high_acceleration"
    built_in = True
    made_of = ("acceleration",)
    acts_as = "drive"
    shows_with = "acceleration"
    exact = True
    words = EffectWords(
        name="rotor inertia",
        meaning="inertia of motor and gear that acts on this joint alone",
        next_step=(
            "Add it to the joint's rotor inertia (armature), and compare with the data sheet: rotor inertia times gear "
            "ratio squared."
        ),
        less="less rotor inertia than modelled",
        size="of {inertia}",
        parameters={"inertia": "inertia of motor and gear on the joint side"},
        shown_over=("acceleration",),
        separated_by="data sheet",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``inertia``, which is I."""
        row = row_of(robot, joint)
        modelled, strongest = float(robot.rotor_inertia[row]), robot.actuators[row].torque_limit
        most, because = np.inf, "behind a gear the rotor counts with its ratio squared, often more than the link"
        if strongest is not None and not robot.prismatic[row]:
            most = strongest / _SLOWEST - modelled
            because = (
                f"the drive, which gives {strongest:.3g} N m, could not move a heavier rotor by {_SLOWEST:g} rad/s^2"
            )
        return (
            Parameter(
                "inertia",
                inertia_unit(robot, joint),
                0.0 - modelled,
                plausible=(0.0 - modelled, max(most, 0.0)),
                plausible_because=f"no more than the modelled rotor can be missing; {because}",
            ),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column: acceleration of the joint; its coefficient is the rotor inertia."""
        return on_one_joint(robot, joint, inertia=(operation.a[:, row_of(robot, joint)], inertia_unit(robot, joint)))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bound: minus the modelled rotor inertia, so that the sum is not negative."""
        return ((-float(robot.rotor_inertia[row_of(robot, joint)]), np.inf),)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """``-I a`` on the joint."""
        return torque_on_joint(robot, joint, -theta.item() * operation.a[:, row_of(robot, joint)])

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The robot with this rotor inertia added."""
        return Simulated(robot=lambda moved: with_rotor_inertia(moved, joint, theta.item()))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The rotor inertia, which describes the effect completely."""
        return ModelNumbers(whole=True, rotor_inertia=theta.item())
