# pyright: reportAttributeAccessIssue=false
"""A point mass on ``payload_frame`` (else on the link with frame ``tip``, else on the last) that the model lacks.

It leaves gravity and inertia in one fixed ratio on every joint before it. A payload is the inertial parameters of the
last link with four numbers instead of ten; on a pendulum the two are the same thing.
URDF and MJCF: an inertial element more.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.effects.effect import Effect, Parameter, Shape, Signature, Simulated
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.inertia import STANDARD_NAMES, STANDARD_UNITS, body_parameters
from phantom_dyn.model.robot import Robot

Array = np.ndarray

_TIP = "tip"


def payload_body(robot: Robot) -> int:
    """Pinocchio index of the joint whose link carries the payload.

    The last link of a tree with several ends is that of the end that the file happens to state last, so a frame that is
    called ``tip``, as in the built-in robots, says it better.
    """
    frame = robot.payload_frame or _TIP
    if robot.model.existFrame(frame) and robot.model.frames[robot.model.getFrameId(frame)].parentJoint > 0:
        return robot.model.frames[robot.model.getFrameId(frame)].parentJoint
    return robot.model.njoints - 1


def point_mass_parameters(mass: float, center: Array) -> Array:
    """The ten standard inertial parameters of a point mass at ``center`` [m], about the joint origin."""
    return body_parameters(mass, np.asarray(center), np.zeros((3, 3)))


class Payload(Effect):
    """See the module."""

    name = "payload"
    scope = "robot"
    regime = "posture"
    uses_acceleration = True

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``mass`` and its place in the frame of the joint that moves the link."""
        return (Parameter("mass", "kg", 0.0), *(Parameter(f"center_{axis}", "m") for axis in "xyz"))

    def columns_of(self, robot: Robot, joint: str | None) -> tuple[int, ...]:
        """Which columns of the rigid-body regressor the mass moves."""
        first = 10 * (payload_body(robot) - 1)
        return tuple(range(first, first + 10))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """The body's ten regressor columns; a point mass uses them as `point_mass_parameters` says."""
        columns = rigid_body_regressor(robot, operation)[:, :, list(self.columns_of(robot, joint))]
        return Signature(tuple(range(robot.nv)), columns, STANDARD_NAMES, STANDARD_UNITS)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Mass and first moments give mass and centre."""
        mass = coefficients[0] if coefficients[0] != 0 else np.finfo(float).tiny
        return np.array([coefficients[0], *(coefficients[1:4] / mass)])

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """A mass at the centre of the last link."""
        center = robot.model.inertias[payload_body(robot)].lever
        return "mass", point_mass_parameters(1.0, center)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Minus the torque that the mass needs."""
        added = np.zeros_like(standard_parameters(robot))
        added[list(self.columns_of(robot, joint))] = point_mass_parameters(theta[0], theta[1:4])
        return -rigid_body_regressor(robot, operation) @ added

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A heavier last link."""
        added = np.zeros_like(standard_parameters(robot))
        added[list(self.columns_of(robot, joint))] = point_mass_parameters(theta[0], theta[1:4])
        return Simulated(robot=lambda moved: with_parameters(moved, added))
