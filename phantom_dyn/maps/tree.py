"""Kinematics, mass matrix and weight of a tree of joints, for a block of samples at once, in NumPy alone.

Components come first here, samples last: every operation then runs over contiguous samples, several times faster than
products of many small matrices. Nothing needs Pinocchio, so that a process that computes blocks starts at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Tree:
    """A tree of joints, parents before children.

    Attributes:
        parents: Index of the parent joint, -1 for the root, one per joint.
        rotations: Of each joint's placement in its parent, shape ``(nt, 3, 3)``.
        translations: Of the same [m], shape ``(nt, 3)``.
        angular: Rotation axis in the joint's frame, zero for a linear joint, shape ``(nt, 3)``.
        linear: Direction of translation, zero for a rotation, shape ``(nt, 3)``.
        masses: [kg], shape ``(nt,)``.
        centers: Centres of mass in the joint's frame [m], shape ``(nt, 3)``.
        inertias: About the centre of mass, in the joint's axes [kg m2], shape ``(nt, 3, 3)``.
        armature: Rotor inertia at the joint [kg m2 or kg], shape ``(nt,)``.
        gravity: In the root frame [m/s2], shape ``(3,)``.
        tip_joint: Joint that carries the tip.
        tip_offset: Tip in that joint's frame [m], shape ``(3,)``.
    """

    parents: tuple[int, ...]
    rotations: Array
    translations: Array
    angular: Array
    linear: Array
    masses: Array
    centers: Array
    inertias: Array
    armature: Array
    gravity: Array
    tip_joint: int
    tip_offset: Array

    @property
    def tip_path(self) -> tuple[int, ...]:
        """Joints from the root to the tip."""
        path, joint = [], self.tip_joint
        while joint >= 0:
            path.append(joint)
            joint = self.parents[joint]
        return tuple(reversed(path))


@dataclass(frozen=True)
class Pose:
    """Where a joint is in the root frame.

    Attributes:
        rotation: Shape ``(3, 3, N)``.
        origin: [m], shape ``(3, N)``.
        angular: Its rotation axis, zero for a linear joint, shape ``(3, N)``.
        linear: Its direction of translation, zero for a rotation, shape ``(3, N)``.
    """

    rotation: Array
    origin: Array
    angular: Array
    linear: Array


def _cross(a: Array, b: Array) -> Array:
    """Cross product of vectors with the components first."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _dot(a: Array, b: Array) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _turn(constant: Array, matrices: Array) -> Array:
    """Matrices ``(3, 3, N)`` times a constant one, from the right."""
    return np.tensordot(constant, matrices, axes=(0, 1)).swapaxes(0, 1)


def _times(matrices: Array, vector: Array) -> Array:
    """Matrices ``(3, 3, N)`` times one vector ``(3,)``, leaving out its zeros."""
    out = np.zeros_like(matrices[:, 0])
    for k in np.flatnonzero(vector):
        out += matrices[:, k] * vector[k]
    return out


def poses(tree: Tree, q: Array, joints: tuple[int, ...] | None = None) -> dict[int, Pose]:
    """Poses of joints.

    Args:
        tree: The robot.
        q: Joint positions [rad or m], shape ``(nt, N)``.
        joints: Which to do, each after its ancestors; all by default.

    Returns:
        Pose by joint.
    """
    samples = q.shape[1]
    axes, zeros = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, samples)), np.zeros((3, samples))
    root = Pose(axes, zeros, zeros, zeros)
    out: dict[int, Pose] = {}
    for j in range(len(tree.parents)) if joints is None else joints:
        above = out.get(tree.parents[j], root)
        origin = above.origin + _times(above.rotation, tree.translations[j])
        turned = not np.array_equal(tree.rotations[j], np.eye(3))
        R = _turn(tree.rotations[j], above.rotation) if turned else above.rotation
        angular, linear = _times(R, tree.angular[j]), _times(R, tree.linear[j])
        if tree.linear[j].any():
            origin = origin + linear * q[j]
        if tree.angular[j].any():
            R = _rotated(R, tree.angular[j], q[j])
        out[j] = Pose(R, origin, angular, linear)
    return out


def _rotated(R: Array, axis: Array, angle: Array) -> Array:
    """``R`` times the rotation by ``angle`` about ``axis``, by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return R + np.sin(angle) * _turn(K, R) + (1 - np.cos(angle)) * _turn(K @ K, R)


def tip_position(tree: Tree, at: dict[int, Pose]) -> Array:
    """Tip in the root frame [m], shape ``(3, N)``."""
    last = at[tree.tip_joint]
    return last.origin + _times(last.rotation, tree.tip_offset)


def tip_jacobian(tree: Tree, at: dict[int, Pose]) -> Array:
    """Translational Jacobian of the tip in the root frame's axes, shape ``(3, nt, N)``."""
    tip = tip_position(tree, at)
    J = np.zeros((3, len(tree.parents), tip.shape[1]))
    for j in tree.tip_path:
        J[:, j] = at[j].linear + _cross(at[j].angular, tip - at[j].origin)
    return J


def mass_and_weight(tree: Tree, at: dict[int, Pose]) -> tuple[Array, Array]:
    """Mass matrix without armature and gravity torque, by composite bodies in the root frame.

    Args:
        tree: The robot.
        at: Poses of all joints.

    Returns:
        M [kg m2], shape ``(nt, nt, N)``; torque that holds the robot against gravity [N m], shape ``(nt, N)``.
    """
    count, samples = len(tree.parents), at[0].origin.shape[1]
    mass = np.array(tree.masses)
    moment, inertia = _bodies(tree, at)
    M, weight = np.zeros((count, count, samples)), np.zeros((count, samples))
    gravity = np.broadcast_to(tree.gravity[:, None], (3, samples))
    # Twist of each joint's motion at the root frame's origin.
    twists = [(at[j].linear + _cross(at[j].origin, at[j].angular), at[j].angular) for j in range(count)]
    for j in reversed(range(count)):
        v, w = twists[j]
        force = mass[j] * v + _cross(w, moment[j])
        torque = np.einsum("ijn,jn->in", inertia[j], w) + _cross(moment[j], v)
        weight[j] = -(mass[j] * _dot(v, gravity) + _dot(w, _cross(moment[j], gravity)))
        i = j
        while i >= 0:
            M[i, j] = M[j, i] = _dot(twists[i][0], force) + _dot(twists[i][1], torque)
            i = tree.parents[i]
        parent = tree.parents[j]
        if parent >= 0:
            mass[parent] += mass[j]
            moment[parent] += moment[j]
            inertia[parent] += inertia[j]
    return M, weight


def _bodies(tree: Tree, at: dict[int, Pose]) -> tuple[list[Array], list[Array]]:
    """First moment ``(3, N)`` and inertia ``(3, 3, N)`` of each body about the root frame's origin."""
    moments, inertias = [], []
    for j, mass in enumerate(tree.masses):
        R = at[j].rotation
        c = at[j].origin + _times(R, tree.centers[j])
        inertia = np.einsum("ikn,jkn->ijn", _turn(tree.inertias[j], R), R)
        inertia -= mass * c[:, None] * c[None, :]
        for k in range(3):
            inertia[k, k] += mass * _dot(c, c)
        moments.append(mass * c)
        inertias.append(inertia)
    return moments, inertias
