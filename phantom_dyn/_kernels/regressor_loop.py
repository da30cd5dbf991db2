"""Compiled loop that writes the rigid-body torque regressor sample by sample, without entries that are always zero.

The force on a body is m d + dw x h + w x (w x h), and the moment about its origin is h x d + I dw + w x I w, with d the
acceleration of the origin and h the first moment. Both are linear in the ten parameters of the body. Multiplied by the
velocity of the body's frame per velocity of a joint, they give the ten entries of the body in the row of this joint.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn._kernels.poses import cross, move, place, turned_back
from phantom_dyn._kernels.rigid_body_loops import Workspace, set_root
from phantom_dyn._kernels.tree_arrays import Kinematics
from phantom_dyn.array_types import Array

SCATTERED, NONE = -1, -2
"""Values in place of the first column of a body whose columns are not contiguous, or of which no column is wanted."""


class BodyWorkspace(NamedTuple):
    """Work arrays of `regressor_loop` for one body.

    Attributes:
        J: Velocity and angular velocity of the body per velocity of each joint that moves it, ``(nt, 6)``.
        b: Terms that all rows share, see `body_terms`, ``(6, 10)``.
        ten: Ten entries of one row, ``(10,)``.
        moved_by: Degree of freedom of each row of ``J``, ``(nt,)``.
    """

    J: Array
    b: Array
    ten: Array
    moved_by: Array


def body_workspace(tree: Kinematics) -> BodyWorkspace:
    """Work arrays for one body of a tree."""
    nt = len(tree.parents) - 1
    return BodyWorkspace(np.zeros((nt, 6)), np.zeros((6, 10)), np.zeros(10), np.zeros(nt, dtype=np.int64))


@fused
def regressor_loop(
    tree: Kinematics,
    workspace: Workspace,
    body: BodyWorkspace,
    root: Array,
    q: Array,
    v: Array,
    a: Array,
    slope: Array,
    places: Array,
    out: Array,
) -> None:
    """Write the regressor of N samples.

    Args:
        tree: The joints.
        workspace: Work arrays of the tree, from `workspace_of`.
        body: Work arrays of one body, from `body_workspace`.
        root: Motion of a moving root, see `torque_loop`, ``(N, 9)``; ``(0, 9)`` for a fixed one.
        q: Pinocchio's configurations, ``(N, nq)``.
        v: Velocities of the tree, ``(N, nt)``.
        a: Accelerations of the tree, ``(N, nt)``.
        slope: ``G`` of a closed chain, ``(1 or N, nt, nv)``; ``(0, nt, nt)`` for a robot without loops.
        places: Columns of ``out`` for each body, ``(n - 1, 11)``: the first of its ten columns if they are contiguous,
            otherwise `SCATTERED` or `NONE`; then the column of each of its ten parameters, -1 for unwanted ones.
        out: Output: the regressor, ``(N, nv, c)``; entries that are zero for every motion are not written.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes = tree
    R, o, w, dw, acc, lin, ang, _, _, _ = workspace
    J, b, ten, moved_by = body
    n, closed = len(parents), len(slope) > 0
    for k in range(len(q)):
        place(parents, kinds, first_q, first_v, rotations, translations, axes, q, k, R, o, lin, ang)
        set_root(root, k, w, dw, acc, 0)
        move(parents, first_v, o, lin, ang, v, a, k, w, dw, acc)
        for i in range(1, n):
            start = places[i - 1, 0]
            if start == NONE:
                continue
            body_terms(R, i, acc, w, dw, b)
            count, j = 0, i
            while j > 0:
                d = first_v[j]
                rx, ry, rz = o[i, 0] - o[j, 0], o[i, 1] - o[j, 1], o[i, 2] - o[j, 2]
                x, y, z = cross(ang[d, 0], ang[d, 1], ang[d, 2], rx, ry, rz)
                J[count, 0], J[count, 1], J[count, 2] = lin[d, 0] + x, lin[d, 1] + y, lin[d, 2] + z
                J[count, 3], J[count, 4], J[count, 5] = ang[d, 0], ang[d, 1], ang[d, 2]
                moved_by[count] = d
                count += 1
                j = parents[j]
            for r in range(out.shape[1] if closed else count):
                row = r
                if closed:
                    m = k if len(slope) > 1 else 0
                    lx = ly = lz = sx = sy = sz = 0.0
                    for d in range(count):
                        g = slope[m, moved_by[d], r]
                        lx, ly, lz = lx + g * J[d, 0], ly + g * J[d, 1], lz + g * J[d, 2]
                        sx, sy, sz = sx + g * J[d, 3], sy + g * J[d, 4], sz + g * J[d, 5]
                else:
                    row = moved_by[r]
                    lx, ly, lz, sx, sy, sz = J[r, 0], J[r, 1], J[r, 2], J[r, 3], J[r, 4], J[r, 5]
                sx, sy, sz = turned_back(R, i, sx, sy, sz)
                if start >= 0:
                    write_row(lx, ly, lz, sx, sy, sz, b, out[k, row], start)
                else:
                    write_row(lx, ly, lz, sx, sy, sz, b, ten, 0)
                    for c in range(10):
                        if places[i - 1, 1 + c] >= 0:
                            out[k, row, places[i - 1, 1 + c]] = ten[c]


@inlined
def body_terms(R: Array, i: int, acc: Array, w: Array, dw: Array, b: Array) -> None:
    """Write the terms that all rows of a body share at one sample; entries that are always zero are not written.

    Args:
        R: Rotations of all joints that `place` has written, ``(n, 3, 3)``.
        i: Index of the body.
        acc: Accelerations of the origins that `move` has written [m/s2], ``(n, 3)``.
        w: Angular velocities that `move` has written [rad/s], ``(n, 3)``.
        dw: Angular accelerations that `move` has written [rad/s2], ``(n, 3)``.
        b: Output: the terms, ``(6, 10)``: force per parameter in the axes of the root (three rows), then moment per
            parameter in the axes of the body (three rows).
    """
    x, y, z = turned_back(R, i, w[i, 0], w[i, 1], w[i, 2])
    ax, ay, az = turned_back(R, i, dw[i, 0], dw[i, 1], dw[i, 2])
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    for c in range(3):
        rx, ry, rz = R[i, c, 0], R[i, c, 1], R[i, c, 2]
        b[c, 0] = acc[i, c]
        b[c, 1] = (xy + az) * ry + (xz - ay) * rz - (yy + zz) * rx
        b[c, 2] = (xy - az) * rx + (yz + ax) * rz - (xx + zz) * ry
        b[c, 3] = (xz + ay) * rx + (yz - ax) * ry - (xx + yy) * rz
    fx, fy, fz = turned_back(R, i, acc[i, 0], acc[i, 1], acc[i, 2])
    b[3, 2], b[3, 3], b[4, 1], b[4, 3], b[5, 1], b[5, 2] = fz, -fy, -fz, fx, fy, -fx
    b[3, 4], b[3, 5], b[3, 6], b[3, 7], b[3, 8], b[3, 9] = ax, ay - xz, -yz, az + xy, yy - zz, yz
    b[4, 4], b[4, 5], b[4, 6], b[4, 7], b[4, 8], b[4, 9] = xz, ax + yz, ay, zz - xx, az - xy, -xz
    b[5, 4], b[5, 5], b[5, 6], b[5, 7], b[5, 8], b[5, 9] = -xy, xx - yy, xy, ax - yz, ay + xz, az


@inlined
def write_row(
    lx: float, ly: float, lz: float, sx: float, sy: float, sz: float, b: Array, line: Array, start: int
) -> None:
    """Write the ten entries of one body in the row of one joint. Velocities are per unit of the joint's velocity.

    Args:
        lx: Velocity of the body's origin along the root's x axis.
        ly: Velocity along the root's y axis.
        lz: Velocity along the root's z axis.
        sx: Angular velocity of the body about its own x axis.
        sy: Angular velocity about its own y axis.
        sz: Angular velocity about its own z axis.
        b: Terms of the body, from `body_terms`.
        line: Output: row of the regressor.
        start: Index of the first entry.
    """
    for c in range(10):
        line[start + c] = (lx * b[0, c] + ly * b[1, c] + lz * b[2, c]) + (sx * b[3, c] + sy * b[4, c] + sz * b[5, c])
