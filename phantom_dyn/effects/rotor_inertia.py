"""Rotor inertia that the model lacks, reflected to the joint side: ``torque = -I a``.

It leaves a residual proportional to that joint's own acceleration and no gravity. On the first joint, and wherever it
regroups with the link's inertia, nothing can part the two.
URDF has no place for it; MJCF: joint ``armature``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from phantom_dyn.effects.effect import Parameter, Signature
from phantom_dyn.effects.rows import on_one_joint, row_of, torque_on_joint
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


class RotorInertia:
    """See the module; implements `phantom_dyn.effects.effect.Effect`."""

    name = "rotor_inertia"
    scope: Literal["joint", "robot"] = "joint"
    regime = "high_acceleration"
    contains: tuple[str, ...] = ()
    uses_acceleration = True

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``inertia`` I."""
        return (Parameter("inertia", _unit(robot, joint), 0.0),)

    def signature(self, robot: Robot, motion: Motion, joint: str | None, shape: float) -> Signature:
        """Acceleration of the joint."""
        return on_one_joint(robot, joint, inertia=(motion.a[:, row_of(robot, joint)], _unit(robot, joint)))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: float) -> Array:
        """The coefficients are the parameters."""
        return coefficients

    def probe(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[str, Array]:
        """The parameter itself."""
        return "inertia", np.array([1.0])

    def torque(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> Array:
        """``-I a`` on the joint."""
        return torque_on_joint(robot, joint, -theta[0] * motion.a[:, row_of(robot, joint)])

    def shapes(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[float, ...]:
        """The torque is linear in every parameter."""
        return (np.nan,)


def _unit(robot: Robot, joint: str | None) -> str:
    return "kg" if robot.prismatic[row_of(robot, joint)] else "kg m^2"
