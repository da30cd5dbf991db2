"""Compiled loops over samples: inverse dynamics, mass matrix, pose and Jacobian of a frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn._kernels.poses import cross, dot, move, place, turned, turned_back
from phantom_dyn._kernels.tree_arrays import Kinematics
from phantom_dyn.array_types import Array


class Frame(NamedTuple):
    """A frame of a tree.

    Attributes:
        joint: Index of the joint that carries the frame.
        turn: Rotation of the frame in the axes of the joint, ``(3, 3)``.
        offset: Origin of the frame in the axes of the joint [m], ``(3,)``.
    """

    joint: int
    turn: Array
    offset: Array


class FramePoses(NamedTuple):
    """Results of `frame_loop` for N samples.

    Attributes:
        rotation: Rotation of the frame, ``(N, 3, 3)``.
        position: Position of its origin [m], ``(N, 3)``.
        jacobian: Jacobian, rows v, then w, ``(N, 6, nv)``. It has to be zero before; its length is 0 if it is not
            wanted.
    """

    rotation: Array
    position: Array
    jacobian: Array


class Workspace(NamedTuple):
    """Work arrays of a loop for one sample. Python makes them, because numba takes long to compile their creation.

    Attributes:
        R: Rotation of each joint in the root frame, the root first, ``(n, 3, 3)``.
        o: Origins [m], ``(n, 3)``.
        w: Angular velocities, ``(n, 3)``.
        dw: Angular accelerations, ``(n, 3)``.
        acc: Accelerations of the origins minus gravity, ``(n, 3)``.
        lin, ang: Velocity and angular velocity of a joint's origin per unit of the joint's velocity, ``(nt, 3)``.
        f, m: Forces and moments on the bodies, ``(n, 3)``.
        whole: Ten inertial parameters of each composite body (the body of a joint and all bodies that it carries),
            ``(n, 10)``.
    """

    R: Array
    o: Array
    w: Array
    dw: Array
    acc: Array
    lin: Array
    ang: Array
    f: Array
    m: Array
    whole: Array


def workspace_of(tree: Kinematics, gravity: Array) -> Workspace:
    """Work arrays for one sample of a tree, whose root is fixed under this gravity [m/s2]."""
    n = len(tree.parents)
    o, w, dw, acc, f, m = np.zeros((6, n, 3))
    lin, ang = np.zeros((2, n - 1, 3))
    workspace = Workspace(np.zeros((n, 3, 3)), o, w, dw, acc, lin, ang, f, m, np.zeros((n, 10)))
    workspace.R[0] = np.eye(3)
    workspace.acc[0] = -gravity
    return workspace


@inlined
def set_root(root: Array, k: int, w: Array, dw: Array, acc: Array, first: int) -> None:
    """Write the motion of the root at sample ``k``, see `torque_loop`; nothing is written if the root is fixed.

    Angular velocity and angular acceleration are written from column ``first`` on.
    """
    if len(root) > 0:
        for c in range(3):
            w[0, first + c], dw[0, first + c], acc[0, c] = root[k, c], root[k, 3 + c], root[k, 6 + c]


@fused
def torque_loop(
    tree: Kinematics, inertias: Array, workspace: Workspace, root: Array, q: Array, v: Array, a: Array, out: Array
) -> None:
    """Torque that the links need, without armature: recursive Newton-Euler in the axes of the root.

    Args:
        tree: The joints.
        inertias: Mass, first moments and inertia of each body, from `TreeArrays`.
        workspace: Work arrays of the tree, from `workspace_of`.
        root: Angular velocity [rad/s], angular acceleration [rad/s2] and specific force [m/s2] of a moving root, in its
            own axes, ``(N, 9)``; ``(0, 9)`` for a fixed one.
        q: Pinocchio's configurations, ``(N, nq)``.
        v: Velocities, ``(N, nv)``.
        a: Accelerations, ``(N, nv)``.
        out: Output: the torque [N m or N], ``(N, nv)``.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes = tree
    R, o, w, dw, acc, lin, ang, f, m, _ = workspace
    n = len(parents)
    for k in range(len(q)):
        place(parents, kinds, first_q, first_v, rotations, translations, axes, q, k, R, o, lin, ang)
        set_root(root, k, w, dw, acc, 0)
        move(parents, first_v, o, lin, ang, v, a, k, w, dw, acc)
        for i in range(1, n):
            mass = inertias[i, 0]
            hx, hy, hz = turned(R, i, inertias[i, 1], inertias[i, 2], inertias[i, 3])
            wx, wy, wz = cross(w[i, 0], w[i, 1], w[i, 2], hx, hy, hz)
            wx, wy, wz = cross(w[i, 0], w[i, 1], w[i, 2], wx, wy, wz)
            ax, ay, az = cross(dw[i, 0], dw[i, 1], dw[i, 2], hx, hy, hz)
            f[i, 0] = mass * acc[i, 0] + ax + wx
            f[i, 1] = mass * acc[i, 1] + ay + wy
            f[i, 2] = mass * acc[i, 2] + az + wz
            ax, ay, az = cross(hx, hy, hz, acc[i, 0], acc[i, 1], acc[i, 2])
            wx, wy, wz = turned_back(R, i, w[i, 0], w[i, 1], w[i, 2])
            bx, by, bz = turned_back(R, i, dw[i, 0], dw[i, 1], dw[i, 2])
            x, y, z = times_inertia(inertias, i, wx, wy, wz)
            x, y, z = cross(wx, wy, wz, x, y, z)
            bx, by, bz = times_inertia(inertias, i, bx, by, bz)
            x, y, z = turned(R, i, x + bx, y + by, z + bz)
            m[i, 0], m[i, 1], m[i, 2] = ax + x, ay + y, az + z
        for i in range(n - 1, 0, -1):
            p, d = parents[i], first_v[i]
            out[k, d] = dot(lin[d, 0], lin[d, 1], lin[d, 2], f[i, 0], f[i, 1], f[i, 2]) + dot(
                ang[d, 0], ang[d, 1], ang[d, 2], m[i, 0], m[i, 1], m[i, 2]
            )
            if p > 0:
                rx, ry, rz = o[i, 0] - o[p, 0], o[i, 1] - o[p, 1], o[i, 2] - o[p, 2]
                x, y, z = cross(rx, ry, rz, f[i, 0], f[i, 1], f[i, 2])
                m[p, 0], m[p, 1], m[p, 2] = m[p, 0] + m[i, 0] + x, m[p, 1] + m[i, 1] + y, m[p, 2] + m[i, 2] + z
                f[p, 0], f[p, 1], f[p, 2] = f[p, 0] + f[i, 0], f[p, 1] + f[i, 1], f[p, 2] + f[i, 2]


@fused
def mass_loop(tree: Kinematics, inertias: Array, workspace: Workspace, q: Array, out: Array) -> None:
    """Write mass matrices without armature into ``out``, ``(N, nv, nv)``, which must be zero; by composite bodies.

    The other arguments are those of `torque_loop`.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes = tree
    R, o, _, _, _, lin, ang, _, _, whole = workspace
    n = len(parents)
    for k in range(len(q)):
        place(parents, kinds, first_q, first_v, rotations, translations, axes, q, k, R, o, lin, ang)
        for i in range(1, n):
            for c in range(10):
                whole[i, c] = inertias[i, c]
            carry(whole, i, R)
        for i in range(n - 1, 0, -1):
            d = first_v[i]
            lx, ly, lz, sx, sy, sz = lin[d, 0], lin[d, 1], lin[d, 2], ang[d, 0], ang[d, 1], ang[d, 2]
            mass, hx, hy, hz = whole[i, 0], whole[i, 1], whole[i, 2], whole[i, 3]
            fx, fy, fz = cross(sx, sy, sz, hx, hy, hz)
            fx, fy, fz = fx + mass * lx, fy + mass * ly, fz + mass * lz
            mx, my, mz = cross(hx, hy, hz, lx, ly, lz)
            x, y, z = times_inertia(whole, i, sx, sy, sz)
            mx, my, mz = mx + x, my + y, mz + z
            j = i
            while j > 0:
                p, e = parents[j], first_v[j]
                value = dot(lin[e, 0], lin[e, 1], lin[e, 2], fx, fy, fz) + dot(
                    ang[e, 0], ang[e, 1], ang[e, 2], mx, my, mz
                )
                out[k, d, e] = out[k, e, d] = value
                x, y, z = cross(o[j, 0] - o[p, 0], o[j, 1] - o[p, 1], o[j, 2] - o[p, 2], fx, fy, fz)
                mx, my, mz = mx + x, my + y, mz + z
                j = p
            p = parents[i]
            if p > 0:
                hand_over(whole, i, p, o[i, 0] - o[p, 0], o[i, 1] - o[p, 1], o[i, 2] - o[p, 2])


@fused
def frame_loop(tree: Kinematics, workspace: Workspace, q: Array, frame: Frame, body: bool, out: FramePoses) -> None:
    """Write pose and Jacobian of a frame at Pinocchio's configurations ``q``, ``(N, nq)``.

    The Jacobian is in the frame's own axes if ``body``, else in those of the root.
    """
    joint, turn, offset = frame
    rotation, position, jacobian = out
    parents, kinds, first_q, first_v, rotations, translations, axes = tree
    R, o, _, _, _, lin, ang, _, _, _ = workspace
    for k in range(len(q)):
        place(parents, kinds, first_q, first_v, rotations, translations, axes, q, k, R, o, lin, ang)
        x, y, z = turned(R, joint, offset[0], offset[1], offset[2])
        px, py, pz = x + o[joint, 0], y + o[joint, 1], z + o[joint, 2]
        position[k, 0], position[k, 1], position[k, 2] = px, py, pz
        for c in range(3):
            x, y, z = turned(R, joint, turn[0, c], turn[1, c], turn[2, c])
            rotation[k, 0, c], rotation[k, 1, c], rotation[k, 2, c] = x, y, z
        j = joint if len(jacobian) else 0
        while j > 0:
            d = first_v[j]
            sx, sy, sz = ang[d, 0], ang[d, 1], ang[d, 2]
            x, y, z = cross(sx, sy, sz, px - o[j, 0], py - o[j, 1], pz - o[j, 2])
            lx, ly, lz = x + lin[d, 0], y + lin[d, 1], z + lin[d, 2]
            if body:
                lx, ly, lz = turned_back(rotation, k, lx, ly, lz)
                sx, sy, sz = turned_back(rotation, k, sx, sy, sz)
            jacobian[k, 0, d], jacobian[k, 1, d], jacobian[k, 2, d] = lx, ly, lz
            jacobian[k, 3, d], jacobian[k, 4, d], jacobian[k, 5, d] = sx, sy, sz
            j = parents[j]


@inlined
def times_inertia(inertias: Array, i: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Inertia about the joint's origin times a vector, both in the axes of body ``i``."""
    xx, xy, yy = inertias[i, 4], inertias[i, 5], inertias[i, 6]
    xz, yz, zz = inertias[i, 7], inertias[i, 8], inertias[i, 9]
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@inlined
def carry(whole: Array, i: int, R: Array) -> None:
    """Express the ten parameters of body ``i`` in the axes of the root, still about the origin of its joint."""
    whole[i, 1], whole[i, 2], whole[i, 3] = turned(R, i, whole[i, 1], whole[i, 2], whole[i, 3])
    # Rows of R I, then R I R^T.
    ax, ay, az = times_inertia(whole, i, R[i, 0, 0], R[i, 0, 1], R[i, 0, 2])
    bx, by, bz = times_inertia(whole, i, R[i, 1, 0], R[i, 1, 1], R[i, 1, 2])
    cx, cy, cz = times_inertia(whole, i, R[i, 2, 0], R[i, 2, 1], R[i, 2, 2])
    whole[i, 4], whole[i, 5], whole[i, 7] = turned(R, i, ax, ay, az)
    _, whole[i, 6], whole[i, 8] = turned(R, i, bx, by, bz)
    _, _, whole[i, 9] = turned(R, i, cx, cy, cz)


@inlined
def hand_over(whole: Array, i: int, p: int, x: float, y: float, z: float) -> None:
    """Add the parameters of composite body ``i`` to its parent ``p``; ``(x, y, z)`` leads from ``p`` to ``i``."""
    m, hx, hy, hz = whole[i, 0], whole[i, 1], whole[i, 2], whole[i, 3]
    whole[p, 0] += m
    whole[p, 1] += hx + m * x
    whole[p, 2] += hy + m * y
    whole[p, 3] += hz + m * z
    whole[p, 4] += whole[i, 4] + 2 * (y * hy + z * hz) + m * (y * y + z * z)
    whole[p, 5] += whole[i, 5] - (x * hy + y * hx) - m * x * y
    whole[p, 6] += whole[i, 6] + 2 * (x * hx + z * hz) + m * (x * x + z * z)
    whole[p, 7] += whole[i, 7] - (x * hz + z * hx) - m * x * z
    whole[p, 8] += whole[i, 8] - (y * hz + z * hy) - m * y * z
    whole[p, 9] += whole[i, 9] + 2 * (x * hx + y * hy) + m * (x * x + y * y)
