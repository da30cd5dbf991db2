# pyright: reportAttributeAccessIssue=false
"""Measured forces on a robot as torques on its joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Float

from phantom_dyn.errors import LogError
from phantom_dyn.kinematics import wrench_torque
from phantom_dyn.naming import known_names
from phantom_dyn.robot import Robot

Array = np.ndarray


def external_torque(
    robot: Robot, q: Float[Array, "N nv"], forces: Mapping[str, Float[Array, "N 3"]]
) -> Float[Array, "N nv"]:
    r"""Torque :math:`\sum J^T f` that forces on the robot put on its joints, :math:`(N, nv)` [N m or N].

    Args:
        robot: Gives frames and loops.
        q: Joint positions [rad or m].
        forces: Force on the robot [N], world axes, by the frame at whose origin it acts.

    Raises:
        LogError: If the robot has no such frame, or a force is not finite.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    require_frames(robot, forces)
    out = np.zeros_like(q)
    for frame, force in forces.items():
        if not np.isfinite(force).all():
            row = int(np.argwhere(~np.isfinite(force))[0, 0])
            raise LogError(f"The force f.{frame} is not finite at sample {row}: give finite numbers or leave it out.")
        out += wrench_torque(robot, q, np.hstack([force, np.zeros_like(force)]), frame)
    return out


def require_frames(robot: Robot, frames: Iterable[str]) -> None:
    """Refuse a force at a frame that the robot does not have.

    Raises:
        LogError: It lists the frames that there are.
    """
    for frame in frames:
        if not robot.model.existFrame(frame):
            names = dict.fromkeys(f.name for f in robot.model.frames)
            raise LogError(
                f"The columns f.{frame}.x, .y and .z are a force at a frame that {robot.name} does not have: "
                f"{known_names(frame, names, 'frames')}"
            )
