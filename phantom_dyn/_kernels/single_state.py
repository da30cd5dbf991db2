"""Mass matrix and bias torque of a tree or closed chain at one state, for compiled loops that step through time.

The bias torque is the torque at zero acceleration: gravity, centrifugal and Coriolis terms. All quantities are in the
axes of the root and about its origin, so that those of several bodies can be added without transformations. One sweep
from the root to the tips and one sweep back give both results. `phantom_dyn._kernels.rigid_body_loops` works about the
origin of each joint instead, because it computes poses too. Therefore the two files share no code.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn._kernels.loop_closure_state import LoopClosureState, write_tree_state
from phantom_dyn._kernels.poses import cross, dot
from phantom_dyn._kernels.tree_arrays import PRISMATIC, TreeArrays
from phantom_dyn.array_types import Array

# Constants of a joint are a row of 43 numbers: from 0 three matrices, whose sum with the factors 1, cos(q) and sin(q)
# is the rotation of the joint; from 27 origin, from 30 axis, from 33 parameters of its body.
_ORIGIN, _AXIS, BODY, _FIXED = 27, 30, 33, 43
# The state of a joint is a row of 46 numbers: from 0 rotation, from 9 origin, from 12 axis as a twist (angular,
# linear), from 18 velocity, from 24 acceleration, from 30 force (moment, force), from 36 inertia of all bodies that the
# joint carries.
_VELOCITY, _ACCELERATION, _FORCE, _MOVING = 18, 24, 30, 46


def joint_rows(arrays: TreeArrays) -> tuple[Array, Array]:
    """Constants of each joint, ``(n, 43)``; and parent, kind (1 if prismatic) and velocity index, ``(n, 3)``."""
    n = len(arrays.parents)
    numbers = np.zeros((n, _FIXED))
    numbers[:, :_ORIGIN] = arrays.rotations.reshape(n, 27)
    numbers[:, _ORIGIN:_AXIS] = arrays.translations
    numbers[:, _AXIS:BODY] = arrays.axes
    numbers[:, BODY:] = arrays.inertias
    places = np.column_stack([arrays.parents, arrays.kinds == PRISMATIC, arrays.first_v]).astype(np.int64)
    return numbers, places


def at_root(n: int, gravity: Array) -> Array:
    """Rows for the states of all joints, ``(n, 46)``; the root is at rest, with an acceleration of minus gravity."""
    moving = np.zeros((n, _MOVING))
    moving[0, [0, 4, 8]] = 1.0
    moving[0, _ACCELERATION + 3 : _FORCE] = -gravity
    return moving


@jit
def move_root(moving: Array, base: Array, k: int, share: float) -> None:
    """Write the motion of a moving base into the row of the root, interpolated between two samples.

    Args:
        moving: Rows of `at_root`; the first one is changed.
        base: Angular velocity, angular acceleration and specific force of the base in its own axes, ``(N, 9)``;
            ``(0, 9)`` for a fixed base, for which nothing is changed.
        k: Index of the earlier sample.
        share: Share of the time between the samples that has passed, from 0 to 1.
    """
    for i in range(9 if len(base) > 0 else 0):
        # Torques do not depend on the linear velocity of the root, which stays zero.
        place = _VELOCITY + i if i < 3 else _ACCELERATION + i - 3
        moving[0, place] = (1.0 - share) * base[k, i] + share * base[k + 1, i]


class Chain(NamedTuple):
    """Motion of all joints of the tree as a function of the active joints; arrays are empty for a robot without loops.

    Attributes:
        slope: Velocities of the tree per velocity of the active joints, ``G``, ``(nt, nv)``; overwritten at every state
            if loops are closed numerically.
        offset: Positions of the tree if the active joints are at zero, ``(nt,)``.
        viscous: Viscous friction coefficients of the passive joints, zero for active ones, ``(nt,)``.
        coulomb: Coulomb torques of the passive joints, zero for active ones, ``(nt,)``.
        rotor: Rotor inertias of the passive joints, zero for active ones, ``(nt,)``.
        q: Work array for positions of the tree, ``(nt,)``.
        v: Work array for velocities of the tree, ``(nt,)``.
        drift: Work array for accelerations of the tree while no active joint accelerates, ``(nt,)``.
        mass: Work array for the mass matrix of the tree, ``(nt, nt)``.
        bias: Work array for the bias torque of the tree, ``(nt,)``.
        loops: Loops that are closed numerically; None if passive joints are linear functions of active ones.
    """

    slope: Array
    offset: Array
    viscous: Array
    coulomb: Array
    rotor: Array
    q: Array
    v: Array
    drift: Array
    mass: Array
    bias: Array
    loops: LoopClosureState | None


def chain_of(
    slope: Array, offset: Array, viscous: Array, coulomb: Array, rotor: Array, loops: LoopClosureState | None = None
) -> Chain:
    """The chain with its work arrays; the arguments are the attributes of the same names."""
    count = len(offset)
    given = (np.array(part, dtype=float) for part in (slope, offset, viscous, coulomb, rotor))
    return Chain._make((*given, *np.zeros((3, count)), np.zeros((count, count)), np.zeros(count), loops))


@jit
def mass_and_bias(numbers: Array, places: Array, moving: Array, q: Array, v: Array, mass: Array, bias: Array) -> None:
    """Write the mass matrix (both triangles), and the torque that the links need at zero acceleration.

    Both are linear in the ten parameters of every body. This holds also for parameters that no body can have, because
    an estimator may try them.

    Args:
        numbers: Constants of each joint, ``(n, 43)``, see `joint_rows`.
        places: Parent, kind and velocity index of each joint, ``(n, 3)``, see `joint_rows`.
        moving: Rows of `at_root`; all but the first one are overwritten.
        q: Positions, in the order of the rows.
        v: Velocities.
        mass: Output: the mass matrix without rotors in its first rows and columns.
        bias: Output: the torque.
    """
    n = len(places)
    for j in range(1, n):
        d = int(places[j, 2])
        _move(numbers[j], moving[j], moving[places[j, 0]], places[j, 1], q[d], v[d])
    for j in range(n - 1, 0, -1):
        row = moving[j]
        d = places[j, 2]
        sx, sy, sz, tx, ty, tz = row[12], row[13], row[14], row[15], row[16], row[17]
        bias[d] = dot(sx, sy, sz, row[30], row[31], row[32]) + dot(tx, ty, tz, row[33], row[34], row[35])
        lx, ly, lz, px, py, pz = _momentum(
            row[36], row[37], row[38], row[39], row[40], row[41], row[42], row[43], row[44], row[45],
            sx, sy, sz, tx, ty, tz,
        )  # fmt: skip
        mass[d, d] = dot(sx, sy, sz, lx, ly, lz) + dot(tx, ty, tz, px, py, pz)
        i = places[j, 0]
        if i > 0:
            for k in range(_FORCE, _MOVING):
                moving[i, k] += row[k]
        while i > 0:
            up = dot(moving[i, 12], moving[i, 13], moving[i, 14], lx, ly, lz)
            up += dot(moving[i, 15], moving[i, 16], moving[i, 17], px, py, pz)
            e = places[i, 2]
            mass[d, e] = mass[e, d] = up
            i = places[i, 0]


@jit
def chained_mass_and_bias(
    numbers: Array, places: Array, moving: Array, chain: Chain, q: Array, v: Array, mass: Array, bias: Array
) -> bool:
    """Write mass matrix and bias torque for the active joints of a closed chain, as `mass_and_bias` for a tree.

    The bias torque includes the friction of the passive joints.

    With :math:`v_t = G v` and :math:`a_t = G a + d`, the mass matrix is :math:`G^T M_t G` and the torque
    :math:`G^T (M_t d + b_t)`.

    Args:
        numbers: Constants of each joint, ``(n, 43)``, see `joint_rows`.
        places: Parent, kind and velocity index of each joint, ``(n, 3)``, see `joint_rows`.
        moving: Rows of `at_root`; all but the first one are overwritten.
        chain: Motion of the tree as a function of the active joints.
        q: Positions, those of the active joints first.
        v: Velocities in the same order.
        mass: Output: the mass matrix in its first rows and columns.
        bias: Output: the torque.

    Returns:
        False if the loops cannot be closed at this state, or are singular there.
    """
    slope, offset, viscous, coulomb, rotor, q_tree, v_tree, drift, mass_tree, bias_tree, loops = chain
    nt, nv = slope.shape
    if not write_tree_state(loops, slope, offset, q, v, q_tree, v_tree, drift):
        return False
    for i in range(nt):
        for k in range(nt):
            mass_tree[i, k] = 0.0
    mass_and_bias(numbers, places, moving, q_tree, v_tree, mass_tree, bias_tree)
    for i in range(nt):
        mass_tree[i, i] += rotor[i]
        for k in range(nt):
            bias_tree[i] += mass_tree[i, k] * drift[k]
    for j in range(nv):
        bias[j] = 0.0
        for i in range(nv):
            mass[i, j] = 0.0
    for i in range(nt):
        bias_tree[i] += viscous[i] * v_tree[i] + coulomb[i] * np.sign(v_tree[i])
        for j in range(nv):
            bias[j] += slope[i, j] * bias_tree[i]
            product = 0.0
            for k in range(nt):
                product += mass_tree[i, k] * slope[k, j]
            for k in range(nv):
                mass[k, j] += slope[i, k] * product
    return True


@jit
def _move(fixed: Array, row: Array, up: Array, linear: int, q: float, v: float) -> None:
    """Write the row ``row`` of a joint's state, from its constants and the row ``up`` of its parent."""
    c, s, along = (0.0, 0.0, q) if linear == 1 else (np.cos(q), np.sin(q), 0.0)
    # Rotation and origin; a prismatic joint moves along its axis, which its constant placement rotates.
    ax, ay, az = fixed[30], fixed[31], fixed[32]
    ox, oy, oz = fixed[27], fixed[28], fixed[29]
    if linear == 1:
        ox += along * (fixed[0] * ax + fixed[1] * ay + fixed[2] * az)
        oy += along * (fixed[3] * ax + fixed[4] * ay + fixed[5] * az)
        oz += along * (fixed[6] * ax + fixed[7] * ay + fixed[8] * az)
    for k in range(3):
        t0 = fixed[k] + c * fixed[9 + k] + s * fixed[18 + k]
        t1 = fixed[3 + k] + c * fixed[12 + k] + s * fixed[21 + k]
        t2 = fixed[6 + k] + c * fixed[15 + k] + s * fixed[24 + k]
        row[k] = up[0] * t0 + up[1] * t1 + up[2] * t2
        row[3 + k] = up[3] * t0 + up[4] * t1 + up[5] * t2
        row[6 + k] = up[6] * t0 + up[7] * t1 + up[8] * t2
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8]
    x = up[9] + up[0] * ox + up[1] * oy + up[2] * oz
    y = up[10] + up[3] * ox + up[4] * oy + up[5] * oz
    z = up[11] + up[6] * ox + up[7] * oy + up[8] * oz
    row[9], row[10], row[11] = x, y, z
    bx, by, bz = r0 * ax + r1 * ay + r2 * az, r3 * ax + r4 * ay + r5 * az, r6 * ax + r7 * ay + r8 * az
    if linear == 1:
        sx, sy, sz, tx, ty, tz = 0.0, 0.0, 0.0, bx, by, bz
    else:
        sx, sy, sz = bx, by, bz
        tx, ty, tz = cross(x, y, z, bx, by, bz)
    row[12], row[13], row[14], row[15], row[16], row[17] = sx, sy, sz, tx, ty, tz
    # Twist and its derivative.
    wx, wy, wz = up[18] + sx * v, up[19] + sy * v, up[20] + sz * v
    ux, uy, uz = up[21] + tx * v, up[22] + ty * v, up[23] + tz * v
    row[18], row[19], row[20], row[21], row[22], row[23] = wx, wy, wz, ux, uy, uz
    ex, ey, ez = cross(wx, wy, wz, sx, sy, sz)
    fx, fy, fz = cross(wx, wy, wz, tx, ty, tz)
    gx, gy, gz = cross(ux, uy, uz, sx, sy, sz)
    dwx, dwy, dwz = up[24] + ex * v, up[25] + ey * v, up[26] + ez * v
    dux, duy, duz = up[27] + (fx + gx) * v, up[28] + (fy + gy) * v, up[29] + (fz + gz) * v
    row[24], row[25], row[26], row[27], row[28], row[29] = dwx, dwy, dwz, dux, duy, duz
    # Inertia: in the axes of the root, then about its origin.
    m, px, py, pz = fixed[33], fixed[34], fixed[35], fixed[36]
    ixx, ixy, iyy, ixz, iyz, izz = fixed[37], fixed[38], fixed[39], fixed[40], fixed[41], fixed[42]
    kx, ky, kz = r0 * px + r1 * py + r2 * pz, r3 * px + r4 * py + r5 * pz, r6 * px + r7 * py + r8 * pz
    a0, a1, a2 = r0 * ixx + r1 * ixy + r2 * ixz, r0 * ixy + r1 * iyy + r2 * iyz, r0 * ixz + r1 * iyz + r2 * izz
    b0, b1, b2 = r3 * ixx + r4 * ixy + r5 * ixz, r3 * ixy + r4 * iyy + r5 * iyz, r3 * ixz + r4 * iyz + r5 * izz
    c0, c1, c2 = r6 * ixx + r7 * ixy + r8 * ixz, r6 * ixy + r7 * iyy + r8 * iyz, r6 * ixz + r7 * iyz + r8 * izz
    # With the origin o of the joint and k = m c: I + (2 o.k + m o.o) 1 - o k' - k o' - m o o'.
    hx, hy, hz = kx + m * x, ky + m * y, kz + m * z
    round_ = dot(x, y, z, kx + hx, ky + hy, kz + hz)
    xx = a0 * r0 + a1 * r1 + a2 * r2 + round_ - x * (kx + hx)
    xy = a0 * r3 + a1 * r4 + a2 * r5 - x * ky - hx * y
    yy = b0 * r3 + b1 * r4 + b2 * r5 + round_ - y * (ky + hy)
    xz = a0 * r6 + a1 * r7 + a2 * r8 - x * kz - hx * z
    yz = b0 * r6 + b1 * r7 + b2 * r8 - y * kz - hy * z
    zz = c0 * r6 + c1 * r7 + c2 * r8 + round_ - z * (kz + hz)
    row[36], row[37], row[38], row[39] = m, hx, hy, hz
    row[40], row[41], row[42], row[43], row[44], row[45] = xx, xy, yy, xz, yz, zz
    # Force that moves the body: I dV + V x* I V.
    l0, l1, l2, p0, p1, p2 = _momentum(m, hx, hy, hz, xx, xy, yy, xz, yz, zz, wx, wy, wz, ux, uy, uz)
    n0, n1, n2, f0, f1, f2 = _momentum(m, hx, hy, hz, xx, xy, yy, xz, yz, zz, dwx, dwy, dwz, dux, duy, duz)
    g0, g1, g2 = cross(wx, wy, wz, l0, l1, l2)
    e0, e1, e2 = cross(ux, uy, uz, p0, p1, p2)
    d0, d1, d2 = cross(wx, wy, wz, p0, p1, p2)
    row[30], row[31], row[32] = n0 + g0 + e0, n1 + g1 + e1, n2 + g2 + e2
    row[33], row[34], row[35] = f0 + d0, f1 + d1, f2 + d2


@jit
def _momentum(
    m: float, hx: float, hy: float, hz: float, xx: float, xy: float, yy: float, xz: float, yz: float, zz: float,
    wx: float, wy: float, wz: float, vx: float, vy: float, vz: float,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """Angular and linear momentum about the origin: an inertia about the origin times a twist."""
    ax, ay, az = cross(hx, hy, hz, vx, vy, vz)
    bx, by, bz = cross(wx, wy, wz, hx, hy, hz)
    return (
        xx * wx + xy * wy + xz * wz + ax,
        xy * wx + yy * wy + yz * wz + ay,
        xz * wx + yz * wy + zz * wz + az,
        m * vx + bx,
        m * vy + by,
        m * vz + bz,
    )


@jit
def invert(matrix: Array) -> bool:
    """Overwrite a symmetric matrix by its inverse (Gauss-Jordan without pivoting); False if not positive definite."""
    n = len(matrix)
    for k in range(n):
        # The negated comparison is true for NaN, too.
        if not matrix[k, k] > 0.0:
            return False
        share = 1.0 / matrix[k, k]
        for i in range(n):
            if i != k:
                # All rows need the old column k, which is scaled after this loop.
                scaled = matrix[i, k] * share
                for j in range(n):
                    if j != k:
                        matrix[i, j] -= scaled * matrix[k, j]
        for i in range(n):
            if i != k:
                matrix[i, k] *= -share
                matrix[k, i] *= share
        matrix[k, k] = share
    return True
