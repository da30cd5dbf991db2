"""Compiled rigid-body dynamics of one state, linear in the ten parameters of every body, whatever their values.

An estimate on its way need not be a body that exists: a mass of zero with a first moment is fine here, while a library
that divides by the mass would fail.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit

Array = np.ndarray


@jit
def place(rotations: Array, translations: Array, angular: Array, linear: Array, x: Array, R: Array, p: Array) -> None:
    """Pose of each joint in the one that carries it.

    Args:
        rotations: At position zero, ``(nt, 3, 3)``.
        translations: At position zero [m], ``(nt, 3)``.
        angular: Axes, zero for a linear joint, ``(nt, 3)``.
        linear: Directions, zero for a hinge, ``(nt, 3)``.
        x: Positions [rad or m], ``(nt,)``.
        R: Receives rotations, ``(nt, 3, 3)``.
        p: Receives origins [m], ``(nt, 3)``.
    """
    turn = np.empty((3, 3))
    for i in range(len(x)):
        ax, ay, az = angular[i, 0], angular[i, 1], angular[i, 2]
        if ax == 0.0 and ay == 0.0 and az == 0.0:
            for r in range(3):
                p[i, r] = translations[i, r]
                for c in range(3):
                    R[i, r, c] = rotations[i, r, c]
                    p[i, r] += rotations[i, r, c] * linear[i, c] * x[i]
            continue
        s, c1 = np.sin(x[i]), np.cos(x[i])
        rest = 1.0 - c1
        turn[0, 0], turn[0, 1], turn[0, 2] = c1 + ax * ax * rest, ax * ay * rest - az * s, ax * az * rest + ay * s
        turn[1, 0], turn[1, 1], turn[1, 2] = ay * ax * rest + az * s, c1 + ay * ay * rest, ay * az * rest - ax * s
        turn[2, 0], turn[2, 1], turn[2, 2] = az * ax * rest - ay * s, az * ay * rest + ax * s, c1 + az * az * rest
        for r in range(3):
            p[i, r] = translations[i, r]
            for c in range(3):
                R[i, r, c] = (
                    rotations[i, r, 0] * turn[0, c] + rotations[i, r, 1] * turn[1, c] + rotations[i, r, 2] * turn[2, c]
                )


@jit
def inverse(
    parents: Array,
    angular: Array,
    linear: Array,
    R: Array,
    p: Array,
    pi: Array,
    gravity: Array,
    v: Array,
    a: Array,
    w: Array,
    f: Array,
    tau: Array,
) -> None:
    """Torque on the joints of a tree (Newton and Euler, in the axes of each body).

    Args:
        parents: Joint that carries each joint, -1 for the root, ``(nt,)``.
        angular: See `place`.
        linear: See `place`.
        R: From `place`.
        p: From `place`.
        pi: ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` of each body about its joint's origin, ``(nt, 10)``.
        gravity: In the root frame [m/s^2], ``(3,)``.
        v: Velocities, ``(nt,)``.
        a: Accelerations, ``(nt,)``.
        w: Room for motion, ``(nt, 9)``.
        f: Room for force and moment, ``(nt, 6)``.
        tau: Receives the torques, ``(nt,)``.
    """
    n = len(parents)
    for i in range(n):
        k = parents[i]
        wx = wy = wz = ex = ey = ez = 0.0
        lx, ly, lz = -gravity[0], -gravity[1], -gravity[2]
        if k >= 0:
            wx, wy, wz, ex, ey, ez = w[k, 0], w[k, 1], w[k, 2], w[k, 3], w[k, 4], w[k, 5]
            x, y, z = p[i, 0], p[i, 1], p[i, 2]
            cx, cy, cz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
            lx = w[k, 6] + ey * z - ez * y + wy * cz - wz * cy
            ly = w[k, 7] + ez * x - ex * z + wz * cx - wx * cz
            lz = w[k, 8] + ex * y - ey * x + wx * cy - wy * cx
        for r in range(3):
            w[i, r] = R[i, 0, r] * wx + R[i, 1, r] * wy + R[i, 2, r] * wz
            w[i, 3 + r] = R[i, 0, r] * ex + R[i, 1, r] * ey + R[i, 2, r] * ez
            w[i, 6 + r] = R[i, 0, r] * lx + R[i, 1, r] * ly + R[i, 2, r] * lz
        sx, sy, sz = angular[i, 0] * v[i], angular[i, 1] * v[i], angular[i, 2] * v[i]
        dx, dy, dz = 2.0 * linear[i, 0] * v[i], 2.0 * linear[i, 1] * v[i], 2.0 * linear[i, 2] * v[i]
        wx, wy, wz = w[i, 0], w[i, 1], w[i, 2]
        w[i, 3] += wy * sz - wz * sy + angular[i, 0] * a[i]
        w[i, 4] += wz * sx - wx * sz + angular[i, 1] * a[i]
        w[i, 5] += wx * sy - wy * sx + angular[i, 2] * a[i]
        w[i, 6] += wy * dz - wz * dy + linear[i, 0] * a[i]
        w[i, 7] += wz * dx - wx * dz + linear[i, 1] * a[i]
        w[i, 8] += wx * dy - wy * dx + linear[i, 2] * a[i]
        w[i, 0], w[i, 1], w[i, 2] = wx + sx, wy + sy, wz + sz
        _force(pi[i], w[i], f[i])
    for i in range(n - 1, -1, -1):
        tau[i] = 0.0
        for r in range(3):
            tau[i] += linear[i, r] * f[i, r] + angular[i, r] * f[i, 3 + r]
        k = parents[i]
        if k >= 0:
            fx = R[i, 0, 0] * f[i, 0] + R[i, 0, 1] * f[i, 1] + R[i, 0, 2] * f[i, 2]
            fy = R[i, 1, 0] * f[i, 0] + R[i, 1, 1] * f[i, 1] + R[i, 1, 2] * f[i, 2]
            fz = R[i, 2, 0] * f[i, 0] + R[i, 2, 1] * f[i, 1] + R[i, 2, 2] * f[i, 2]
            f[k, 0], f[k, 1], f[k, 2] = f[k, 0] + fx, f[k, 1] + fy, f[k, 2] + fz
            x, y, z = p[i, 0], p[i, 1], p[i, 2]
            f[k, 3] += R[i, 0, 0] * f[i, 3] + R[i, 0, 1] * f[i, 4] + R[i, 0, 2] * f[i, 5] + y * fz - z * fy
            f[k, 4] += R[i, 1, 0] * f[i, 3] + R[i, 1, 1] * f[i, 4] + R[i, 1, 2] * f[i, 5] + z * fx - x * fz
            f[k, 5] += R[i, 2, 0] * f[i, 3] + R[i, 2, 1] * f[i, 4] + R[i, 2, 2] * f[i, 5] + x * fy - y * fx


@jit
def _force(pi: Array, w: Array, f: Array) -> None:
    """Force and moment about its origin that a body needs: its motion is angular velocity, its derivative, ``d``."""
    wx, wy, wz, ex, ey, ez, dx, dy, dz = w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7], w[8]
    m, hx, hy, hz = pi[0], pi[1], pi[2], pi[3]
    cx, cy, cz = wy * hz - wz * hy, wz * hx - wx * hz, wx * hy - wy * hx
    f[0] = m * dx + ey * hz - ez * hy + wy * cz - wz * cy
    f[1] = m * dy + ez * hx - ex * hz + wz * cx - wx * cz
    f[2] = m * dz + ex * hy - ey * hx + wx * cy - wy * cx
    ux, uy, uz = (
        pi[4] * wx + pi[5] * wy + pi[7] * wz,
        pi[5] * wx + pi[6] * wy + pi[8] * wz,
        pi[7] * wx + pi[8] * wy + pi[9] * wz,
    )
    f[3] = pi[4] * ex + pi[5] * ey + pi[7] * ez + wy * uz - wz * uy + hy * dz - hz * dy
    f[4] = pi[5] * ex + pi[6] * ey + pi[8] * ez + wz * ux - wx * uz + hz * dx - hx * dz
    f[5] = pi[7] * ex + pi[8] * ey + pi[9] * ez + wx * uy - wy * ux + hx * dy - hy * dx


@jit
def inverted(A: Array, out: Array) -> bool:
    """Write the inverse of a symmetric matrix; False where it is not positive definite.

    Args:
        A: ``(n, n)``; its lower triangle is overwritten by Cholesky's factor.
        out: Receives the inverse, ``(n, n)``.
    """
    n = len(A)
    for j in range(n):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        if not A[j, j] > 0.0:
            return False
        A[j, j] = np.sqrt(A[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] /= A[j, j]
    for c in range(n):
        for i in range(n):
            out[i, c] = 1.0 if i == c else 0.0
            for k in range(i):
                out[i, c] -= A[i, k] * out[k, c]
            out[i, c] /= A[i, i]
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                out[i, c] -= A[k, i] * out[k, c]
            out[i, c] /= A[i, i]
    return True
