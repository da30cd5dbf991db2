# pyright: reportAttributeAccessIssue=false
"""Candidate errors of a robot's geometry, called terms. Each term is one number of an effect on a joint or frame.

- ``encoder_offset``: the zero of a joint.
- ``link_geometry``: six numbers of the placement of a joint on its parent; in closed chains also of a loop's frames.
- ``joint_elasticity``: the compliance of a joint under its load.
- ``base_pose``, ``tool_pose``: six numbers of the pose of the base, and of a target on its frame. They are terms only
  if poses are given in the robot's root frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from identification.geometry.pins import Loops, joints_of_loop
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot

ZERO, LINK, ELASTIC = "encoder_offset", "link_geometry", "joint_elasticity"
BASE_POSE, TOOL_POSE = "base_pose", "tool_pose"
PLACES = (LINK, BASE_POSE, TOOL_POSE)
"""Effects whose terms are the six numbers of a pose."""
PARTS = ("x", "y", "z", "rx", "ry", "rz")
_ALONG = 1.0 - 1e-9  # above this cosine a joint moves along one of its own axes


@dataclass(frozen=True)
class PoseTerm:
    """One candidate error of the geometry.

    Attributes:
        effect: ``encoder_offset``, ``link_geometry``, ``joint_elasticity``, ``base_pose`` or ``tool_pose``.
        joint: Name of the joint; name of the frame for a ``tool_pose`` and for a loop's pin; None for a ``base_pose``.
        row: Index of the joint, -1 without a joint. For ``encoder_offset`` and ``joint_elasticity`` it counts the
            robot's joints, for ``link_geometry`` the velocities of the tree; these differ in closed chains only.
        parameter: Name of the number.
        unit: Unit of the number.
        part: Index of the number among the six of a pose; -1 for other effects.
        largest: Largest plausible value. Larger errors are seen by eye: a placement that is wrong by a decimetre or
            half a radian, or a joint that yields by a tenth of a radian under one newton metre.
        frame: Pinocchio's index of the frame of a loop's pin; -1 for all other terms.
    """

    effect: str
    joint: str | None
    row: int
    parameter: str
    unit: str
    part: int = -1
    largest: float = np.inf
    frame: int = -1

    @property
    def effect_joint(self) -> tuple[str, str | None]:
        """Effect and joint: terms that agree in both make one finding."""
        return self.effect, self.joint


def bounds_of(terms: Sequence[PoseTerm]) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
    """Least and largest plausible value of each term. A compliance is not negative."""
    largest = np.array([term.largest for term in terms])
    return np.where([term.effect == ELASTIC for term in terms], 0.0, -largest), largest


def pose_terms(effect: str, of: str | None, parts: int = 6) -> tuple[PoseTerm, ...]:
    """Terms of a ``base_pose`` or ``tool_pose``: six, or with ``parts=3`` the position only."""
    return tuple(_pose_term(effect, of, -1, part) for part in range(parts))


def _pose_term(effect: str, joint: str | None, row: int, part: int) -> PoseTerm:
    """The term of number ``part`` of a pose."""
    linear = part < 3
    return PoseTerm(effect, joint, row, PARTS[part], "m" if linear else "rad", part, 0.1 if linear else 0.5)


def terms_of(robot: Robot, frames: Sequence[str], loops: Loops | None = None) -> tuple[PoseTerm, ...]:
    """All terms of the joints that carry one of the frames, directly or through loops, from the root outwards.

    - The part of a joint's placement along or about the joint axis equals ``encoder_offset`` and is no term of
      ``link_geometry``.
    - A joint has a ``joint_elasticity`` only if its encoder is on the motor. An encoder on the link measures the
      deflection.
    - Passive joints have terms of ``link_geometry`` only. The part along or about the axis is a term if a formula
      determines the joint's position, because it is the formula's constant. It is no term if a loop determines the
      position.

    Args:
        robot: A robot with one velocity per joint.
        frames: Names of the measured frames.
        loops: Loops of a closed chain.
    """
    model, out = robot.model, []
    carrying = {
        int(k)
        for frame in frames
        for k in model.supports[robot.model.frames[robot.model.getFrameId(frame)].parentJoint]
    } - {0}
    placed, pins = carrying, ()
    if loops is not None:
        placed, pins = _of_loops(loops, carrying)
        carrying = placed | _joints_in_formulas(loops, placed)
    active = {row: place for place, row in enumerate(robot.tree_rows)}
    for index in sorted(carrying):
        row, joint = model.joints[index].idx_v, model.names[index]
        place = active.get(row)
        if place is not None:
            unit = robot.position_units[place]
            out.append(PoseTerm(ZERO, joint, place, "offset", unit, largest=0.1 if robot.prismatic[place] else 0.5))
        free = place is not None or (loops is not None and row in loops.chain.unknowns)
        own = moved_part(robot, index) if free else -1
        if index in placed:
            out += [_pose_term(LINK, joint, row, part) for part in range(len(PARTS)) if part != own]
        if place is not None and robot.actuators[place].encoder_side == "motor":
            compliance = f"{robot.position_units[place]}/({robot.torque_units[place]})"
            out.append(PoseTerm(ELASTIC, joint, place, "compliance", compliance, largest=0.1))
    return (*out, *pins)


def _of_loops(loops: Loops, carrying: set[int]) -> tuple[set[int], tuple[PoseTerm, ...]]:
    """Joints that carry frames directly or through loops, and terms for the pins of these loops."""
    found, used = set(carrying), []
    for _ in loops.chain.anchors:  # a loop may share joints with frames only through other loops
        for one in loops.chain.anchors:
            if one not in used and joints_of_loop(loops.model, one) & found:
                found |= joints_of_loop(loops.model, one)
                used.append(one)
    parts: dict[int, int] = {}
    for one in used:
        for frame in (one.frame_a, one.frame_b):
            parts[frame] = max(parts.get(frame, 0), 6 if one.kind == "frame" else 3)
    named = dict(zip(loops.pins, loops.names, strict=True))
    pins = (replace(_pose_term(LINK, named[frame], -1, k), frame=frame) for frame in parts for k in range(parts[frame]))
    return found, tuple(pins)


def _joints_in_formulas(loops: Loops, placed: set[int]) -> set[int]:
    """Active joints on which the formulas of some joints depend, by Pinocchio's index."""
    model, chain = loops.model, loops.chain
    rows = [model.joints[index].idx_v for index in placed]
    columns = np.flatnonzero(np.any(chain.linear_map[rows][:, : chain.nv] != 0, axis=0))
    wanted = {chain.active[column] for column in columns}
    return {index for index in range(1, model.njoints) if model.joints[index].idx_v in wanted}


def moved_part(robot: Robot, index: int) -> int:
    """Index in `PARTS` of the axis along or about which a joint moves; -1 if the joint moves along none of these axes.

    Args:
        robot: The robot with its model.
        index: Pinocchio's index of the joint.
    """
    direction = np.abs(subspace(robot.model, index))
    part = int(np.argmax(direction))
    return part if direction[part] > _ALONG * np.linalg.norm(direction) else -1


def subspace(model: pin.Model, index: int) -> Float[Array, " 6"]:
    """Twist of a joint per unit of its velocity, in the joint's own axes."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    return pin.getJointJacobian(model, data, index, pin.LOCAL)[:, model.joints[index].idx_v]


def pose_of_numbers(numbers: Float[Array, " 6"]) -> pin.SE3:
    """The pose with translation ``x y z`` [m] and rotation vector ``rx ry rz`` [rad]."""
    return pin.SE3(pin.exp3(numbers[3:]), numbers[:3])
