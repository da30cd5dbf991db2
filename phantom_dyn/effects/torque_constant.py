"""A wrong torque constant: the true torque is ``ratio`` times the logged one.

Everything of that joint is scaled, gravity and friction included. The column is the modelled torque, not the
measured one, whose noise would bias the fit. A wrong mass of all links behind the joint looks alike; a known mass, or
friction that is trusted, parts the two. URDF has no place for it; MJCF: actuator ``gear``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from phantom_dyn.dynamics import inverse_dynamics
from phantom_dyn.effects.effect import Parameter, Signature
from phantom_dyn.effects.rows import on_one_joint, row_of, torque_on_joint
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


class TorqueConstant:
    """See the module; implements `phantom_dyn.effects.effect.Effect`."""

    name = "torque_constant"
    scope: Literal["joint", "robot"] = "joint"
    regime = "high_load"
    contains: tuple[str, ...] = ()
    uses_acceleration = True

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``ratio`` of true to logged torque."""
        return (Parameter("ratio", "1", 0.0),)

    def signature(self, robot: Robot, motion: Motion, joint: str | None, shape: float) -> Signature:
        """Modelled torque; its coefficient is ``1/ratio - 1``."""
        return on_one_joint(robot, joint, excess=(inverse_dynamics(robot, motion)[:, row_of(robot, joint)], "1"))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: float) -> Array:
        """``ratio = 1 / (1 + excess)``; an excess of -1 or less would be a drive that pulls the wrong way."""
        return np.array([1.0 / max(1.0 + coefficients[0], 1e-6)])

    def probe(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[str, Array]:
        """A ratio that is off by one, to first order."""
        return "ratio", np.array([-1.0])

    def torque(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> Array:
        """What the drive gives beyond the logged torque when the logged torque is what the true motion needs."""
        needed = inverse_dynamics(robot, motion)[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, needed * (1.0 - 1.0 / theta[0]))

    def shapes(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[float, ...]:
        """The torque is linear in every parameter."""
        return (np.nan,)
