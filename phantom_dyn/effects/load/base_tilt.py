# pyright: reportAttributeAccessIssue=false
"""A base that is not level: it turned by -r, so that in its frame gravity is the given one times ``exp([r]x)``.

The turn ``r`` is perpendicular to gravity, as a turn about gravity changes nothing; its components along x, y and z of
the base are ``roll``, ``pitch`` and ``yaw``. It leaves a change of gravity torque on all joints, two numbers for the
whole robot, and no torque that varies with speed or acceleration. Gravity turned about the axis of a planar arm equals
an offset of its first encoder; gravity turned out of its plane leaves no torque. In a single posture a payload looks
the same. Wide postures separate them. URDF: a level link under the root; MJCF: ``option gravity``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Float,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    Stated,
)
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.motion import Motion

# In place of an angle about an axis across gravity that leaves no torque: it has no column, and is reported as zero.
INVISIBLE = np.inf
_LEVEL: Shape = (0.0, 0.0)
_ANGLES = ("roll", "pitch", "yaw")
# Tilt [rad] that nobody would overlook.
_LEANING = 0.35
# Below this [rad] the secant is the tangent to three digits, and rounding shows.
_LEAST = 1e-4
# Smallest torque of a tilt by one radian, as a share of the torque: less is rounding of the robot file.
_NOTHING = 1e-6
# Number of postures of a recording at which the torque of a tilt is computed.
_POSTURES = 300


class BaseTilt(Effect):
    """Base that is not level."""

    name = "base_tilt"
    scope = "robot"
    regime = "posture"
    made_of = ("model",)
    acts_as = "load"
    fitted = "secant"
    exact = True
    words = EffectWords(
        name="a tilted base",
        meaning="gravity has another direction than in the model",
        next_step="Put a level on the base, correct the mounting or the model's gravity.",
        size="of {roll} about x, {pitch} about y and {yaw} about z",
        parameters={
            "roll": "turn of gravity about x of the base",
            "pitch": "turn of gravity about y of the base",
            "yaw": "turn of gravity about z of the base",
        },
        shown_over=("position",),
        separated_by="level",
    )

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Not on a base that is not bolted down: its own sensors measure gravity."""
        return () if robot.floating else (None,)

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``roll``, ``pitch`` and ``yaw``: how gravity is turned about x, y and z of the base."""
        half = 0.5 * np.pi
        return tuple(
            Parameter(
                name,
                "rad",
                -half,
                half,
                default=0.0,
                plausible=(-_LEANING, _LEANING),
                plausible_because="a base that leans by more than twenty degrees is seen by eye",
                either_sign=True,
            )
            for name in _ANGLES
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """The tangent about both axes, or about the one that leaves a torque."""
        least = _NOTHING * np.abs(operation.tau).max()
        seen = [np.abs(column).max() > least for column in _tangents(robot, operation)]
        return (tuple(0.0 if visible else INVISIBLE for visible in seen),) if any(seen) else ()

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The secant to the last estimate."""
        return (tuple(float(x) for x in _angles(coefficients, shape)),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Additional drive torque per radian about each of two axes across gravity, see `axes_across`.

        The secant of the second axis starts at the given gravity, and that of the first one where the second ends.
        """
        axes, angles = axes_across(robot.model.gravity.linear), np.array(shape or _LEVEL, dtype=float)
        seen = np.isfinite(angles)
        angles = np.where(seen, angles, 0.0)
        starts = (np.array([0.0, angles[1]]), np.zeros(2))
        visible = [k for k in (0, 1) if seen[k]]
        values = [_slope(robot, operation.q, axes, k, starts[k], float(angles[k])) for k in visible]
        names = tuple(_ANGLES[int(np.argmax(np.abs(axes[k])))] for k in visible)
        return Signature(tuple(range(robot.nv)), np.stack(values, axis=-1), names, ("rad",) * len(names))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """A robot does not hang on its base plate."""
        return ((-0.5 * np.pi, 0.5 * np.pi),) * sum(np.isfinite(angle) for angle in shape or _LEVEL)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """The turn along x, y and z; about an axis that leaves no trace it is zero."""
        angles = _angles(coefficients, shape)
        return np.where(np.isfinite(angles), angles, 0.0) @ axes_across(robot.model.gravity.linear)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """The largest component of a turn about the first axis that leaves a trace."""
        seen = np.flatnonzero(np.isfinite(self.shapes(robot, operation, joint)[0]))
        axis = axes_across(robot.model.gravity.linear)[seen[0]]
        largest = int(np.argmax(np.abs(axis)))
        return _ANGLES[largest], np.eye(len(seen))[0] / axis[largest]

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """It cannot be seen if no joint feels gravity."""
        if not self.shapes(robot, operation, joint):
            return "no joint feels gravity turn: a tilt of the base leaves no trace"
        return None

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Gravity torque as modelled less that under the true gravity."""
        given = robot.model.gravity.linear
        return -gravity_torque(robot, operation.q, _turned(given, theta) - given)

    def true_motion(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> tuple[Robot, Motion]:
        """The motion in the true gravity."""
        return with_gravity(robot, _turned(robot.model.gravity.linear, theta)), motion

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Another gravity."""
        return Simulated(robot=lambda moved: with_gravity(moved, _turned(moved.model.gravity.linear, theta)))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """Model files can contain all of it, as this number."""
        return replace(super().model_numbers(robot, joint, theta), turned=pin.exp3(np.asarray(theta, dtype=float)))

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """A turn about the axis across gravity that is nearest to that axis of the base."""
        k = _ANGLES.index(name)
        axes = axes_across(robot.model.gravity.linear)
        axis = axes[int(np.argmax(np.abs(axes[:, k])))]
        return tuple(float(x) for x in size * axis / axis[k]) if axis[k] != 0 else None

    def from_stated(self, robot: Robot, stated: Stated) -> Stated:
        """``roll`` and ``pitch`` alone were ``R_x(roll) R_y(pitch)``: the turn across gravity that does the same."""
        if set(stated) != {"roll", "pitch"}:
            return stated
        given = robot.model.gravity.linear
        roll, pitch = (float(np.ravel(stated[name])[0]) for name in _ANGLES[:2])
        x, y = pin.utils.rotate("x", roll), pin.utils.rotate("y", pitch)
        across = np.cross(given, x @ y @ given)
        sine, cosine = np.linalg.norm(across), float(given @ x @ y @ given)
        turn = np.arctan2(sine, cosine) * across / sine if sine > 0 else np.zeros(3)
        return dict(zip(_ANGLES, turn.tolist(), strict=True))


def axes_across(gravity: Float[Array, " 3"]) -> Float[Array, "2 3"]:
    """Two unit axes across gravity and each other, the nearest to axes of the base: x and y where it points along z."""
    size = float(np.linalg.norm(gravity))
    down = gravity / size if size > 0 else np.array([0.0, 0.0, -1.0])
    flattest = np.sort(np.argsort(np.abs(down), kind="stable")[:2])
    axes = np.eye(3)[flattest]
    axes = axes - np.outer(axes @ down, down)
    first = axes[0] / np.linalg.norm(axes[0])
    second = axes[1] - (axes[1] @ first) * first
    return np.stack([first, second / np.linalg.norm(second)])


def _turned(gravity: Array, turn: Float[Array, " 3"]) -> Array:
    """Gravity after a turn."""
    return pin.exp3(np.asarray(turn, dtype=float)) @ gravity


def _slope(robot: Robot, q: Array, axes: Array, k: int, start: Array, angle: float) -> Array:
    """Change of gravity torque per radian, between a turn and ``angle`` more about one of the axes across gravity."""
    given, axis = robot.model.gravity.linear, np.eye(2)[k]
    # Over less, the difference about the start is the tangent to eight digits, and rounding does not show.
    ends = (0.0, angle) if abs(angle) >= _LEAST else (-_LEAST, _LEAST)
    low, high = (_turned(given, (start + end * axis) @ axes) for end in ends)
    return gravity_torque(robot, q, (high - low) / (ends[1] - ends[0]))


def _tangents(robot: Robot, operation: Operation) -> tuple[Array, Array]:
    """Columns of both angles at some hundred postures of the recording."""
    q, axes = operation.q[:: max(1, len(operation.q) // _POSTURES)], axes_across(robot.model.gravity.linear)
    first, second = (_slope(robot, q, axes, k, np.zeros(2), 0.0) for k in (0, 1))
    return first, second


def _angles(coefficients: Array, shape: Shape) -> Array:
    """The shape with the coefficients in place of the angles that leave a torque."""
    out = np.array(shape or _LEVEL, dtype=float)
    out[np.isfinite(out)] = coefficients
    return out
