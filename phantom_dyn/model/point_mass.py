# pyright: reportAttributeAccessIssue=false
"""A point mass on the link that carries the payload: which body that is, and its ten inertial parameters."""

from __future__ import annotations

import numpy as np

from phantom_dyn.model.inertia import body_parameters
from phantom_dyn.model.robot import Robot

Array = np.ndarray

_TIP = "tip"


def payload_body(robot: Robot) -> int:
    """Pinocchio index of the joint whose link carries the payload.

    The last link of a tree with several ends is that of the end that the file happens to state last, so a frame that is
    called ``tip``, as in the built-in robots, says it better.
    """
    frame = robot.payload_frame or _TIP
    if robot.model.existFrame(frame) and robot.model.frames[robot.model.getFrameId(frame)].parentJoint > 0:
        return robot.model.frames[robot.model.getFrameId(frame)].parentJoint
    return robot.model.njoints - 1


def point_mass_parameters(mass: float, center: Array) -> Array:
    """The ten standard inertial parameters of a point mass at ``center`` [m], about the joint origin."""
    return body_parameters(mass, np.asarray(center), np.zeros((3, 3)))
