# pyright: reportAttributeAccessIssue=false
"""Makes Pinocchio's model from MuJoCo's compiled model: the same joints, masses, rotors, friction and placements.

Several joints of one body become a series of joints with massless bodies between them. In the posture in which the file
draws the robot, a joint with the attribute ``ref`` is at the position ``ref``, as in MuJoCo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array

if TYPE_CHECKING:
    import mujoco

_AXES = {"RX": (1.0, 0.0, 0.0), "RY": (0.0, 1.0, 0.0), "RZ": (0.0, 0.0, 1.0)}
# Kinds of joints, by MuJoCo's mjtJoint; a hinge is 3.
_FREE, _BALL, _SLIDE = 0, 1, 2


def tree_of_mjcf(compiled: mujoco.MjModel) -> pin.Model:
    """Tree of joints with frames of its bodies and sites.

    ``referenceConfigurations["qpos0"]`` is the drawn posture.

    Args:
        compiled: MuJoCo's model, whose bodies and joints have names.
    """
    model = pin.Model()
    at: dict[int, tuple[int, pin.SE3, int]] = {0: (0, pin.SE3.Identity(), 0)}
    drawn: list[Array] = []
    for body in range(1, compiled.nbody):
        joint, place, frame = at[int(compiled.body_parentid[body])]
        place = place * pose_of(compiled.body_pos[body], compiled.body_quat[body])
        inertia = _inertia(compiled, body)
        joints = range(compiled.body_jntadr[body], compiled.body_jntadr[body] + compiled.body_jntnum[body])
        name = compiled.body(body).name
        if not len(joints):
            fixed = pin.Frame(f"{name}_fixed", joint, frame, place, pin.FrameType.FIXED_JOINT, inertia)
            frame = model.addFrame(fixed)
        for k in joints:
            joint, place = _add_joint(model, compiled, k, joint, place)
            frame = model.addJointFrame(joint, frame)
            drawn.append(_drawn(compiled, k))
        if len(joints):
            model.appendBodyToJoint(joint, inertia, place)
        frame = model.addFrame(pin.Frame(name, joint, frame, place, pin.FrameType.BODY, pin.Inertia.Zero()))
        at[body] = (joint, place, frame)
    for site in range(compiled.nsite):
        name = compiled.site(site).name
        if name and not model.existFrame(name):
            joint, place, frame = at[int(compiled.site_bodyid[site])]
            place = place * pose_of(compiled.site_pos[site], compiled.site_quat[site])
            model.addFrame(pin.Frame(name, joint, frame, place, pin.FrameType.OP_FRAME), False)
    _set_drives(model, compiled)
    if drawn:
        model.referenceConfigurations["qpos0"] = np.concatenate(drawn)
    return model


def _add_joint(model: pin.Model, compiled: mujoco.MjModel, k: int, parent: int, place: pin.SE3) -> tuple[int, pin.SE3]:
    """Add a joint, and return its index and the pose of the body in the frame of the joint."""
    kind, axis, position = int(compiled.jnt_type[k]), np.array(compiled.jnt_axis[k]), np.array(compiled.jnt_pos[k])
    address = int(compiled.jnt_qposadr[k])
    name = compiled.joint(k).name
    if kind == _FREE:
        return model.addJoint(parent, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name), pin.SE3.Identity()
    anchor = pin.SE3(np.eye(3), position)
    if kind == _BALL:
        return model.addJoint(parent, pin.JointModelSpherical(), place * anchor, name), anchor.inverse()
    reference = float(compiled.qpos0[address])
    if kind == _SLIDE:
        back = pin.SE3(np.eye(3), position - reference * axis)
        made: pin.JointModel = pin.JointModelPrismaticUnaligned(axis)
    else:
        back = pin.SE3(pin.AngleAxis(-reference, axis).toRotationMatrix(), position) if reference else anchor
        aligned = [word for word, known in _AXES.items() if np.array_equal(axis, known)]
        made = getattr(pin, f"JointModel{aligned[0]}")() if aligned else pin.JointModelRevoluteUnaligned(axis)
    limited = bool(compiled.jnt_limited[k])
    low, high = compiled.jnt_range[k] if limited else (-np.inf, np.inf)
    effort = np.abs(compiled.jnt_actfrcrange[k]).max() if compiled.jnt_actfrclimited[k] else np.inf
    ends = [np.array([float(value)]) for value in (effort, np.inf, low, high)]
    return model.addJoint(parent, made, place * back, name, *ends), anchor.inverse()


def _drawn(compiled: mujoco.MjModel, k: int) -> Array:
    """Pinocchio's configuration of a joint in the drawn posture."""
    address, kind = int(compiled.jnt_qposadr[k]), int(compiled.jnt_type[k])
    if kind == _FREE:
        w, x, y, z = compiled.qpos0[address + 3 : address + 7]
        return np.array([*compiled.qpos0[address : address + 3], x, y, z, w])
    if kind == _BALL:
        return np.array([0.0, 0.0, 0.0, 1.0])
    return np.array([compiled.qpos0[address]])


def _set_drives(model: pin.Model, compiled: mujoco.MjModel) -> None:
    """Set rotors, damping and dry friction; both models have the same order of velocities."""
    model.armature = np.array(compiled.dof_armature)
    model.damping = np.array(compiled.dof_damping)
    model.upperDryFrictionLimit = np.array(compiled.dof_frictionloss)
    model.lowerDryFrictionLimit = -np.array(compiled.dof_frictionloss)


def _inertia(compiled: mujoco.MjModel, body: int) -> pin.Inertia:
    """Inertia of a body in its own frame."""
    principal = pose_of(compiled.body_ipos[body], compiled.body_iquat[body])
    turn = principal.rotation
    inertia = turn @ np.diag(compiled.body_inertia[body]) @ turn.T
    return pin.Inertia(float(compiled.body_mass[body]), principal.translation, 0.5 * (inertia + inertia.T))


def pose_of(position: Array, quaternion: Array) -> pin.SE3:
    """Pose from a position [m] and MuJoCo's quaternion w x y z."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), np.array(position))
