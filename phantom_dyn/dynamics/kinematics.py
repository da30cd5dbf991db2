# pyright: reportAttributeAccessIssue=false
"""Pose and Jacobian of a frame over whole trajectories, and joint torques for a wrench at a frame."""

from __future__ import annotations

from typing import Literal

import numpy as np

from phantom_dyn._kernels import rigid_body
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.tree_motion import tree_at_rest
from phantom_dyn.errors import RobotError, known_names
from phantom_dyn.model.robot import Robot


def frame_index(robot: Robot, frame: str) -> int:
    """Index of a frame in the robot's model.

    Raises:
        RobotError: If there is no frame of this name.
    """
    if not robot.model.existFrame(frame):
        names = dict.fromkeys(f.name for f in robot.model.frames)
        raise RobotError(f"{robot.name} has no frame {frame!r}: {known_names(frame, names, 'frames')}")
    return robot.model.getFrameId(frame)


def frame_pose(robot: Robot, q: Float[Array, "N nv"], frame: str) -> tuple[Float[Array, "N 3 3"], Float[Array, "N 3"]]:
    """Orientation and position [m] of a frame in the root frame.

    Args:
        robot: The robot.
        q: Joint positions [rad or m], shape ``(N, nv)``.
        frame: Name of the frame.

    Raises:
        RobotError: If the robot has no such frame.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    index = frame_index(robot, frame)
    return rigid_body.frame_pose(robot.model, robot.arrays, tree_at_rest(robot, q).configuration, index)


def frame_jacobian(
    robot: Robot, q: Float[Array, "N nv"], frame: str, axes: Literal["body", "hybrid"]
) -> Float[Array, "N 6 nv"]:
    """Jacobian of the twist of a frame: rows of the velocity of its origin, then of its angular velocity.

    Args:
        robot: The robot; the columns are those of its active joints.
        q: Joint positions [rad or m], shape ``(N, nv)``.
        frame: Name of the frame.
        axes: Axes of the twist: ``body`` for the frame's own axes, ``hybrid`` for those of the root frame.

    Raises:
        RobotError: If the robot has no such frame.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    index, tree = frame_index(robot, frame), tree_at_rest(robot, q)
    J = rigid_body.frame_jacobian(robot.model, robot.arrays, tree.configuration, index, body=axes == "body")
    return J if robot.chain is None else J @ tree.G


def wrench_torque(
    robot: Robot, q: Float[Array, "N nv"], wrench: Float[Array, "N 6"], frame: str
) -> Float[Array, "N nv"]:
    """Drive torque with which a frame exerts a wrench, at rest and without gravity.

    Args:
        robot: The robot.
        q: Joint positions [rad or m], shape ``(N, nv)``.
        wrench: Force [N], then moment about the frame's origin [N m], in the root frame's axes, shape ``(N, 6)``.
        frame: Name of the frame.

    Returns:
        ``J^T F`` [N m or N], shape ``(N, nv)``.

    Raises:
        RobotError: If the robot has no such frame.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    return np.einsum("nij,ni->nj", frame_jacobian(robot, q, frame, "hybrid"), wrench)
