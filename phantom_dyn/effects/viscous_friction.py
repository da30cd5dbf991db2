"""Viscous friction: ``torque = -c v``.

In inverse dynamics it leaves a residual proportional to velocity. Nothing else in the catalogue is odd and linear in
``v`` on one joint; a delay under a proportional controller comes close and is told apart by acceleration.
URDF: ``<dynamics damping>``; MJCF: joint ``damping``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from phantom_dyn.effects.effect import Parameter, Signature
from phantom_dyn.effects.rows import damping_unit, on_one_joint, row_of, torque_on_joint
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


class ViscousFriction:
    """See the module; implements `phantom_dyn.effects.effect.Effect`."""

    name = "viscous_friction"
    scope: Literal["joint", "robot"] = "joint"
    regime = "high_speed"
    contains: tuple[str, ...] = ()
    uses_acceleration = False

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``coefficient`` c."""
        return (Parameter("coefficient", damping_unit(robot, joint), 0.0),)

    def signature(self, robot: Robot, motion: Motion, joint: str | None, shape: float) -> Signature:
        """Velocity."""
        v = motion.v[:, row_of(robot, joint)]
        return on_one_joint(robot, joint, coefficient=(v, damping_unit(robot, joint)))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: float) -> Array:
        """The coefficients are the parameters."""
        return coefficients

    def probe(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[str, Array]:
        """The parameter itself."""
        return "coefficient", np.array([1.0])

    def torque(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> Array:
        """``-c v`` on the joint."""
        return torque_on_joint(robot, joint, -theta[0] * motion.v[:, row_of(robot, joint)])

    def shapes(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[float, ...]:
        """The torque is linear in every parameter."""
        return (np.nan,)
