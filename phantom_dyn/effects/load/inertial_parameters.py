"""Inertial parameters of one link (or, with joint None, of every link) that are not those of the model.

They leave gravity and inertia in the proportions that the link's motion dictates. Only base parameters can be told
from a recording, so what is reported are the changes of those that moved, by name.
URDF and MJCF: the link's inertial element.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.effects.effect import Effect, Parameter, Shape, Signature, Simulated
from phantom_dyn.effects.load.payload import point_mass_parameters
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.model.inertia import STANDARD_NAMES, STANDARD_UNITS
from phantom_dyn.model.robot import Robot

Array = np.ndarray


def bodies_of(robot: Robot, joint: str | None) -> tuple[int, ...]:
    """Pinocchio indices of the bodies whose parameters are free."""
    if joint is None:
        return tuple(range(1, robot.model.njoints))
    row_of(robot, joint)
    return (robot.model.getJointId(joint),)


class InertialParameters(Effect):
    """See the module."""

    name = "inertial_parameters"
    regime = "posture"
    contains = ("payload",)
    uses_acceleration = True

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Changes of the ten standard parameters of each free body, about its joint origin."""
        return tuple(
            Parameter(f"{robot.model.names[body]}.{name}", unit)
            for body in bodies_of(robot, joint)
            for name, unit in zip(STANDARD_NAMES, STANDARD_UNITS, strict=True)
        )

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """One link, or all of them together."""
        return (*robot.joint_names, None) if robot.nv > 1 else robot.joint_names

    def columns_of(self, robot: Robot, joint: str | None) -> tuple[int, ...]:
        """Which columns of the rigid-body regressor are free."""
        return tuple(10 * (body - 1) + k for body in bodies_of(robot, joint) for k in range(10))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """The rigid-body regressor's columns of the free bodies."""
        parameters = self.parameters(robot, joint)
        return Signature(
            tuple(range(robot.nv)),
            rigid_body_regressor(robot, operation)[:, :, list(self.columns_of(robot, joint))],
            tuple(p.name for p in parameters),
            tuple(p.unit for p in parameters),
        )

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """A mass at the centre of the (last) free body."""
        bodies = bodies_of(robot, joint)
        return f"{robot.model.names[bodies[-1]]}.m", np.concatenate(
            [point_mass_parameters(float(body == bodies[-1]), robot.model.inertias[body].lever) for body in bodies]
        )

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Minus the torque that the changes need."""
        return -self.signature(robot, operation, joint, ()).columns @ theta

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Other links."""
        change = np.zeros(10 * (robot.model.njoints - 1))
        change[list(self.columns_of(robot, joint))] = theta
        return Simulated(robot=lambda moved: with_parameters(moved, change))
