# pyright: reportAttributeAccessIssue=false
"""Limits that a robot's file and configuration state, and whether the robot can be excited at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from phantom_dyn.errors import RobotError, known_names
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import linear_joints

_HUGE = 1e6  # files write numbers of this size, up to the largest of all, for "none"

Array = np.ndarray


@dataclass(frozen=True)
class StatedLimits:
    """Limits of the joints of the tree (of drives: of the active joints); infinite where none is stated.

    Attributes:
        names: Joints of the tree.
        linear: True for linear joints.
        lower, upper: Positions [rad or m].
        velocity: Largest speed.
        torque: Largest drive torque of the active joints.
        notes: Sentences for the user.
    """

    names: tuple[str, ...]
    linear: Bool[Array, " nt"]
    lower: Float[Array, " nt"]
    upper: Float[Array, " nt"]
    velocity: Float[Array, " nt"]
    torque: Float[Array, " nv"]
    notes: tuple[str, ...] = ()


def stated_limits(robot: Robot) -> StatedLimits:
    """Limits that a robot states; one of zero or beyond a million counts as none, as do those of a continuous joint."""
    model = robot.model
    joints = list(model.joints)[1:]
    names = tuple(model.names)[1:]
    single = [joint.nq == 1 for joint in joints]
    lower = np.array(
        [model.lowerPositionLimit[j.idx_q] if one else -np.inf for j, one in zip(joints, single, strict=True)]
    )
    upper = np.array(
        [model.upperPositionLimit[j.idx_q] if one else np.inf for j, one in zip(joints, single, strict=True)]
    )
    lower[~(np.abs(lower) < _HUGE)] = -np.inf
    upper[~(np.abs(upper) < _HUGE)] = np.inf
    torque = _or_none(np.array(model.effortLimit))[list(robot.tree_rows)]
    for row, drive in enumerate(robot.actuators):
        if drive.torque_limit is not None:
            torque[row] = drive.torque_limit
    notes = []
    for name, low, high in zip(names, lower, upper, strict=True):
        if not low < high:
            raise RobotError(
                f"{robot.source} lets {name} move from {low:g} to {high:g}, which leaves no room: widen its limits, or "
                f"hold it with lock: [{name}] in robot.yaml."
            )
    if not np.isfinite(torque).all():
        unlimited = [name for name, limit in zip(robot.joint_names, torque, strict=True) if not np.isfinite(limit)]
        notes.append(f"The robot states no torque limit of {', '.join(unlimited)}: none is kept there.")
    linear = linear_joints(model)
    return StatedLimits(names, linear, lower, upper, _or_none(np.array(model.velocityLimit)), torque, tuple(notes))


def require_excitable(robot: Robot, frames: Sequence[str]) -> None:
    """Refuse what no motion can be designed for.

    Raises:
        RobotError: If a joint has no drive, a frame is unknown, or a loop is not linear.
    """
    idle = [name for name, drive in zip(robot.joint_names, robot.actuators, strict=True) if not drive.actuated]
    if idle:
        raise RobotError(
            f"{', '.join(idle)} of {robot.name} has no drive that could follow a reference: hold it with "
            f"lock: [{', '.join(idle)}] in robot.yaml."
        )
    if robot.chain is not None and robot.chain.anchors:
        raise RobotError(
            f"{robot.name} has the loop {robot.chain.anchors[0].label}, and excitation takes chains whose passive "
            "joints follow by kind: linear only: use a reference of your own."
        )
    known = dict.fromkeys(frame.name for frame in robot.model.frames)
    for name in frames:
        if name not in known:
            raise RobotError(f"{robot.name} has no frame {name!r}: {known_names(name, known, 'frames')}")


def _or_none(limit: Float[Array, " n"]) -> Float[Array, " n"]:
    return np.where((limit > 0) & (limit < _HUGE), limit, np.inf)
