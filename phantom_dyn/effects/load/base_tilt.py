# pyright: reportAttributeAccessIssue=false
"""A base that is not level: gravity in the frame of the base is the given one, rotated by the vector ``r``.

The rotation vector ``r`` is perpendicular to gravity, because a rotation about gravity changes nothing. So the effect
has two free numbers; the components of ``r`` along x, y and z of the base are ``roll``, ``pitch`` and ``yaw``. The
effect changes the gravity torques of all joints, and no torque that depends on speed or acceleration. On a planar arm a
rotation about the joint axes equals an offset of the first encoder, and a rotation of gravity out of the plane changes
no torque. In a single posture a payload looks the same; postures far apart separate them. URDF: a level link under the
root; MJCF: ``option gravity``.
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

INVISIBLE = np.inf
"""Value in a shape for an angle that changes no torque: the angle has no column, and a finding states it as zero."""
_LEVEL: Shape = (0.0, 0.0)
_ANGLES = ("roll", "pitch", "yaw")
# Tilt [rad] that nobody would overlook.
_LARGEST_TILT = 0.35
# Angle [rad] below which the tangent replaces the secant, which then has large rounding errors. At this angle both
# agree to three digits.
_LEAST = 1e-4
# Torque of a tilt by one radian, as a share of the largest torque. A smaller torque is due to rounded numbers in the
# robot file.
_ROUNDING = 1e-6
# Number of postures of a recording at which the torque of a tilt is computed.
_POSTURES = 300


class BaseTilt(Effect):
    """A base that is not level, so that gravity has another direction than in the model."""

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
            "roll": "turn of gravity about x of the base; the base is turned the other way",
            "pitch": "turn of gravity about y of the base; the base is turned the other way",
            "yaw": "turn of gravity about z of the base; the base is turned the other way",
        },
        shown_over=("position",),
        separated_by="level",
    )

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """The whole robot; nothing if its base floats, because its own sensors then measure gravity."""
        return () if robot.floating else (None,)

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``roll``, ``pitch`` and ``yaw``: components of gravity's rotation vector along x, y and z of the base."""
        half = 0.5 * np.pi
        return tuple(
            Parameter(
                name,
                "rad",
                -half,
                half,
                default=0.0,
                plausible=(-_LARGEST_TILT, _LARGEST_TILT),
                plausible_because="a base that leans by more than twenty degrees is seen by eye",
                either_sign=True,
            )
            for name in _ANGLES
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """One start: the tangent for each of the two axes that changes a torque; empty if neither does."""
        least = _ROUNDING * np.abs(operation.tau).max()
        q, axes = operation.q[:: max(1, len(operation.q) // _POSTURES)], axes_across(robot.model.gravity.linear)
        columns = (_slope(robot, q, axes, k, np.zeros(2), 0.0) for k in (0, 1))
        visible = [np.abs(column).max() > least for column in columns]
        return (tuple(0.0 if seen else INVISIBLE for seen in visible),) if any(visible) else ()

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The next angles of the secant [rad]: the last estimate."""
        return (tuple(float(x) for x in _angles(coefficients, shape)),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Additional drive torque per radian about each of the two axes of `axes_across`.

        The secant about the second axis starts at the modelled gravity. The secant about the first axis starts at
        gravity after the rotation about the second axis.
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
        """Bounds of each angle: a quarter of a turn in both directions."""
        return ((-0.5 * np.pi, 0.5 * np.pi),) * sum(np.isfinite(angle) for angle in shape or _LEVEL)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Components of the rotation vector; an angle that changes no torque is zero."""
        angles = _angles(coefficients, shape)
        return np.where(np.isfinite(angles), angles, 0.0) @ axes_across(robot.model.gravity.linear)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: largest component of a rotation about the first axis that changes a torque."""
        seen = np.flatnonzero(np.isfinite(self.shapes(robot, operation, joint)[0]))
        axis = axes_across(robot.model.gravity.linear)[seen[0]]
        largest = int(np.argmax(np.abs(axis)))
        return _ANGLES[largest], np.eye(len(seen))[0] / axis[largest]

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if a tilt changes no joint torque."""
        if not self.shapes(robot, operation, joint):
            return "no joint feels gravity turn: a tilt of the base leaves no trace"
        return None

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Gravity torque in the modelled gravity minus that in the true gravity."""
        given = robot.model.gravity.linear
        return -gravity_torque(robot, operation.q, _turned(given, theta) - given)

    def true_motion(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> tuple[Robot, Motion]:
        """The robot with the true gravity, and the same motion."""
        return with_gravity(robot, _turned(robot.model.gravity.linear, theta)), motion

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The robot with the true gravity."""
        return Simulated(robot=lambda moved: with_gravity(moved, _turned(moved.model.gravity.linear, theta)))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The rotation of gravity, which describes the effect completely."""
        return replace(super().model_numbers(robot, joint, theta), turned=pin.exp3(np.asarray(theta, dtype=float)))

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """A rotation about the axis of `axes_across` that is nearest to the named axis of the base."""
        k = _ANGLES.index(name)
        axes = axes_across(robot.model.gravity.linear)
        axis = axes[int(np.argmax(np.abs(axes[:, k])))]
        return tuple(float(x) for x in size * axis / axis[k]) if axis[k] != 0 else None

    def from_stated(self, robot: Robot, stated: Stated) -> Stated:
        """The rotation vector; older files state ``R_x(roll) R_y(pitch)`` by ``roll`` and ``pitch`` only."""
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
    """Two orthogonal unit axes perpendicular to gravity, close to axes of the base: x and y if gravity is along z."""
    size = float(np.linalg.norm(gravity))
    down = gravity / size if size > 0 else np.array([0.0, 0.0, -1.0])
    flattest = np.sort(np.argsort(np.abs(down), kind="stable")[:2])
    axes = np.eye(3)[flattest]
    axes = axes - np.outer(axes @ down, down)
    first = axes[0] / np.linalg.norm(axes[0])
    second = axes[1] - (axes[1] @ first) * first
    return np.stack([first, second / np.linalg.norm(second)])


def _turned(gravity: Array, turn: Float[Array, " 3"]) -> Array:
    """Gravity after a rotation by the vector ``turn``."""
    return pin.exp3(np.asarray(turn, dtype=float)) @ gravity


def _slope(robot: Robot, q: Array, axes: Array, k: int, start: Array, angle: float) -> Array:
    """Change of gravity torque per radian, if the angle about axis ``k`` grows by ``angle`` from ``start``."""
    given, axis = robot.model.gravity.linear, np.eye(2)[k]
    # For a small angle a central difference about the start gives the tangent to eight digits.
    ends = (0.0, angle) if abs(angle) >= _LEAST else (-_LEAST, _LEAST)
    low, high = (_turned(given, (start + end * axis) @ axes) for end in ends)
    return gravity_torque(robot, q, (high - low) / (ends[1] - ends[0]))


def _angles(coefficients: Array, shape: Shape) -> Array:
    """Angles about both axes: the coefficients, and `INVISIBLE` as in the shape."""
    out = np.array(shape or _LEVEL, dtype=float)
    out[np.isfinite(out)] = coefficients
    return out
