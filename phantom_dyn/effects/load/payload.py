# pyright: reportAttributeAccessIssue=false
"""A point mass on ``payload_frame`` (else on the link with frame ``tip``, else on the last) that the model lacks.

It leaves gravity and inertia in one fixed ratio on every joint before it. A payload is the inertial parameters of the
last link with four numbers instead of ten; on a pendulum the two are the same thing.
URDF and MJCF: an inertial element more.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.effects.described import EffectWords
from phantom_dyn.effects.effect import Effect, Parameter, Shape, Signature
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.simulated import Simulated
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.inertia import STANDARD_NAMES, STANDARD_UNITS, payload_body, point_mass_parameters
from phantom_dyn.model.robot import Robot

Array = np.ndarray

# Largest load [kg], and how far from its link [m] one is held.
_HEAVIEST, _FARTHEST = 1000.0, 3.0


class Payload(Effect):
    """See the module."""

    name = "payload"
    scope = "robot"
    regime = "posture"
    uses_acceleration = True
    inertial = "point mass"
    words = EffectWords(
        name="a payload",
        meaning="a mass on the last link that the model does not carry",
        next_step="Weigh the tool, cable or load at the last link, and add it to the model.",
        less="less mass on the last link than modelled",
        size="of {mass}",
        parameters={
            "mass": "additional mass",
            "center_x": "its place along x of the frame that carries it",
            "center_y": "its place along y",
            "center_z": "its place along z",
        },
        shown_over=("position", "modelled", "acceleration"),
        separated_by="weighing",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``mass`` and its place in the frame of the joint that moves the link."""
        mass = Parameter(
            "mass",
            "kg",
            0.0,
            plausible=(0.0, _HEAVIEST),
            plausible_because="the strongest arms lift a tonne",
        )
        centers = (
            Parameter(
                f"center_{axis}",
                "m",
                plausible=(-_FARTHEST, _FARTHEST),
                plausible_because="a load is held within a few metres of the link that carries it",
            )
            for axis in "xyz"
        )
        return mass, *centers

    def regressor_columns(self, robot: Robot, joint: str | None) -> tuple[int, ...]:
        """Those of the body that carries it."""
        first = 10 * (payload_body(robot) - 1)
        return tuple(range(first, first + 10))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """The body's ten regressor columns; a point mass uses them as `point_mass_parameters` says."""
        columns = rigid_body_regressor(robot, operation)[:, :, list(self.regressor_columns(robot, joint))]
        return Signature(tuple(range(robot.nv)), columns, STANDARD_NAMES, STANDARD_UNITS)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Mass and first moments give mass and centre."""
        mass = coefficients[0] if coefficients[0] != 0 else np.finfo(float).tiny
        return np.array([coefficients[0], *(coefficients[1:4] / mass)])

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """A mass at the centre of the last link."""
        center = robot.model.inertias[payload_body(robot)].lever
        return "mass", point_mass_parameters(1.0, center)

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """At the centre of the last link."""
        return (size, *(float(x) for x in robot.model.inertias[payload_body(robot)].lever))

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Minus the torque that the mass needs."""
        added = np.zeros_like(standard_parameters(robot))
        added[list(self.regressor_columns(robot, joint))] = point_mass_parameters(theta[0], theta[1:4])
        return -rigid_body_regressor(robot, operation) @ added

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A heavier last link."""
        added = np.zeros_like(standard_parameters(robot))
        added[list(self.regressor_columns(robot, joint))] = point_mass_parameters(theta[0], theta[1:4])
        return Simulated(robot=lambda moved: with_parameters(moved, added))
