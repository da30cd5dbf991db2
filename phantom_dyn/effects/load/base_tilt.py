"""A base that does not stand level: gravity in the base frame is ``R_x(roll) R_y(pitch)`` applied to the given one.

It leaves a change of gravity torque on all joints, two numbers for the whole robot, and nothing that moves with speed
or acceleration. Gravity turned about the axis of a planar arm is an offset of its first encoder; gravity turned out of
its plane leaves nothing. A payload at one posture looks alike. Wide postures separate them.
URDF: a level link under the root; MJCF: ``option gravity``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.effects.described import EffectWords, ModelNumbers
from phantom_dyn.effects.effect import Effect, Parameter, Shape, Signature
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.simulated import Simulated
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.model.robot import Robot

Array = np.ndarray

# Takes the place of an angle in a shape that leaves no trace: it has no column, and is reported as zero.
INVISIBLE = np.inf
_LEVEL: Shape = (0.0, 0.0)
# Below this [rad] the secant is the tangent to three digits, and rounding shows.
_LEAST = 1e-4
# Torque of a tilt by one radian, in shares of the gravity torque or of the whole: less is rounding of the robot file.
_NOTHING = 1e-6
# How many postures of a recording are asked whether they feel a tilt.
_POSTURES = 300


class BaseTilt(Effect):
    """See the module."""

    name = "base_tilt"
    scope = "robot"
    regime = "posture"
    shape_is_estimate = True
    follows_model = True
    either_sign = True
    words = EffectWords(
        name="a tilted base",
        meaning="gravity has another direction than in the model",
        next_step="Put a level on the base, correct the mounting or the model's gravity.",
        size="of {roll} about x and {pitch} about y",
        parameters={
            "roll": "turn of gravity about x of the base",
            "pitch": "turn of gravity about y of the base",
        },
        shown_over=("position",),
        separated_by="level",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``roll`` about the base's x axis, ``pitch`` about its y axis."""
        half = 0.5 * np.pi
        return (Parameter("roll", "rad", -half, half), Parameter("pitch", "rad", -half, half))

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """The tangent in both angles, or in the one that leaves a trace."""
        least = _NOTHING * np.abs(operation.tau).max()
        seen = [np.abs(column).max() > least for column in _tangents(robot, operation)]
        return (tuple(0.0 if visible else INVISIBLE for visible in seen),) if any(seen) else ()

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The secant to the last estimate."""
        return (tuple(float(x) for x in _angles(coefficients, shape)),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Drive torque more per radian of each angle: of pitch from the given gravity, of roll from the pitched one."""
        roll, pitch = shape if shape else _LEVEL
        given = robot.model.gravity.linear
        pitched = _turned(given, 0.0, pitch if np.isfinite(pitch) else 0.0)
        columns = {}
        if np.isfinite(roll):
            columns["roll"] = _slope(robot, operation.q, pitched, np.array([1.0, 0.0]), roll)
        if np.isfinite(pitch):
            columns["pitch"] = _slope(robot, operation.q, given, np.array([0.0, 1.0]), pitch)
        values = np.stack(list(columns.values()), axis=-1)
        return Signature(tuple(range(robot.nv)), values, tuple(columns), ("rad",) * len(columns))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """A robot does not hang on its base plate."""
        return ((-0.5 * np.pi, 0.5 * np.pi),) * sum(np.isfinite(angle) for angle in shape or _LEVEL)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Both angles; one that leaves no trace is zero."""
        angles = _angles(coefficients, shape)
        return np.where(np.isfinite(angles), angles, 0.0)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """The first angle that leaves a trace."""
        seen = np.isfinite(self.shapes(robot, operation, joint)[0])
        return ("roll" if seen[0] else "pitch"), np.eye(int(seen.sum()))[0]

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Where gravity turns nothing."""
        if not self.shapes(robot, operation, joint):
            return "no joint feels gravity turn: a tilt of the base leaves no trace"
        return None

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Gravity torque as modelled less that under the true gravity."""
        given = robot.model.gravity.linear
        return -gravity_torque(robot, operation.q, _turned(given, *theta) - given)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Another gravity."""
        return Simulated(robot=lambda moved: with_gravity(moved, _turned(moved.model.gravity.linear, *theta)))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """All of it."""
        return replace(super().model_numbers(robot, joint, theta), turned=_turn(*theta))

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """About one axis."""
        return tuple(size if angle == name else 0.0 for angle in ("roll", "pitch"))


def _turned(gravity: Array, roll: float, pitch: float) -> Array:
    """``R_x(roll) R_y(pitch) gravity``."""
    x, y, z = gravity
    x, z = np.cos(pitch) * x + np.sin(pitch) * z, np.cos(pitch) * z - np.sin(pitch) * x
    return np.array([x, np.cos(roll) * y - np.sin(roll) * z, np.sin(roll) * y + np.cos(roll) * z])


def _turn(roll: float, pitch: float) -> Float[Array, "3 3"]:
    """``R_x(roll) R_y(pitch)``."""
    return pin.utils.rotate("x", float(roll)) @ pin.utils.rotate("y", float(pitch))


def _slope(robot: Robot, q: Array, gravity: Array, axes: Array, angle: float) -> Array:
    """Change of gravity torque per radian between no turn about an axis and ``angle``."""
    if abs(angle) < _LEAST:
        return gravity_torque(robot, q, np.cross([*axes, 0.0], gravity))
    return gravity_torque(robot, q, (_turned(gravity, *(axes * angle)) - gravity) / angle)


def _tangents(robot: Robot, operation: Operation) -> tuple[Array, Array]:
    """Columns of both angles at some hundred postures."""
    given, q = robot.model.gravity.linear, operation.q[:: max(1, len(operation.q) // _POSTURES)]
    first, second = (_slope(robot, q, given, axes, 0.0) for axes in np.eye(2))
    return first, second


def _angles(coefficients: Array, shape: Shape) -> Array:
    """Coefficients in the places of the angles that leave a trace."""
    out = np.array(shape or _LEVEL, dtype=float)
    out[np.isfinite(out)] = coefficients
    return out
