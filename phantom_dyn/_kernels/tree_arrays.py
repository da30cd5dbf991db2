# pyright: reportAttributeAccessIssue=false
"""A Pinocchio model as arrays for compiled code: joints, placements, axes and bodies of its tree."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, read_only

REVOLUTE, CONTINUOUS, PRISMATIC, FREE = 1, 2, 3, 4
"""Kinds of joints: the configuration of a continuous one is cos, sin, that of a free one position and quaternion."""
_KINDS = {
    "JointModelRX": REVOLUTE,
    "JointModelRY": REVOLUTE,
    "JointModelRZ": REVOLUTE,
    "JointModelRevoluteUnaligned": REVOLUTE,
    "JointModelRUBX": CONTINUOUS,
    "JointModelRUBY": CONTINUOUS,
    "JointModelRUBZ": CONTINUOUS,
    "JointModelRevoluteUnboundedUnaligned": CONTINUOUS,
    "JointModelPX": PRISMATIC,
    "JointModelPY": PRISMATIC,
    "JointModelPZ": PRISMATIC,
    "JointModelPrismaticUnaligned": PRISMATIC,
    "JointModelFreeFlyer": FREE,
}


class Kinematics(NamedTuple):
    """Arrays of a tree that place its joints: those of `TreeArrays`, rotations as ``(3 n, 3, 3)``."""

    parents: Array
    kinds: Array
    first_q: Array
    first_v: Array
    rotations: Array
    translations: Array
    axes: Array


@dataclass(frozen=True)
class TreeArrays:
    """A tree of ``n - 1`` joints; entry 0 is the root, joint j is Pinocchio's joint j. All arrays are read-only.

    Attributes:
        parents: Joint that carries joint j, shape ``(n,)``.
        kinds: ``REVOLUTE``, ``CONTINUOUS`` (configuration cos, sin), ``PRISMATIC`` or ``FREE`` (a floating base:
            position, quaternion), 0 for the root, shape ``(n,)``.
        first_q: Place of its configuration in Pinocchio's vector, shape ``(n,)``.
        first_v: Place of its velocity, shape ``(n + 1,)``: joint j has velocities ``first_v[j]`` to ``first_v[j + 1]``.
        rotations: Its rotation in the joint that carries it is ``[0] + cos(q) [1] + sin(q) [2]`` (``[0]`` alone where
            it does not turn, and before its own quaternion where it floats), shape ``(n, 3, 3, 3)``.
        translations: Its origin in the joint that carries it at position zero [m], shape ``(n, 3)``.
        axes: Its axis or direction in its own frame, zero of a floating base, shape ``(n, 3)``.
        inertias: Ten parameters ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` of its body about the joint origin in
            SI units, shape ``(n, 10)``.
    """

    parents: Array
    kinds: Array
    first_q: Array
    first_v: Array
    rotations: Array
    translations: Array
    axes: Array
    inertias: Array

    def __post_init__(self):
        for field in fields(self):
            array = getattr(self, field.name)
            object.__setattr__(self, field.name, read_only(array, array.dtype.type))

    @property
    def kinematics(self) -> Kinematics:
        """All but the inertias."""
        return Kinematics(
            self.parents,
            self.kinds,
            self.first_q,
            self.first_v,
            self.rotations.reshape(-1, 3, 3),
            self.translations,
            self.axes,
        )


def tree_arrays(model: pin.Model) -> TreeArrays | None:
    """Arrays of a model, or None if it has a joint that is not revolute, continuous, prismatic or a floating base."""
    count = model.njoints
    kinds = [0, *(_KINDS.get(joint.shortname(), 0) for joint in list(model.joints)[1:])]
    if 0 in kinds[1:] or (model.gravity.angular != 0).any():
        return None
    rotations, translations, axes = np.zeros((count, 3, 3, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    inertias, first_q, first_v = np.zeros((count, 10)), np.zeros(count, np.int64), np.zeros(count + 1, np.int64)
    rotations[0, 0] = np.eye(3)
    twists = _unit_twists(model)
    for j in range(1, count):
        joint, placed = model.joints[j], model.jointPlacements[j]
        first_q[j], first_v[j], first_v[j + 1] = joint.idx_q, joint.idx_v, joint.idx_v + joint.nv
        inertias[j] = model.inertias[j].toDynamicParameters()
        translations[j] = placed.translation
        rotations[j, 0] = placed.rotation
        if kinds[j] == PRISMATIC:
            axes[j] = twists[j].linear
        elif kinds[j] != FREE:
            x, y, z = axes[j] = twists[j].angular
            along = np.outer(axes[j], axes[j])
            across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            # Rodrigues' formula behind the placement.
            rotations[j] = [placed.rotation @ part for part in (along, np.eye(3) - along, across)]
    parents = np.array(model.parents, np.int64)
    return TreeArrays(parents, np.array(kinds), first_q, first_v, rotations, translations, axes, inertias)


def _unit_twists(model: pin.Model) -> list[pin.Motion]:
    """Velocity of each joint in its own frame while it alone moves, at one unit in its first velocity."""
    data, neutral, twists = model.createData(), pin.neutral(model), [pin.Motion.Zero()]
    for j in range(1, model.njoints):
        v = np.zeros(model.nv)
        v[model.joints[j].idx_v] = 1.0
        pin.forwardKinematics(model, data, neutral, v)
        twists.append(pin.Motion(data.v[j]))
    return twists
