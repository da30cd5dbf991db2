"""Poses and motion of the joints of a tree at one sample, in the axes of the root, for compiled loops.

Every function is inlined into the loop that calls it. Vectors are passed as three scalars, and arrays one by one: a
loop that unpacks a tuple of arrays counts references to each of them, and takes 1.5 times as long.

After a change in this file, delete the ``__pycache__`` of this folder: numba does not notice that the loops have to be
compiled again.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import inlined
from phantom_dyn.array_types import Array

Vector = tuple[float, float, float]


@inlined
def place(
    parents: Array,
    kinds: Array,
    first_q: Array,
    first_v: Array,
    rotations: Array,
    translations: Array,
    axes: Array,
    q: Array,
    i: int,
    R: Array,
    o: Array,
    lin: Array,
    ang: Array,
) -> None:
    """Write the poses of all joints at one configuration.

    Args:
        parents: Parent of each joint, ``(n,)``; see `TreeArrays` for this and the next arguments.
        kinds: Type of each joint.
        first_q: First entry of each joint in ``q``.
        first_v: First entry of each joint in ``v``.
        rotations: Rotations of the joints in their parents, ``(3 n, 3, 3)``.
        translations: Origin of each joint frame in its parent's [m], ``(n, 3)``.
        axes: Axis of each joint in its own frame, ``(n, 3)``.
        q: Pinocchio's configurations, ``(N, nq)``.
        i: Row of ``q`` to use.
        R: Output: the rotations, ``(n, 3, 3)``; the first row, that of the root, is an input.
        o: Output: the origins [m], ``(n, 3)``; the first row is an input, too.
        lin: Output: the velocity of each joint's origin per unit of the joint's velocity, ``(nv, 3)``.
        ang: Output: the angular velocity per unit of the joint's velocity, ``(nv, 3)``.
    """
    for j in range(1, len(parents)):
        p, kind, k, d = parents[j], kinds[j], first_q[j], first_v[j]
        x, y, z = translations[j, 0], translations[j, 1], translations[j, 2]
        c = s = 0.0
        if kind == 1:  # revolute
            c, s = np.cos(q[i, k]), np.sin(q[i, k])
        elif kind == 2:  # continuous
            c, s = q[i, k], q[i, k + 1]
        else:  # prismatic
            mx, my, mz = q[i, k] * axes[j, 0], q[i, k] * axes[j, 1], q[i, k] * axes[j, 2]
            mx, my, mz = turned(rotations, 3 * j, mx, my, mz)
            x, y, z = x + mx, y + my, z + mz
        x, y, z = turned(R, p, x, y, z)
        o[j, 0], o[j, 1], o[j, 2] = o[p, 0] + x, o[p, 1] + y, o[p, 2] + z
        for m in range(3):
            x = rotations[3 * j, 0, m] + c * rotations[3 * j + 1, 0, m] + s * rotations[3 * j + 2, 0, m]
            y = rotations[3 * j, 1, m] + c * rotations[3 * j + 1, 1, m] + s * rotations[3 * j + 2, 1, m]
            z = rotations[3 * j, 2, m] + c * rotations[3 * j + 1, 2, m] + s * rotations[3 * j + 2, 2, m]
            R[j, 0, m], R[j, 1, m], R[j, 2, m] = turned(R, p, x, y, z)
        x, y, z = turned(R, j, axes[j, 0], axes[j, 1], axes[j, 2])
        slides, turns = (1.0, 0.0) if kind == 3 else (0.0, 1.0)
        lin[d, 0], lin[d, 1], lin[d, 2] = slides * x, slides * y, slides * z
        ang[d, 0], ang[d, 1], ang[d, 2] = turns * x, turns * y, turns * z


@inlined
def move(
    parents: Array,
    first_v: Array,
    o: Array,
    lin: Array,
    ang: Array,
    v: Array,
    a: Array,
    i: int,
    w: Array,
    dw: Array,
    acc: Array,
) -> None:
    """Write the motion of all joint frames at one sample.

    Args:
        parents: Parent of each joint, ``(n,)``.
        first_v: First entry of each joint in ``v``.
        o: Origins that `place` has written [m], ``(n, 3)``.
        lin: Velocities of the joints' origins that `place` has written, ``(nv, 3)``.
        ang: Angular velocities that `place` has written, ``(nv, 3)``.
        v: Velocities, ``(N, nv)``.
        a: Accelerations, ``(N, nv)``.
        i: Row of ``v`` and ``a`` to use.
        w: Output: angular velocities [rad/s], ``(n, 3)``. The first row, that of the root, is an input, also in ``dw``
            and ``acc``.
        dw: Output: angular accelerations [rad/s2], ``(n, 3)``.
        acc: Output: the accelerations of the origins [m/s2], ``(n, 3)``. If the root accelerates by minus gravity, the
            weight of all bodies is included.
    """
    for j in range(1, len(parents)):
        p, d = parents[j], first_v[j]
        vx, vy, vz = lin[d, 0] * v[i, d], lin[d, 1] * v[i, d], lin[d, 2] * v[i, d]
        wx, wy, wz = ang[d, 0] * v[i, d], ang[d, 1] * v[i, d], ang[d, 2] * v[i, d]
        ax, ay, az = lin[d, 0] * a[i, d], lin[d, 1] * a[i, d], lin[d, 2] * a[i, d]
        bx, by, bz = ang[d, 0] * a[i, d], ang[d, 1] * a[i, d], ang[d, 2] * a[i, d]
        rx, ry, rz = o[j, 0] - o[p, 0], o[j, 1] - o[p, 1], o[j, 2] - o[p, 2]
        px, py, pz = w[p, 0], w[p, 1], w[p, 2]
        cx, cy, cz = cross(px, py, pz, rx, ry, rz)
        cx, cy, cz = cross(px, py, pz, cx + 2 * vx, cy + 2 * vy, cz + 2 * vz)
        tx, ty, tz = cross(dw[p, 0], dw[p, 1], dw[p, 2], rx, ry, rz)
        acc[j, 0] = acc[p, 0] + ax + cx + tx
        acc[j, 1] = acc[p, 1] + ay + cy + ty
        acc[j, 2] = acc[p, 2] + az + cz + tz
        gx, gy, gz = cross(px, py, pz, wx, wy, wz)
        dw[j, 0], dw[j, 1], dw[j, 2] = dw[p, 0] + bx + gx, dw[p, 1] + by + gy, dw[p, 2] + bz + gz
        w[j, 0], w[j, 1], w[j, 2] = px + wx, py + wy, pz + wz


@inlined
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Vector:
    """Cross product of a and b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def dot(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Scalar product of a and b."""
    return ax * bx + ay * by + az * bz


@inlined
def turned(R: Array, i: int, x: float, y: float, z: float) -> Vector:
    """``R[i]`` times a vector."""
    return (
        R[i, 0, 0] * x + R[i, 0, 1] * y + R[i, 0, 2] * z,
        R[i, 1, 0] * x + R[i, 1, 1] * y + R[i, 1, 2] * z,
        R[i, 2, 0] * x + R[i, 2, 1] * y + R[i, 2, 2] * z,
    )


@inlined
def turned_back(R: Array, i: int, x: float, y: float, z: float) -> Vector:
    """``R[i]`` transposed times a vector."""
    return (
        R[i, 0, 0] * x + R[i, 1, 0] * y + R[i, 2, 0] * z,
        R[i, 0, 1] * x + R[i, 1, 1] * y + R[i, 2, 1] * z,
        R[i, 0, 2] * x + R[i, 1, 2] * y + R[i, 2, 2] * z,
    )
