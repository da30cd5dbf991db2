# pyright: reportAttributeAccessIssue=false
"""Two frames that a loop keeps together, inside compiled loops: how far they are apart, its slope, its acceleration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import pinocchio as pin

from phantom_dyn._kernels.jit import compiles, fused, inlined
from phantom_dyn._kernels.poses import move, place
from phantom_dyn._kernels.tree_arrays import CONTINUOUS, TreeArrays
from phantom_dyn._kernels.vectors import cross, turned, turned_back

Array = np.ndarray
# A tree's kinematics, then its anchors: `TreeArrays.kinematics`, and the two arrays of `compiled_tree`.
Tree = tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array]
_TINY = 1e-9


class Anchored(Protocol):
    """Two frames that stay together, see `phantom_dyn.loops.chain.Anchor`."""

    @property
    def kind(self) -> str:
        """``frame`` where axes stay together too."""
        ...

    @property
    def frame_a(self) -> int:
        """Index of the first frame."""
        ...

    @property
    def frame_b(self) -> int:
        """Index of the second frame."""
        ...


def compiled_tree(model: pin.Model, anchors: Sequence[Anchored], arrays: TreeArrays | None) -> Tree | None:
    """What compiled loops take of a tree and its anchors; None where steps in Python have to do.

    Behind the kinematics: joints of both frames and whether their axes stay together too, ``(k, 3)``; the frames in
    these joints, rows of the rotation and then the origin [m], ``(k, 2, 4, 3)``.
    """
    if arrays is None or not compiles():
        return None
    joints, frames = np.zeros((len(anchors), 3), np.int64), np.zeros((len(anchors), 2, 4, 3))
    for k, anchor in enumerate(anchors):
        joints[k, 2] = anchor.kind == "frame"
        for side, index in enumerate((anchor.frame_a, anchor.frame_b)):
            frame = model.frames[index]
            joints[k, side] = frame.parentJoint
            frames[k, side, :3], frames[k, side, 3] = frame.placement.rotation, frame.placement.translation
    return (*arrays.kinematics, joints, frames)


@inlined
def configure(kinds: Array, first_q: Array, first_v: Array, x: Array, q: Array) -> None:
    """Write Pinocchio's configuration ``q``, ``(1, nq)``, of a tree at the positions ``x`` of its joints."""
    for j in range(1, len(kinds)):
        k, angle = first_q[j], x[first_v[j]]
        if kinds[j] == CONTINUOUS:
            q[0, k], q[0, k + 1] = np.cos(angle), np.sin(angle)
        else:
            q[0, k] = angle


@inlined
def both_frames(joints: Array, frames: Array, k: int, R: Array, o: Array, E: Array, p: Array) -> None:
    """Write rotations ``(2, 3, 3)`` and origins ``(2, 3)`` [m] of the two frames of anchor ``k``."""
    for side in range(2):
        j, f = joints[k, side], frames[k, side]
        for c in range(3):
            E[side, 0, c], E[side, 1, c], E[side, 2, c] = turned(R, j, f[0, c], f[1, c], f[2, c])
        x, y, z = turned(R, j, f[3, 0], f[3, 1], f[3, 2])
        p[side, 0], p[side, 1], p[side, 2] = o[j, 0] + x, o[j, 1] + y, o[j, 2] + z


@inlined
def rotation_between(E: Array) -> tuple[float, float, float]:
    """Rotation vector [rad] of the second frame in the axes of the first."""
    xx, yx, zx = turned_back(E, 0, E[1, 0, 0], E[1, 1, 0], E[1, 2, 0])
    xy, yy, zy = turned_back(E, 0, E[1, 0, 1], E[1, 1, 1], E[1, 2, 1])
    xz, yz, zz = turned_back(E, 0, E[1, 0, 2], E[1, 1, 2], E[1, 2, 2])
    x, y, z = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    sine = np.sqrt(x * x + y * y + z * z)
    longer = np.arctan2(sine, 0.5 * (xx + yy + zz - 1)) / sine if sine > _TINY else 1.0
    return longer * x, longer * y, longer * z


@fused
def anchor_error(tree: Tree, x: Array, error: Array, slope: Array) -> None:
    """How far the frames of each anchor are apart, in the axes of its first frame, and its slope.

    Args:
        tree: Kinematics and anchors.
        x: Positions of the tree, ``(nt,)``.
        error: Receives it [m, and then rad where axes stay together], ``(m,)``.
        slope: Receives its slope, exact where axes are together, ``(m, nt)``.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes, joints, frames = tree
    n, nt = len(parents), len(x)
    R, o, lin, ang = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.empty((nt, 3)), np.empty((nt, 3))
    q, E, p = np.empty((1, first_q[n - 1] + 2)), np.empty((2, 3, 3)), np.empty((2, 3))
    for axis in range(3):
        R[0, axis, axis] = 1.0
    configure(kinds, first_q, first_v, x, q)
    place(parents, kinds, first_q, first_v, rotations, translations, axes, q, 0, R, o, lin, ang)
    slope[:] = 0.0
    r = 0
    for k in range(len(joints)):
        both_frames(joints, frames, k, R, o, E, p)
        error[r], error[r + 1], error[r + 2] = turned_back(
            E, 0, p[1, 0] - p[0, 0], p[1, 1] - p[0, 1], p[1, 2] - p[0, 2]
        )
        if joints[k, 2]:
            error[r + 3], error[r + 4], error[r + 5] = rotation_between(E)
        for side in range(2):
            sign, j = 2.0 * side - 1.0, int(joints[k, side])
            while j > 0:
                d = int(first_v[j])
                ax, ay, az = ang[d, 0], ang[d, 1], ang[d, 2]
                # Of the second origin for both: the axes turn with the first frame.
                lx, ly, lz = cross(ax, ay, az, p[1, 0] - o[j, 0], p[1, 1] - o[j, 1], p[1, 2] - o[j, 2])
                lx, ly, lz = turned_back(E, 0, lx + lin[d, 0], ly + lin[d, 1], lz + lin[d, 2])
                slope[r, d] += sign * lx
                slope[r + 1, d] += sign * ly
                slope[r + 2, d] += sign * lz
                if joints[k, 2]:
                    ax, ay, az = turned_back(E, 0, ax, ay, az)
                    slope[r + 3, d] += sign * ax
                    slope[r + 4, d] += sign * ay
                    slope[r + 5, d] += sign * az
                j = parents[j]
        r += 6 if joints[k, 2] else 3


@fused
def anchor_acceleration(tree: Tree, x: Array, v: Array, still: Array, out: Array) -> None:
    """Acceleration of each second frame against the first where no joint accelerates, anchors closed.

    Args:
        tree: Kinematics and anchors.
        x: Positions of the tree, ``(nt,)``.
        v: Its velocities, ``(1, nt)``.
        still: Zeros, ``(1, nt)``.
        out: Receives it, rows as of `anchor_error`, ``(m,)``.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes, joints, frames = tree
    n, nt = len(parents), len(x)
    R, o, lin, ang = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.empty((nt, 3)), np.empty((nt, 3))
    w, dw, acc, f = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.empty((2, 3))
    q, E, p = np.empty((1, first_q[n - 1] + 2)), np.empty((2, 3, 3)), np.empty((2, 3))
    for axis in range(3):
        R[0, axis, axis] = 1.0
    configure(kinds, first_q, first_v, x, q)
    place(parents, kinds, first_q, first_v, rotations, translations, axes, q, 0, R, o, lin, ang)
    move(parents, first_v, o, lin, ang, v, still, 0, w, dw, acc)
    r = 0
    for k in range(len(joints)):
        both_frames(joints, frames, k, R, o, E, p)
        for side in range(2):
            j = joints[k, side]
            rx, ry, rz = p[side, 0] - o[j, 0], p[side, 1] - o[j, 1], p[side, 2] - o[j, 2]
            x1, y1, z1 = cross(dw[j, 0], dw[j, 1], dw[j, 2], rx, ry, rz)
            x2, y2, z2 = cross(w[j, 0], w[j, 1], w[j, 2], rx, ry, rz)
            x2, y2, z2 = cross(w[j, 0], w[j, 1], w[j, 2], x2, y2, z2)
            f[side, 0], f[side, 1], f[side, 2] = acc[j, 0] + x1 + x2, acc[j, 1] + y1 + y2, acc[j, 2] + z1 + z2
        out[r], out[r + 1], out[r + 2] = turned_back(E, 0, f[1, 0] - f[0, 0], f[1, 1] - f[0, 1], f[1, 2] - f[0, 2])
        if joints[k, 2]:
            a, b = joints[k, 0], joints[k, 1]
            x1, y1, z1 = dw[b, 0] - dw[a, 0], dw[b, 1] - dw[a, 1], dw[b, 2] - dw[a, 2]
            out[r + 3], out[r + 4], out[r + 5] = turned_back(E, 0, x1, y1, z1)
        r += 6 if joints[k, 2] else 3
