# pyright: reportAttributeAccessIssue=false
r"""Exact gradient of a linear function of the regressor, :math:`\sum_k \mathrm{tr}(S_k^T Y(q_k, v_k, a_k))`.

To first order, every excitation criterion and every torque is such a function, with constant weights S. One pass over
the bodies yields its gradient with respect to all positions, velocities and accelerations, without finite differences
and in the time of about two regressors.

In the frame of body b, let :math:`J_i` be the axes of the joints that carry it, V and A its velocity and acceleration
(gravity included), and :math:`I^{(i)}` the inertia whose parameters are row i of S. Then

.. math:: L = \sum_b \sum_i J_i \cdot f_i, \qquad f_i = I^{(i)} A + V \times^* I^{(i)} V .

Seen from body b, a motion of joint j moves only the joints and bodies before j. With l the parent of j and
:math:`D_j = V_l \times J_j`, the changes are :math:`\delta J_i = J_i \times J_j` for i before j,
:math:`\delta V = D_j`, and :math:`\delta A = A_l \times J_j + D_j \times (V - V_l)`.

In the compiled loop over samples, a spatial vector has six numbers, the linear part first. Each body stores J, D and
:math:`M_j = A_l \times J_j - D_j \times V_l` of each joint that carries it. All three are motion vectors, with the same
transformation from body to body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class Slope:
    """Gradient of a scalar by positions, velocities and accelerations of N samples of the tree, each ``(N, nt)``."""

    q: Float[Array, "N nt"]
    v: Float[Array, "N nt"]
    a: Float[Array, "N nt"]


def regressor_slope(
    model: pin.Model,
    q: Float[Array, "N nt"],
    v: Float[Array, "N nt"],
    a: Float[Array, "N nt"],
    S: Float[Array, "N nt p"],
) -> tuple[float, Slope]:
    r""":math:`\sum_k \mathrm{tr}(S_k^T Y_k)` and its gradient with respect to the motion, with S constant.

    Args:
        model: A tree of joints with one velocity each.
        q: Joint positions [rad or m], shape ``(N, nt)``; the angle of a continuous joint.
        v: Joint velocities, shape ``(N, nt)``.
        a: Joint accelerations, shape ``(N, nt)``.
        S: Weight of each entry of the regressor, columns as in `phantom_dyn.dynamics.dynamics.rigid_body_regressor`.

    Returns:
        The sum, and its gradient.
    """
    motion = np.stack([q, v, a], axis=2)
    count, samples = model.njoints, len(motion)
    parents = np.array(model.parents, dtype=np.int64)
    joints, counts = np.zeros((count, count), dtype=np.int64), np.zeros(count, dtype=np.int64)
    for b in range(1, count):
        before = counts[parents[b]]
        joints[b, :before] = joints[parents[b], :before]
        joints[b, before] = b - 1
        counts[b] = before + 1
    rotations = np.array([place.rotation for place in model.jointPlacements])
    translations = np.array([place.translation for place in model.jointPlacements])
    # Velocity of each body per velocity of its joint, in its own frame.
    axes = (np.asarray(joint.createData().S, dtype=float).reshape(6) for joint in list(model.joints)[1:])
    twists = np.array([np.zeros(6), *axes])
    slope = np.zeros((samples, 3, count - 1))
    weights = np.ascontiguousarray(S).reshape(samples, count - 1, count - 1, 10)
    tree = (parents, rotations, translations, twists, counts)
    total = slope_loop(tree, joints, model.gravity.vector, motion, weights, slope)
    return total, Slope(*np.ascontiguousarray(slope.transpose(1, 0, 2)))


@inlined
def to_child(R: Array, p: Array, x: Array, out: Array) -> None:
    """Transform a motion from the parent's frame to that of a child at ``p``, whose axes are the columns of ``R``."""
    u = x[0] - (p[1] * x[5] - p[2] * x[4])
    v = x[1] - (p[2] * x[3] - p[0] * x[5])
    w = x[2] - (p[0] * x[4] - p[1] * x[3])
    for k in range(3):
        out[k] = R[0, k] * u + R[1, k] * v + R[2, k] * w
        out[3 + k] = R[0, k] * x[3] + R[1, k] * x[4] + R[2, k] * x[5]


@inlined
def add_motion_cross(x: Array, y: Array, factor: float, out: Array) -> None:
    """Add the spatial cross product of the motions ``x`` and ``y``, times ``factor``."""
    out[0] += factor * (x[4] * y[2] - x[5] * y[1] + x[1] * y[5] - x[2] * y[4])
    out[1] += factor * (x[5] * y[0] - x[3] * y[2] + x[2] * y[3] - x[0] * y[5])
    out[2] += factor * (x[3] * y[1] - x[4] * y[0] + x[0] * y[4] - x[1] * y[3])
    out[3] += factor * (x[4] * y[5] - x[5] * y[4])
    out[4] += factor * (x[5] * y[3] - x[3] * y[5])
    out[5] += factor * (x[3] * y[4] - x[4] * y[3])


@inlined
def add_force_cross(x: Array, f: Array, factor: float, out: Array) -> None:
    """Add the spatial cross product of the motion ``x`` and the force ``f`` (dual), times ``factor``."""
    out[0] += factor * (x[4] * f[2] - x[5] * f[1])
    out[1] += factor * (x[5] * f[0] - x[3] * f[2])
    out[2] += factor * (x[3] * f[1] - x[4] * f[0])
    out[3] += factor * (x[4] * f[5] - x[5] * f[4] + x[1] * f[2] - x[2] * f[1])
    out[4] += factor * (x[5] * f[3] - x[3] * f[5] + x[2] * f[0] - x[0] * f[2])
    out[5] += factor * (x[3] * f[4] - x[4] * f[3] + x[0] * f[1] - x[1] * f[0])


@inlined
def add_momentum(pi: Array, x: Array, factor: float, out: Array) -> None:
    """Add inertia times motion, times ``factor``; parameters are ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``."""
    out[0] += factor * (pi[0] * x[0] - (pi[2] * x[5] - pi[3] * x[4]))
    out[1] += factor * (pi[0] * x[1] - (pi[3] * x[3] - pi[1] * x[5]))
    out[2] += factor * (pi[0] * x[2] - (pi[1] * x[4] - pi[2] * x[3]))
    out[3] += factor * (pi[2] * x[2] - pi[3] * x[1] + pi[4] * x[3] + pi[5] * x[4] + pi[7] * x[5])
    out[4] += factor * (pi[3] * x[0] - pi[1] * x[2] + pi[5] * x[3] + pi[6] * x[4] + pi[8] * x[5])
    out[5] += factor * (pi[1] * x[1] - pi[2] * x[0] + pi[7] * x[3] + pi[8] * x[4] + pi[9] * x[5])


@inlined
def inner(x: Array, f: Array) -> float:
    """Power of a force on a motion."""
    return x[0] * f[0] + x[1] * f[1] + x[2] * f[2] + x[3] * f[3] + x[4] * f[4] + x[5] * f[5]


@inlined
def write_rotation(twist: Array, angle: float, R: Array) -> None:
    """Write the rotation about the axis of a twist, a unit vector; the identity for a linear joint, without an axis."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = twist[3], twist[4], twist[5]
    d = 1.0 - c
    if x == 0.0 and y == 0.0 and z == 0.0:
        c, s, d = 1.0, 0.0, 0.0
    R[0, 0], R[0, 1], R[0, 2] = c + x * x * d, x * y * d - z * s, x * z * d + y * s
    R[1, 0], R[1, 1], R[1, 2] = y * x * d + z * s, c + y * y * d, y * z * d - x * s
    R[2, 0], R[2, 1], R[2, 2] = z * x * d - y * s, z * y * d + x * s, c + z * z * d


@fused
def propagate(
    b: int, tree: tuple[Array, ...], carried: Array, buffer: Array, joint_motion: Array, state: Array
) -> None:
    """Write J, D, M, V and A of a body from those of its parent (forward pass).

    Args:
        b: Index of the body.
        tree: Parents, rotations, translations, twists and numbers of joints, as in `slope_loop`.
        carried: J, D and M of each joint of each body, ``(n, n, 3, 6)``.
        buffer: Working memory for two rotations, ``(2, 3, 3)``.
        joint_motion: Position, velocity and acceleration of the body's joint, ``(3,)``.
        state: V and A of each body, ``(n, 2, 6)``.
    """
    parents, rotations, translations, twists, counts = tree
    parent, twist, R_placement, (R_joint, R) = parents[b], twists[b], rotations[b], (buffer[0], buffer[1])
    index = counts[parent]
    write_rotation(twist, joint_motion[0], R_joint)
    p = np.empty(3)
    for i in range(3):
        p[i] = translations[b, i]
        for j in range(3):
            p[i] += R_placement[i, j] * twist[j] * joint_motion[0]
            R[i, j] = (
                R_placement[i, 0] * R_joint[0, j]
                + R_placement[i, 1] * R_joint[1, j]
                + R_placement[i, 2] * R_joint[2, j]
            )
    for j in range(index):
        for part in range(3):
            to_child(R, p, carried[parent, j, part], carried[b, j, part])
    J, D, M, V, A = carried[b, index, 0], carried[b, index, 1], carried[b, index, 2], state[b, 0], state[b, 1]
    to_child(R, p, state[parent, 0], V)
    to_child(R, p, state[parent, 1], A)
    for i in range(6):
        J[i], D[i], M[i] = twist[i], 0.0, 0.0
    add_motion_cross(V, J, 1.0, D)
    add_motion_cross(A, J, 1.0, M)
    add_motion_cross(D, V, -1.0, M)
    for i in range(6):
        V[i] += joint_motion[1] * J[i]
        A[i] += joint_motion[2] * J[i]
    add_motion_cross(V, J, joint_motion[1], A)


@fused
def add_slope(
    b: int, count: int, joints: Array, carried: Array, state: Array, S: Array, work: Array, slope: Array
) -> float:
    """Add the contribution of one body to the slope at a sample; returns its part of the sum.

    Args:
        b: Index of the body.
        count: Number of joints that carry it.
        joints: Indices of these joints, from the base on, ``(n, n)``.
        carried: J, D and M of each joint of each body, ``(n, n, 3, 6)``.
        state: V and A of each body, ``(n, 2, 6)``.
        S: Weights of the ten parameters on each row of each body, ``(n - 1, n - 1, 10)``.
        work: Working memory for five spatial vectors and one for each joint, ``(5 + n, 6)``.
        slope: Slope to which is added, ``(3, n - 1)``.
    """
    h, f, dL_dA, dL_dV, x = work[0], work[1], work[2], work[3], work[4]
    V, A = state[b, 0], state[b, 1]
    for i in range(6):
        dL_dA[i] = dL_dV[i] = 0.0
    total = 0.0
    for j in range(count):
        J, pi, dJf = carried[b, j, 0], S[joints[b, j], b - 1], work[5 + j]
        for i in range(6):
            h[i] = f[i] = x[i] = dJf[i] = 0.0
        add_momentum(pi, V, 1.0, h)
        add_momentum(pi, A, 1.0, f)
        add_force_cross(V, h, 1.0, f)
        add_momentum(pi, J, 1.0, dL_dA)
        add_motion_cross(V, J, 1.0, x)
        add_momentum(pi, x, -1.0, dL_dV)
        add_force_cross(J, h, -1.0, dL_dV)
        add_force_cross(J, f, 1.0, dJf)
        total += inner(J, f)
    # Sum of J_i x* f_i over the joints i before joint j. It reuses the memory of h, which is not needed any more.
    sum_dJf = h
    for i in range(6):
        sum_dJf[i] = 0.0
    for j in range(count):
        J, D, M, row = carried[b, j, 0], carried[b, j, 1], carried[b, j, 2], joints[b, j]
        for i in range(6):
            x[i] = M[i]
        add_motion_cross(D, V, 1.0, x)
        slope[0, row] += inner(D, dL_dV) + inner(x, dL_dA) - inner(J, sum_dJf)
        for i in range(6):
            x[i] = 2.0 * D[i]
            sum_dJf[i] += work[5 + j, i]
        add_motion_cross(J, V, 1.0, x)
        slope[1, row] += inner(J, dL_dV) + inner(x, dL_dA)
        slope[2, row] += inner(J, dL_dA)
    return total


@fused
def slope_loop(tree: tuple[Array, ...], joints: Array, gravity: Array, motion: Array, S: Array, slope: Array) -> float:
    """Write the slope of the sum of a weighted regressor; returns the sum.

    Args:
        tree: Arrays over the bodies of the tree, the root first: parent, ``(n,)``; rotation ``(n, 3, 3)`` and position
            [m] ``(n, 3)`` of the joint in the frame of the parent; twist of the body per velocity of its joint, in the
            frame of the body, ``(n, 6)``; number of joints that carry the body, ``(n,)``.
        joints: Indices of the joints that carry each body, from the base on, ``(n, n)``.
        gravity: Gravity as a spatial vector [m/s^2], ``(6,)``.
        motion: Positions, velocities and accelerations, ``(N, n - 1, 3)``.
        S: Weights, ``(N, n - 1, n - 1, 10)``: row, then body.
        slope: Receives the slopes in positions, velocities and accelerations, ``(N, 3, n - 1)``; zero before.
    """
    counts = tree[4]
    n = len(counts)
    carried, state, work, rotation_buffer = (
        np.zeros((n, n, 3, 6)),
        np.zeros((n, 2, 6)),
        np.zeros((5 + n, 6)),
        np.zeros((2, 3, 3)),
    )
    for i in range(6):
        state[0, 1, i] = -gravity[i]
    total = 0.0
    for k in range(len(motion)):
        for b in range(1, n):
            propagate(b, tree, carried, rotation_buffer, motion[k, b - 1], state)
            total += add_slope(b, counts[b], joints, carried, state, S[k], work, slope[k])
    return total
