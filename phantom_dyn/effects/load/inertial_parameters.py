"""Inertial parameters of one link (or, with joint None, of every link) that differ from those of the model.

They change torques of gravity and inertia; the proportions follow from the motion of the link. A recording determines
only base parameters, so a finding names the base parameters that differ. URDF and MJCF: the link's inertial element.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    row_of,
)
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.inertia import STANDARD_NAMES, STANDARD_UNITS, point_mass_parameters


def bodies_of(robot: Robot, joint: str | None) -> tuple[int, ...]:
    """Pinocchio indices of the bodies whose parameters may differ."""
    if joint is None:
        return tuple(range(1, robot.model.njoints))
    row_of(robot, joint)
    return (robot.model.getJointId(joint),)


class InertialParameters(Effect):
    """Inertial parameters of one link, or of all links, that differ from the model."""

    name = "inertial_parameters"
    regime = "posture"
    made_of = ("acceleration",)
    acts_as = "load"
    shows_with = "acceleration"
    exact = True
    inertial = "free"
    words = EffectWords(
        name="wrong inertial parameters",
        meaning="masses, centres of mass or inertias of the links beyond what the model's tolerance allows",
        next_step="Identify the inertias with an exciting motion, and replace those of the model.",
        shown_over=("acceleration", "position", "modelled"),
        separated_by="weighing",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Changes of the ten standard parameters of each body, about its joint origin."""
        return tuple(
            Parameter(
                f"{robot.model.names[body]}.{name}",
                unit,
                default=0.0,
                plausible=(-np.inf, np.inf),
                plausible_because="base parameters stand for sums over several links, so that each may have any change",
            )
            for body in bodies_of(robot, joint)
            for name, unit in zip(STANDARD_NAMES, STANDARD_UNITS, strict=True)
        )

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Each link, and all links together."""
        return (*robot.joint_names, None) if robot.nv > 1 else robot.joint_names

    def can_sit(self, robot: Robot, joint: str | None) -> bool:
        """True for one link, and for all links together (also if a robot has only one)."""
        return joint is None or joint in self.places(robot)

    def regressor_columns(self, robot: Robot, joint: str | None) -> tuple[int, ...]:
        """All ten columns of each body."""
        return tuple(10 * (body - 1) + k for body in bodies_of(robot, joint) for k in range(10))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Columns of the rigid-body regressor that belong to the bodies."""
        parameters = self.parameters(robot, joint)
        return Signature(
            tuple(range(robot.nv)),
            rigid_body_regressor(robot, operation)[:, :, list(self.regressor_columns(robot, joint))],
            tuple(p.name for p in parameters),
            tuple(p.unit for p in parameters),
        )

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: a mass at the centre of mass of the last body."""
        bodies = bodies_of(robot, joint)
        return f"{robot.model.names[bodies[-1]]}.m", np.concatenate(
            [point_mass_parameters(float(body == bodies[-1]), robot.model.inertias[body].lever) for body in bodies]
        )

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Minus the drive torque that the changes of the parameters need."""
        return -self.signature(robot, operation, joint, ()).columns @ theta

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The robot with changed links."""
        change = np.zeros_like(standard_parameters(robot))
        change[list(self.regressor_columns(robot, joint))] = theta
        return Simulated(robot=lambda moved: with_parameters(moved, change))
