# pyright: reportAttributeAccessIssue=false
"""Where the links of a robot are over time."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot


def link_poses(robot: Robot, q: Float[Array, "n nv"]) -> Float[Array, "n J 7"]:
    """Pose of each joint's frame in the root frame: x, y, z [m], then the unit quaternion w, x, y, z.

    Args:
        robot: Joints are those of Pinocchio's model; the first is the root itself.
        q: Positions [rad or m].

    Returns:
        NaN where a position is none, or the loops of a closed chain cannot be closed.
    """
    model = robot.model
    data = model.createData()
    out = np.full((len(q), model.njoints, 7), np.nan)
    for row in np.flatnonzero(np.isfinite(q).all(axis=1)):
        try:
            pin.forwardKinematics(model, data, robot.configuration(q[row : row + 1])[0])
        except ChainError:
            continue
        for joint, place in enumerate(data.oMi):
            x, y, z, qx, qy, qz, qw = pin.SE3ToXYZQUAT(place)
            out[row, joint] = x, y, z, qw, qx, qy, qz
    return out
