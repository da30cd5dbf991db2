"""Viscous friction: ``torque = -c v``.

In inverse dynamics it leaves a residual proportional to velocity. Nothing else in the catalogue is odd and linear in
``v`` on one joint; a delay under a proportional controller comes close and is told apart by acceleration.
URDF: ``<dynamics damping>``; MJCF: joint ``damping``.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.effects.changed_robot import with_friction
from phantom_dyn.effects.effect import Effect, Parameter, Shape, Signature, Simulated
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rows import damping_unit, on_one_joint, row_of, torque_on_joint
from phantom_dyn.robot import Robot

Array = np.ndarray


class ViscousFriction(Effect):
    """See the module."""

    name = "viscous_friction"
    regime = "high_speed"

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``coefficient`` c."""
        return (Parameter("coefficient", damping_unit(robot, joint), 0.0),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Velocity."""
        v = operation.v[:, row_of(robot, joint)]
        return on_one_joint(robot, joint, coefficient=(v, damping_unit(robot, joint)))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Together with the modelled coefficient it is not negative."""
        return ((-float(robot.viscous_friction[row_of(robot, joint)]), np.inf),)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """The parameter itself."""
        return "coefficient", np.array([1.0])

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """``-c v`` on the joint."""
        return torque_on_joint(robot, joint, -theta[0] * operation.v[:, row_of(robot, joint)])

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """More modelled friction."""
        return Simulated(robot=lambda moved: with_friction(moved, joint, viscous=theta[0]))
