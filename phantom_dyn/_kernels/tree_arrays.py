# pyright: reportAttributeAccessIssue=false
"""Arrays that describe a Pinocchio model to compiled code: joints, placements, axes and bodies of its tree."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, read_only
from phantom_dyn.errors import RobotError

REVOLUTE, CONTINUOUS, PRISMATIC = 1, 2, 3
"""Kinds of joints; the configuration of a continuous one is the cosine and the sine of its angle."""
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
}


class Kinematics(NamedTuple):
    """Arrays of `TreeArrays` that describe joints without their bodies; rotations have shape ``(3 n, 3, 3)``."""

    parents: Array
    kinds: Array
    first_q: Array
    first_v: Array
    rotations: Array
    translations: Array
    axes: Array


@dataclass(frozen=True)
class TreeArrays:
    """A tree of ``n - 1`` joints, as read-only arrays; entry 0 is the root, entry j is Pinocchio's joint j.

    Attributes:
        parents: Parent of each joint, shape ``(n,)``.
        kinds: ``REVOLUTE``, ``CONTINUOUS`` or ``PRISMATIC``, 0 for the root, shape ``(n,)``.
        first_q: Index of each joint's first configuration entry, shape ``(n,)``.
        first_v: Index of each joint's velocity, shape ``(n,)``.
        rotations: Three matrices for each joint, shape ``(n, 3, 3, 3)``. The rotation of the joint in its parent is
            ``[0] + cos(q) [1] + sin(q) [2]``, or ``[0]`` alone for a prismatic joint.
        translations: Origin of each joint in its parent at position zero [m], shape ``(n, 3)``.
        axes: Axis or direction of each joint in its own frame, shape ``(n, 3)``.
        inertias: Ten parameters ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` of each joint's body about the joint
            origin in SI units, shape ``(n, 10)``.
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
        """The arrays without the inertias."""
        return Kinematics(
            self.parents,
            self.kinds,
            self.first_q,
            self.first_v,
            self.rotations.reshape(-1, 3, 3),
            self.translations,
            self.axes,
        )


def tree_arrays(model: pin.Model) -> TreeArrays:
    """Arrays of a model.

    Raises:
        RobotError: If the model has a joint that is not revolute, continuous or prismatic.
    """
    count = model.njoints
    names = [joint.shortname() for joint in list(model.joints)[1:]]
    unknown = [name for name in names if name not in _KINDS]
    if unknown:
        raise RobotError(f"A joint is a {unknown[0]}: give a model of revolute, continuous and linear joints only.")
    kinds = [0, *(_KINDS[name] for name in names)]
    rotations, translations, axes = np.zeros((count, 3, 3, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    inertias, first_q, first_v = np.zeros((count, 10)), np.zeros(count, np.int64), np.zeros(count, np.int64)
    rotations[0, 0] = np.eye(3)
    twists = _unit_twists(model)
    for j in range(1, count):
        joint, placed = model.joints[j], model.jointPlacements[j]
        first_q[j], first_v[j] = joint.idx_q, joint.idx_v
        inertias[j] = model.inertias[j].toDynamicParameters()
        translations[j] = placed.translation
        rotations[j, 0] = placed.rotation
        if kinds[j] == PRISMATIC:
            axes[j] = twists[j].linear
        else:
            x, y, z = axes[j] = twists[j].angular
            along = np.outer(axes[j], axes[j])
            across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            # Placement times the three terms of Rodrigues' formula.
            rotations[j] = [placed.rotation @ part for part in (along, np.eye(3) - along, across)]
    parents = np.array(model.parents, np.int64)
    return TreeArrays(parents, np.array(kinds), first_q, first_v, rotations, translations, axes, inertias)


def _unit_twists(model: pin.Model) -> list[pin.Motion]:
    """Velocity of each joint in its own frame if only this joint moves, at a velocity of one."""
    data, neutral, twists = model.createData(), pin.neutral(model), [pin.Motion.Zero()]
    for j in range(1, model.njoints):
        v = np.zeros(model.nv)
        v[model.joints[j].idx_v] = 1.0
        pin.forwardKinematics(model, data, neutral, v)
        twists.append(pin.Motion(data.v[j]))
    return twists
