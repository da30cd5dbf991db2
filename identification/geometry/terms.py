# pyright: reportAttributeAccessIssue=false
"""What may be wrong with the geometry of a robot: one number each, with the joint that it belongs to.

Joint zeros (``encoder_offset``), the six numbers by which a joint sits elsewhere on its parent (``link_geometry``), the
deflection of a joint under its load (``joint_elasticity``), and, where poses are told in the robot's root frame, the
six numbers by which the base stands elsewhere (``base_pose``) and a target sits elsewhere on its frame (``tool_pose``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from phantom_dyn.model.robot import Robot

Array = np.ndarray

ZERO, LINK, ELASTIC = "encoder_offset", "link_geometry", "joint_elasticity"
BASE_POSE, TOOL_POSE = "base_pose", "tool_pose"
PLACES = (LINK, BASE_POSE, TOOL_POSE)
"""Effects that are a pose: six numbers, of which those are told that are wrong."""
PARTS = ("x", "y", "z", "rx", "ry", "rz")
_ALONG = 1.0 - 1e-9  # cosine above which a joint moves along one of its own axes


@dataclass(frozen=True)
class Term:
    """One number that the geometry of a robot may lack.

    Attributes:
        effect: ``encoder_offset``, ``link_geometry``, ``joint_elasticity``, ``base_pose`` or ``tool_pose``.
        joint: The joint; the frame of a ``tool_pose``, None for a ``base_pose``.
        row: Of the joint among the velocities; -1 without a joint.
        parameter: Name of the number.
        unit: Of the number.
        part: Of a pose, which of its six numbers; else -1.
        largest: Beyond this the number is not plausible, in its unit: a place that is off by a decimetre or an angle by
            half a radian is seen by eye, and a joint that gives way by a tenth of a radian at one newton metre as well.
    """

    effect: str
    joint: str | None
    row: int
    parameter: str
    unit: str
    part: int = -1
    largest: float = np.inf

    @property
    def place(self) -> tuple[str, str | None]:
        """Effect and joint: terms of the same place make one finding."""
        return self.effect, self.joint


def pose_terms(effect: str, of: str | None, parts: int = 6) -> tuple[Term, ...]:
    """The numbers of a ``base_pose`` or ``tool_pose``: three where orientations were not measured."""
    return tuple(_pose_term(effect, of, -1, part) for part in range(parts))


def _pose_term(effect: str, joint: str | None, row: int, part: int) -> Term:
    linear = part < 3
    return Term(effect, joint, row, PARTS[part], "m" if linear else "rad", part, 0.1 if linear else 0.5)


def terms_of(robot: Robot, frames: Sequence[str]) -> tuple[Term, ...]:
    """All terms of the joints that carry one of the frames, from the root on.

    The part of a joint's place along or about its own axis is its zero and is left out of its ``link_geometry``. A
    joint whose encoder sits on its link shows the elasticity of its transmission itself, so that there is none.

    Args:
        robot: A tree with one velocity a joint.
        frames: Names.
    """
    model, out = robot.model, []
    carrying = {int(k) for frame in frames for k in model.supports[_parent(robot, frame)]} - {0}
    for index in sorted(carrying):
        row = model.joints[index].idx_v
        joint, unit, torque = robot.joint_names[row], robot.position_units[row], robot.torque_units[row]
        far = 0.1 if robot.prismatic[row] else 0.5
        out.append(Term(ZERO, joint, row, "offset", unit, largest=far))
        own = moved_part(robot, index)
        out += [_pose_term(LINK, joint, row, part) for part in range(len(PARTS)) if part != own]
        if robot.actuators[row].encoder_side == "motor":
            out.append(Term(ELASTIC, joint, row, "compliance", f"{unit}/({torque})", largest=0.1))
    return tuple(out)


def moved_part(robot: Robot, index: int) -> int:
    """Which of its own six directions a joint moves along or about; -1 if along none of them alone.

    Args:
        robot: Gives the model.
        index: Pinocchio's of the joint.
    """
    direction = np.abs(subspace(robot.model, index))
    part = int(np.argmax(direction))
    return part if direction[part] > _ALONG * np.linalg.norm(direction) else -1


def subspace(model: pin.Model, index: int) -> Float[Array, " 6"]:
    """Twist of a joint per unit of its velocity, in the joint's own axes."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    return pin.getJointJacobian(model, data, index, pin.LOCAL)[:, model.joints[index].idx_v]


def _parent(robot: Robot, frame: str) -> int:
    return robot.model.frames[robot.model.getFrameId(frame)].parentJoint
