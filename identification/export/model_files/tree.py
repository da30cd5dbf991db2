# pyright: reportAttributeAccessIssue=false
"""Extracts bodies, joints, frames and friction of a robot as plain data for writing model files."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.tree_motion import TreeMotion, tree_friction
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import body_name, central_parameters, impossible_because
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class TreeBody:
    """One moving body with its joint.

    Attributes:
        name: Name of the link.
        parent: Index of the parent body; -1 for the ground.
        joint: Name of the joint.
        prismatic: True if the joint is linear.
        rotation: Orientation of the joint in the parent's frame.
        position: Position of the joint in the parent's frame [m].
        axis: Axis of the joint, in the joint's frame.
        limits: Lower and upper position [rad or m]; None without limits.
        inertia: Inertia of the body in the joint's frame.
        damping: Viscous friction coefficient of the joint [N m s/rad or N s/m].
        friction: Coulomb friction of the joint [N m or N].
        armature: Rotor inertia of the joint [kg m^2 or kg].
    """

    name: str
    parent: int
    joint: str
    prismatic: bool
    rotation: Float[Array, "3 3"]
    position: Float[Array, " 3"]
    axis: Float[Array, " 3"]
    limits: tuple[float, float] | None
    inertia: LinkInertia
    damping: float
    friction: float
    armature: float


@dataclass(frozen=True)
class TreeFrame:
    """A named frame that is fixed to the body with index ``body``, or to the ground if the index is -1."""

    name: str
    body: int
    rotation: Float[Array, "3 3"]
    position: Float[Array, " 3"]


def bodies(robot: Robot) -> tuple[TreeBody, ...]:
    """The moving bodies of a robot, parents first.

    Raises:
        ParameterError: If the inertia of a body is physically impossible.
    """
    model = robot.model
    viscous, coulomb = tree_friction(robot)
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    out = []
    for j in range(1, model.njoints):
        joint = model.joints[j]
        jacobian = pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL)
        column = np.reshape(jacobian, (6, -1))[:, joint.idx_v]  # one-dimensional for a robot with one joint
        prismatic = bool(np.abs(column[:3]).sum() > 0.5)
        mass, center, inertia = central_parameters(model.inertias[j].toDynamicParameters())
        name = body_name(robot, j)
        reason = impossible_because(mass, inertia)
        if reason is not None:
            raise ParameterError(f"The link {name} cannot exist with its inertia, {reason}: record more motion.")
        low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
        out.append(
            TreeBody(
                name=name,
                parent=model.parents[j] - 1,
                joint=model.names[j],
                prismatic=prismatic,
                rotation=np.array(model.jointPlacements[j].rotation),
                position=np.array(model.jointPlacements[j].translation),
                axis=column[:3] if prismatic else column[3:],
                limits=(low, high) if joint.nq == 1 and np.isfinite([low, high]).all() and low < high else None,
                inertia=LinkInertia(mass, center, inertia),
                damping=float(viscous[joint.idx_v]),
                friction=float(coulomb[joint.idx_v]),
                armature=float(model.armature[joint.idx_v]),
            )
        )
    return tuple(out)


def frames(robot: Robot) -> tuple[TreeFrame, ...]:
    """Fixed links and named frames of a robot, such as the tip of a tool; without moving bodies and joints.

    If several frames have the same name, only the first is returned.
    """
    model = robot.model
    names = {body_name(robot, j) for j in range(1, model.njoints)} | {"universe", "world"}
    out = []
    for frame in model.frames:
        if frame.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME) and frame.name not in names:
            names.add(frame.name)
            placement = frame.placement
            rotation, position = np.array(placement.rotation), np.array(placement.translation)
            out.append(TreeFrame(frame.name, frame.parentJoint - 1, rotation, position))
    return tuple(out)


def tree_torque(robot: Robot, tree: TreeMotion) -> Float[Array, "N nt"]:
    """Torque [N m or N] that links, rotors and friction need on every joint of the tree, as if each had a drive.

    Args:
        robot: The robot.
        tree: N samples of the motion of all joints.
    """
    viscous, coulomb = tree_friction(robot)
    data = robot.model.createData()
    rigid = [
        np.array(pin.rnea(robot.model, data, q, v, a))
        for q, v, a in zip(tree.configuration, tree.v, tree.a, strict=True)
    ]
    return np.reshape(rigid, tree.v.shape) + viscous * tree.v + coulomb * np.sign(tree.v)


def with_tree_friction(robot: Robot, viscous: Float[Array, " nt"], coulomb: Float[Array, " nt"]) -> Robot:
    """The robot with the given viscous and Coulomb friction on every joint of its tree."""
    active = list(robot.tree_rows)
    chain = robot.chain
    if chain is not None:
        passive = list(chain.passive)
        chain = replace(chain, viscous_friction=viscous[passive], coulomb_friction=coulomb[passive])
    return replace(robot, viscous_friction=viscous[active], coulomb_friction=coulomb[active], chain=chain)


@dataclass(frozen=True)
class LinkInertia:
    """Inertia of one link in the axes of its own frame.

    Attributes:
        mass: Mass [kg].
        center: Centre of mass [m].
        inertia: Moments and products about the centre of mass [kg m^2].
    """

    mass: float
    center: Float[Array, " 3"]
    inertia: Float[Array, "3 3"]
