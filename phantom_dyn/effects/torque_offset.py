"""A constant torque on one joint that the model lacks (positive along the joint).

The drive has to cancel it, so the measured torque is lower by it. On a joint whose gravity torque hardly changes it
looks like a base tilt or a payload. URDF has no place for it; MJCF: a constant ``qfrc_applied``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from phantom_dyn.effects.effect import Parameter, Signature
from phantom_dyn.effects.rows import on_one_joint, torque_on_joint, torque_unit
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


class TorqueOffset:
    """See the module; implements `phantom_dyn.effects.effect.Effect`."""

    name = "torque_offset"
    scope: Literal["joint", "robot"] = "joint"
    regime = "everywhere"
    contains: tuple[str, ...] = ()
    uses_acceleration = False

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``torque``, either sign."""
        return (Parameter("torque", torque_unit(robot, joint)),)

    def signature(self, robot: Robot, motion: Motion, joint: str | None, shape: float) -> Signature:
        """Minus one: the drive cancels the offset."""
        return on_one_joint(robot, joint, torque=(-np.ones(len(motion.t)), torque_unit(robot, joint)))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: float) -> Array:
        """The coefficients are the parameters."""
        return coefficients

    def probe(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[str, Array]:
        """The torque itself."""
        return "torque", np.array([1.0])

    def torque(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> Array:
        """The constant on the joint."""
        return torque_on_joint(robot, joint, np.full(len(motion.t), theta[0]))

    def shapes(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[float, ...]:
        """The torque is linear in every parameter."""
        return (np.nan,)
