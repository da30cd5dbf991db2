"""Compiled loop that writes the rigid-body torque regressor, sample by sample, only where it is not always zero."""

from __future__ import annotations

import numpy as np

from phantom_dyn.kernels.jit import fused, inlined
from phantom_dyn.kernels.poses import move, place
from phantom_dyn.kernels.vectors import cross, dot, turned_back

Array = np.ndarray


@inlined
def write_row(
    lx: float, ly: float, lz: float, sx: float, sy: float, sz: float, b: Array, out: Array, k: int, r: int, c: int
) -> None:
    """Torque per parameter of one body on a motion that moves its frame.

    Args:
        lx: Velocity of the body's origin in its axes, with the next two.
        ly: .
        lz: .
        sx: Angular velocity in its axes, with the next two.
        sy: .
        sz: .
        b: Acceleration of its origin, its angular velocity and the derivative of that, in its axes, ``(9,)``.
        out: Receives it for each of the ten parameters.
        k: Sample, with row and first column.
        r: .
        c: .
    """
    dx, dy, dz, wx, wy, wz, ax, ay, az = b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8]
    # Force m d + dw x h + w x (w x h), moment h x d + I dw + w x I w; virtual work gives the row.
    kx, ky, kz = cross(dx, dy, dz, sx, sy, sz)
    ex, ey, ez = cross(lx, ly, lz, ax, ay, az)
    along, square = dot(wx, wy, wz, lx, ly, lz), dot(wx, wy, wz, wx, wy, wz)
    ux, uy, uz = cross(sx, sy, sz, wx, wy, wz)
    out[k, r, c + 0] = dot(lx, ly, lz, dx, dy, dz)
    out[k, r, c + 1] = kx + ex + wx * along - lx * square
    out[k, r, c + 2] = ky + ey + wy * along - ly * square
    out[k, r, c + 3] = kz + ez + wz * along - lz * square
    out[k, r, c + 4] = sx * ax + ux * wx
    out[k, r, c + 5] = sx * ay + sy * ax + ux * wy + uy * wx
    out[k, r, c + 6] = sy * ay + uy * wy
    out[k, r, c + 7] = sx * az + sz * ax + ux * wz + uz * wx
    out[k, r, c + 8] = sy * az + sz * ay + uy * wz + uz * wy
    out[k, r, c + 9] = sz * az + uz * wz


@inlined
def copy_row(ten: Array, places: Array, i: int, out: Array, k: int, r: int) -> None:
    """Copy the ten numbers of a row to the columns that ``places[i]`` names."""
    for c in range(10):
        if places[i, c] >= 0:
            out[k, r, places[i, c]] = ten[0, 0, c]


@fused
def regressor_loop(
    parents: Array,
    kinds: Array,
    first_q: Array,
    first_v: Array,
    rotations: Array,
    translations: Array,
    axes: Array,
    gravity: Array,
    q: Array,
    v: Array,
    a: Array,
    slope: Array,
    places: Array,
    out: Array,
) -> None:
    """Regressor of N samples.

    Args:
        parents: These seven are `TreeArrays.kinematics`.
        kinds: See there, as the next five.
        first_q: .
        first_v: .
        rotations: .
        translations: .
        axes: .
        gravity: In the root frame [m/s2], ``(3,)``.
        q: Pinocchio's configurations, ``(N, nq)``.
        v: Velocities of the tree, ``(N, nt)``.
        a: Accelerations of the tree, ``(N, nt)``.
        slope: ``G`` of a closed chain, ``(1 or N, nt, nv)``; of a plain robot ``(0, nt, nt)``.
        places: Column of each parameter of each joint, -1 for none, strictly ascending where not, ``(n - 1, 10)``.
        out: Receives the regressor, ``(N, nv, c)``; where it is zero for every motion nothing is written.
    """
    n, nt = len(parents), first_v[len(parents)]
    R, o, w, dw, acc = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    lin, ang, J, b, ten = np.empty((nt, 3)), np.empty((nt, 3)), np.empty((nt, 6)), np.empty(9), np.empty((1, 1, 10))
    for axis in range(3):
        R[0, axis, axis], acc[0, axis] = 1.0, -gravity[axis]
    for k in range(len(q)):
        place(parents, kinds, first_q, first_v, rotations, translations, axes, q, k, R, o, lin, ang)
        move(parents, first_v, o, lin, ang, v, a, k, w, dw, acc)
        for i in range(1, n):
            wanted, start = 0, places[i - 1, 0]
            for c in range(10):
                wanted += places[i - 1, c] >= 0
            if wanted == 0:
                continue
            if wanted < 10 or places[i - 1, 9] != start + 9:
                start = -1  # not ten columns side by side
            b[0], b[1], b[2] = turned_back(R, i, acc[i, 0], acc[i, 1], acc[i, 2])
            b[3], b[4], b[5] = turned_back(R, i, w[i, 0], w[i, 1], w[i, 2])
            b[6], b[7], b[8] = turned_back(R, i, dw[i, 0], dw[i, 1], dw[i, 2])
            if len(slope):
                J.fill(0.0)
            j = i
            while j > 0:
                rx, ry, rz = o[i, 0] - o[j, 0], o[i, 1] - o[j, 1], o[i, 2] - o[j, 2]
                for d in range(first_v[j], first_v[j + 1]):
                    x, y, z = cross(ang[d, 0], ang[d, 1], ang[d, 2], rx, ry, rz)
                    lx, ly, lz = turned_back(R, i, lin[d, 0] + x, lin[d, 1] + y, lin[d, 2] + z)
                    sx, sy, sz = turned_back(R, i, ang[d, 0], ang[d, 1], ang[d, 2])
                    if len(slope):
                        J[d, 0], J[d, 1], J[d, 2], J[d, 3], J[d, 4], J[d, 5] = lx, ly, lz, sx, sy, sz
                    else:
                        if start >= 0:
                            write_row(lx, ly, lz, sx, sy, sz, b, out, k, d, start)
                        else:
                            write_row(lx, ly, lz, sx, sy, sz, b, ten, 0, 0, 0)
                            copy_row(ten, places, i - 1, out, k, d)
                j = parents[j]
            if len(slope):
                m = k if len(slope) > 1 else 0
                for r in range(out.shape[1]):
                    lx = ly = lz = sx = sy = sz = 0.0
                    for d in range(nt):
                        g = slope[m, d, r]
                        lx, ly, lz = lx + g * J[d, 0], ly + g * J[d, 1], lz + g * J[d, 2]
                        sx, sy, sz = sx + g * J[d, 3], sy + g * J[d, 4], sz + g * J[d, 5]
                    if start >= 0:
                        write_row(lx, ly, lz, sx, sy, sz, b, out, k, r, start)
                    else:
                        write_row(lx, ly, lz, sx, sy, sz, b, ten, 0, 0, 0)
                        copy_row(ten, places, i - 1, out, k, r)
