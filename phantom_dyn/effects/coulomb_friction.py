"""Coulomb friction: ``torque = -T sign(v)``, with ``sign(0) = 0``.

In inverse dynamics it leaves a step of ``2 T`` at every reversal, of the same height everywhere.
URDF: ``<dynamics friction>``; MJCF: joint ``frictionloss``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from phantom_dyn.effects.effect import Parameter, Signature
from phantom_dyn.effects.rows import on_one_joint, row_of, torque_on_joint, torque_unit
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


class CoulombFriction:
    """See the module; implements `phantom_dyn.effects.effect.Effect`."""

    name = "coulomb_friction"
    scope: Literal["joint", "robot"] = "joint"
    regime = "velocity_reversal"
    contains: tuple[str, ...] = ()
    uses_acceleration = False

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``torque`` T."""
        return (Parameter("torque", torque_unit(robot, joint), 0.0),)

    def signature(self, robot: Robot, motion: Motion, joint: str | None, shape: float) -> Signature:
        """Direction of motion."""
        s = np.sign(motion.v[:, row_of(robot, joint)])
        return on_one_joint(robot, joint, torque=(s, torque_unit(robot, joint)))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: float) -> Array:
        """The coefficients are the parameters."""
        return coefficients

    def probe(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[str, Array]:
        """The parameter itself."""
        return "torque", np.array([1.0])

    def torque(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> Array:
        """``-T sign(v)`` on the joint."""
        return torque_on_joint(robot, joint, -theta[0] * np.sign(motion.v[:, row_of(robot, joint)]))

    def shapes(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[float, ...]:
        """The torque is linear in every parameter."""
        return (np.nan,)
