"""Compiled loop that writes the rigid-body torque regressor, sample by sample, only where it is not always zero.

The force on a body is m d + dw x h + w x (w x h), the moment about its origin h x d + I dw + w x I w, with d the
acceleration of the origin and h the first moment. Virtual work on a motion that moves its frame gives its ten entries
of a row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn._kernels.poses import cross, dot, move, place, turned_back
from phantom_dyn._kernels.rigid_body_loops import Room
from phantom_dyn._kernels.tree_arrays import Kinematics

Array = np.ndarray

SCATTERED, NONE = -1, -2
"""Instead of the first column of a joint: its ten columns do not stand side by side, or none of them is wanted."""


class OwnRoom(NamedTuple):
    """Arrays of `regressor_loop` alone.

    Attributes:
        J: Velocities of a body's origin and frame per velocity of each joint that moves it, ``(nt, 6)``.
        b: Terms of a body, ``(30,)``.
        ten: Its ten entries of a row, ``(10,)``.
        moved_by: The degrees of freedom in the order of ``J``, ``(nt,)``.
    """

    J: Array
    b: Array
    ten: Array
    moved_by: Array


def own_room_of(tree: Kinematics) -> OwnRoom:
    """Room for one body of a tree."""
    nt = int(tree.first_v[len(tree.parents)])
    return OwnRoom(np.zeros((nt, 6)), np.zeros(30), np.zeros(10), np.zeros(nt, dtype=np.int64))


@fused
def regressor_loop(
    tree: Kinematics, room: Room, own: OwnRoom, q: Array, v: Array, a: Array, slope: Array, places: Array, out: Array
) -> None:
    """Write the regressor of N samples.

    Args:
        tree: The joints.
        room: See `room_of`.
        own: See `own_room_of`.
        q: Pinocchio's configurations, ``(N, nq)``.
        v: Velocities of the tree, ``(N, nt)``.
        a: Accelerations of the tree, ``(N, nt)``.
        slope: ``G`` of a closed chain, ``(1 or N, nt, nv)``; of a plain robot ``(0, nt, nt)``.
        places: Column of each parameter of each joint, -1 for none, strictly ascending where not; before them the
            first column where the ten stand side by side, else `SCATTERED` or `NONE`, ``(n - 1, 11)``.
        out: Receives the regressor, ``(N, nv, c)``; where it is zero for every motion nothing is written.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes = tree
    R, o, w, dw, acc, lin, ang, _, _, _ = room
    J, b, ten, moved_by = own
    n, closed = len(parents), len(slope) > 0
    for k in range(len(q)):
        place(parents, kinds, first_q, first_v, rotations, translations, axes, q, k, R, o, lin, ang)
        move(parents, first_v, o, lin, ang, v, a, k, w, dw, acc)
        for i in range(1, n):
            start = places[i - 1, 0]
            if start == NONE:
                continue
            body_terms(R, i, acc, w, dw, b)
            # Velocities of the body's origin and frame per velocity of each joint that moves it.
            count, j = 0, i
            while j > 0:
                rx, ry, rz = o[i, 0] - o[j, 0], o[i, 1] - o[j, 1], o[i, 2] - o[j, 2]
                for d in range(first_v[j], first_v[j + 1]):
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
                write_row(lx, ly, lz, sx, sy, sz, b, ten)
                if start >= 0:
                    for c in range(10):
                        out[k, row, start + c] = ten[c]
                else:
                    for c in range(10):
                        if places[i - 1, 1 + c] >= 0:
                            out[k, row, places[i - 1, 1 + c]] = ten[c]


@inlined
def body_terms(R: Array, i: int, acc: Array, w: Array, dw: Array, b: Array) -> None:
    """Write what all rows of a body share at one sample, see `write_row`.

    Args:
        R: Rotations of all joints, with the next four as `place` and `move` write them.
        i: Which body.
        acc: .
        w: .
        dw: .
        b: Receives the terms, ``(30,)``: acceleration of the origin in the axes of the root and in those of the body,
            torque of the first moment per velocity of the origin, and of the inertia per angular velocity.
    """
    b[0], b[1], b[2] = acc[i, 0], acc[i, 1], acc[i, 2]
    b[3], b[4], b[5] = turned_back(R, i, acc[i, 0], acc[i, 1], acc[i, 2])
    x, y, z = turned_back(R, i, w[i, 0], w[i, 1], w[i, 2])
    ax, ay, az = turned_back(R, i, dw[i, 0], dw[i, 1], dw[i, 2])
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    for c in range(3):
        rx, ry, rz = R[i, c, 0], R[i, c, 1], R[i, c, 2]
        b[6 + c] = (xy + az) * ry + (xz - ay) * rz - (yy + zz) * rx
        b[9 + c] = (xy - az) * rx + (yz + ax) * rz - (xx + zz) * ry
        b[12 + c] = (xz + ay) * rx + (yz - ax) * ry - (xx + yy) * rz
    b[15], b[16], b[17], b[18], b[19], b[20] = ax, ay, az, xy, xz, yz
    b[21], b[22], b[23] = ay - xz, ax + yz, xx - yy
    b[24], b[25], b[26] = az + xy, zz - xx, ax - yz
    b[27], b[28], b[29] = yy - zz, az - xy, ay + xz


@inlined
def write_row(lx: float, ly: float, lz: float, sx: float, sy: float, sz: float, b: Array, ten: Array) -> None:
    """Write the torque per parameter of one body on a motion that moves its frame.

    Args:
        lx: Velocity of the body's origin in the axes of the root, with the next two.
        ly: .
        lz: .
        sx: Angular velocity in the axes of the body, with the next two.
        sy: .
        sz: .
        b: As `body_terms` writes it.
        ten: Receives it for each of the ten parameters, ``(10,)``.
    """
    kx, ky, kz = cross(b[3], b[4], b[5], sx, sy, sz)
    ten[0] = dot(lx, ly, lz, b[0], b[1], b[2])
    ten[1] = kx + dot(lx, ly, lz, b[6], b[7], b[8])
    ten[2] = ky + dot(lx, ly, lz, b[9], b[10], b[11])
    ten[3] = kz + dot(lx, ly, lz, b[12], b[13], b[14])
    ten[4] = sx * b[15] + sy * b[19] - sz * b[18]
    ten[5] = dot(sx, sy, sz, b[21], b[22], b[23])
    ten[6] = sy * b[16] + sz * b[18] - sx * b[20]
    ten[7] = dot(sx, sy, sz, b[24], b[25], b[26])
    ten[8] = dot(sx, sy, sz, b[27], b[28], b[29])
    ten[9] = sz * b[17] + sx * b[20] - sy * b[19]
