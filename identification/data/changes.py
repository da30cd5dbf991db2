# pyright: reportAttributeAccessIssue=false
"""Data types of the changes between recordings, and the robot's model with a known payload or known controllers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from identification.data.change_kinds import Kind
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.inertia import payload_body, point_mass_parameters
from phantom_dyn.model.robot import Controller, Robot


@dataclass(frozen=True)
class KnownPayload:
    """A point mass [kg] and its centre [m] in the ``payload_frame`` of ``robot.yaml``.

    If ``robot.yaml`` has no ``payload_frame``, the centre is in the frame of the joint that moves the mass.
    """

    mass: float
    center: tuple[float, float, float]


@dataclass(frozen=True)
class Change:
    """How one recording differs from the others.

    Attributes:
        file: Name of the recording, for messages.
        payload: A known mass that the robot carries in addition to the model.
        controllers: Position controllers by joint, for joints whose controller differs from that in the robot's model.
        changed: Kinds of change that the user has named, with or without their size.
        exclude: Intervals of the recording's time [s] to leave out of every fit.
        beside: Further files that hold more columns of the same samples.
    """

    file: str
    payload: KnownPayload | None = None
    controllers: Mapping[str, Controller] = field(default_factory=dict)
    changed: tuple[Kind, ...] = ()
    exclude: tuple[tuple[float, float], ...] = ()
    beside: tuple[str, ...] = ()

    @property
    def unknown(self) -> tuple[Kind, ...]:
        """Kinds of change in ``changed`` for which neither ``payload`` nor ``controllers`` gives the size."""
        known = {"payload": self.payload is not None, "controller": bool(self.controllers)}
        return tuple(kind for kind in self.changed if not known.get(kind, False))


def robot_in(robot: Robot, change: Change) -> Robot:
    """The robot's model with the known payload and controllers of one recording; ``robot`` itself if there are none."""
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
    """``robot`` with a point mass on the link that `phantom_dyn.model.inertia.payload_body` chooses."""
    body = payload_body(robot)
    added = np.zeros_like(standard_parameters(robot))
    added[10 * (body - 1) : 10 * body] = point_mass_parameters(payload.mass, payload_center(robot, payload))
    return with_parameters(robot, added)


def payload_center(robot: Robot, payload: KnownPayload) -> Float[Array, " 3"]:
    """Centre of the mass [m] in the frame of the joint that moves the mass. Findings use this frame."""
    return np.asarray(_placement_of_centers(robot).act(np.array(payload.center, dtype=float)))


def written_center(robot: Robot, center: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Inverse of `payload_center`: a centre [m] in the joint's frame, converted to the frame of `KnownPayload`."""
    return np.asarray(_placement_of_centers(robot).actInv(np.asarray(center, dtype=float)))


def _placement_of_centers(robot: Robot) -> pin.SE3:
    """Placement of the frame of `KnownPayload.center` in the frame of the joint that moves the mass."""
    # A frame named tip only selects the link that carries the mass. Centres are not given in that frame.
    if robot.payload_frame is None:
        return pin.SE3.Identity()
    return robot.model.frames[robot.model.getFrameId(robot.payload_frame)].placement
