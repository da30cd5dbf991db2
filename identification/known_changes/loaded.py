# pyright: reportAttributeAccessIssue=false
"""The robot of one recording: the given one with the load and the controllers that are known of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identification.known_changes.change import Change, KnownPayload
from phantom_dyn.dynamics import standard_parameters
from phantom_dyn.effects.changed_robot import with_parameters
from phantom_dyn.effects.payload import payload_body, point_mass_parameters
from phantom_dyn.robot import Robot

Array = np.ndarray

_TIP = "tip"


def robot_in(robot: Robot, change: Change) -> Robot:
    """The given robot as it was in one recording; the very same object if nothing is known of it."""
    loaded = robot if change.payload is None or change.payload.mass == 0 else with_payload(robot, change.payload)
    if not change.controllers:
        return loaded
    pairs = zip(robot.joint_names, loaded.actuators, strict=True)
    return replace(
        loaded,
        actuators=tuple(
            replace(actuator, controller=change.controllers.get(joint, actuator.controller))
            for joint, actuator in pairs
        ),
    )


def with_payload(robot: Robot, payload: KnownPayload) -> Robot:
    """``robot`` with a point mass on ``payload_frame``, else on the link with frame ``tip``, else on the last."""
    body = payload_body(robot)
    added = np.zeros_like(standard_parameters(robot))
    added[10 * (body - 1) : 10 * body] = point_mass_parameters(payload.mass, payload_center(robot, payload))
    return with_parameters(robot, added)


def payload_center(robot: Robot, payload: KnownPayload) -> Float[Array, " 3"]:
    """Centre of the mass [m] in the frame of the joint that moves its link, as findings state it."""
    center = np.array(payload.center, dtype=float)
    frame = robot.payload_frame or _TIP
    if robot.model.existFrame(frame):
        found = robot.model.frames[robot.model.getFrameId(frame)]
        if found.parentJoint == payload_body(robot):
            return np.asarray(found.placement.act(center))
    return center
