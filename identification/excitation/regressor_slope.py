# pyright: reportAttributeAccessIssue=false
r"""Exact gradient of a scalar made of the rigid-body regressor, :math:`\sum_k \mathrm{tr}(S_k^T Y(q_k, v_k, a_k))`.

Every criterion of excitation, and every torque, is such a scalar to first order. One pass over the bodies gives its
slope in all positions, velocities and accelerations, at the cost of about two regressors and with no difference taken.

In the frame of body b, let :math:`J_i` be the axes of the joints that carry it, V and A its velocity and acceleration
(gravity included), and :math:`I^{(i)}` the inertia whose parameters are row i of S. Then

.. math:: L = \sum_b \sum_i J_i \cdot f_i, \qquad f_i = I^{(i)} A + V \times^* I^{(i)} V .

Moving joint j moves, as seen from body b, only what lies before j: with l the parent of j and
:math:`D_j = V_l \times J_j`, it is :math:`\delta J_i = J_i \times J_j` for i before j, :math:`\delta V = D_j`, and
:math:`\delta A = A_l \times J_j + D_j \times (V - V_l)`.

A vector of N samples is an array ``(3, ..., N)`` and a spatial vector ``(6, ..., N)``, linear part first: components
first keeps each of them in one stretch of memory, which NumPy goes through faster than through ``(N, ..., 3)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.excitation.slope_loop import slope_loop
from phantom_dyn._kernels.jit import compiles
from phantom_dyn.array_types import Array, Float


def cross(a: Float[Array, "3 ..."], b: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
    """Vector product, broadcast over all axes but the first."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def motion_cross(x: Float[Array, "6 ..."], y: Float[Array, "6 ..."]) -> Float[Array, "6 ..."]:
    """How the motion ``y`` changes when it is carried along by the motion ``x``."""
    linear = cross(x[3:], y[:3]) + cross(x[:3], y[3:])
    return np.concatenate([linear, cross(x[3:], y[3:])])


def force_cross(x: Float[Array, "6 ..."], f: Float[Array, "6 ..."]) -> Float[Array, "6 ..."]:
    """How the force ``f`` changes when ``x`` carries it along: its power on y is minus that of f on x cross y."""
    moment = cross(x[3:], f[3:]) + cross(x[:3], f[:3])
    return np.concatenate([cross(x[3:], f[:3]), moment])


def inner(x: Float[Array, "6 ..."], f: Float[Array, "6 ..."]) -> Float[Array, "..."]:
    """Power of a force on a motion."""
    return (x * f).sum(axis=0)


def momentum(pi: Float[Array, "10 ..."], x: Float[Array, "6 ..."]) -> Float[Array, "6 ..."]:
    """Inertia times motion, of bodies with the parameters ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``."""
    h, v, w = pi[1:4], x[:3], x[3:]
    out = np.empty((6, *np.broadcast_shapes(pi.shape[1:], x.shape[1:])))
    out[:3] = pi[0] * v - cross(h, w)
    out[3:] = cross(h, v)
    out[3] += pi[4] * w[0] + pi[5] * w[1] + pi[7] * w[2]
    out[4] += pi[5] * w[0] + pi[6] * w[1] + pi[8] * w[2]
    out[5] += pi[7] * w[0] + pi[8] * w[1] + pi[9] * w[2]
    return out


def into_child(R: Float[Array, "3 3 N"], p: Float[Array, "3 N"], x: Float[Array, "6 n N"]) -> Float[Array, "6 n N"]:
    """Motions of the parent's frame as seen from a child at ``p``, whose axes are the columns of ``R``."""
    at_child = np.stack([x[:3] - cross(p[:, None], x[3:]), x[3:]])
    out = np.empty_like(x)
    for k in range(3):
        turned = R[0, k] * at_child[:, 0] + R[1, k] * at_child[:, 1] + R[2, k] * at_child[:, 2]
        out[k], out[3 + k] = turned
    return out


@dataclass(frozen=True)
class Slope:
    """Slope of a scalar in the positions, velocities and accelerations of N samples of the tree, each ``(N, nt)``."""

    q: Float[Array, "N nt"]
    v: Float[Array, "N nt"]
    a: Float[Array, "N nt"]


@dataclass(frozen=True)
class _Body:
    """What body b carries for the bodies after it: its joints, their axes and the motions of their parents."""

    joints: tuple[int, ...]
    J: Float[Array, "6 n N"]
    V_before: Float[Array, "6 n N"]
    A_before: Float[Array, "6 n N"]
    V: Float[Array, "6 N"]
    A: Float[Array, "6 N"]


def regressor_slope(
    model: pin.Model,
    q: Float[Array, "N nt"],
    v: Float[Array, "N nt"],
    a: Float[Array, "N nt"],
    S: Float[Array, "N nt p"],
) -> tuple[float, Slope]:
    r""":math:`\sum_k \mathrm{tr}(S_k^T Y_k)` and its slope in the motion, S held.

    Args:
        model: A tree of joints with one velocity each.
        q: Joint positions [rad or m]; a continuous joint by its angle.
        v: Velocities.
        a: Accelerations.
        S: Weight of each entry of the regressor, columns as in `phantom_dyn.dynamics.dynamics.rigid_body_regressor`.

    Returns:
        The sum, and its slope.
    """
    if compiles():
        return _compiled_slope(model, np.stack([q, v, a], axis=2), S)
    n, nt = q.shape
    # Components first, samples last: see `identification.excitation.regressor_slope`.
    weights = np.ascontiguousarray(S.transpose(2, 1, 0))
    slope = np.zeros((3, nt, n))
    total = 0.0
    bodies = [_base(model, n)]
    for b in range(1, model.njoints):
        body = _next(model, b, bodies[model.parents[b]], q[:, b - 1], v[:, b - 1], a[:, b - 1])
        bodies.append(body)
        total += _add_slope(body, weights[10 * (b - 1) : 10 * b], slope)
    return total, Slope(*(np.ascontiguousarray(part.T) for part in slope))


def _compiled_slope(model: pin.Model, motion: Float[Array, "N nt 3"], S: Float[Array, "N nt p"]) -> tuple[float, Slope]:
    count, samples = model.njoints, len(motion)
    parents = np.array(model.parents, dtype=np.int64)
    joints, counts = np.zeros((count, count), dtype=np.int64), np.zeros(count, dtype=np.int64)
    for b in range(1, count):
        before = counts[parents[b]]
        joints[b, :before], joints[b, before], counts[b] = joints[parents[b], :before], b - 1, before + 1
    rotations = np.array([place.rotation for place in model.jointPlacements])
    translations = np.array([place.translation for place in model.jointPlacements])
    twists = np.array([np.zeros(6), *(_twist(model, b) for b in range(1, count))])
    slope = np.zeros((samples, 3, count - 1))
    weights = np.ascontiguousarray(S).reshape(samples, count - 1, count - 1, 10)
    tree = (parents, rotations, translations, twists, counts)
    total = slope_loop(tree, joints, model.gravity.vector, motion, weights, slope)
    return total, Slope(*np.ascontiguousarray(slope.transpose(1, 0, 2)))


def _twist(model: pin.Model, b: int) -> Float[Array, "6"]:
    """Velocity of a body per velocity of its joint, in its own frame."""
    return np.asarray(model.joints[b].createData().S, dtype=float).reshape(6)


def _base(model: pin.Model, n: int) -> _Body:
    none = np.zeros((6, 0, n))
    gravity = np.broadcast_to(-model.gravity.vector[:, None], (6, n))
    return _Body((), none, none, none, np.zeros((6, n)), gravity)


def _next(model: pin.Model, b: int, parent: _Body, q: Array, v: Array, a: Array) -> _Body:
    """Body b behind its parent; `model.joints[b].idx_v` is ``b - 1``, as every joint has one velocity."""
    n = len(q)
    twist = _twist(model, b)
    place = model.jointPlacements[b]
    R = np.einsum("ij,jkn->ikn", place.rotation, _turned(twist[3:], q))
    p = place.translation[:, None] + (place.rotation @ twist[:3])[:, None] * q
    count = len(parent.joints)
    carried = [parent.J, parent.V_before, parent.A_before, parent.V[:, None], parent.A[:, None]]
    seen = into_child(R, p, np.concatenate(carried, axis=1))
    axis = np.broadcast_to(twist[:, None], (6, n))
    V_parent, A_parent = seen[:, 3 * count], seen[:, 3 * count + 1]
    V = V_parent + axis * v
    A = A_parent + axis * a + motion_cross(V, axis) * v
    return _Body(
        (*parent.joints, b - 1),
        np.concatenate([seen[:, :count], axis[:, None]], axis=1),
        np.concatenate([seen[:, count : 2 * count], V_parent[:, None]], axis=1),
        np.concatenate([seen[:, 2 * count : 3 * count], A_parent[:, None]], axis=1),
        V,
        A,
    )


def _add_slope(body: _Body, weights: Float[Array, "10 nt N"], slope: Float[Array, "3 nt N"]) -> float:
    """Add what one body gives to the slope; returns its part of the sum."""
    joints = list(body.joints)
    pi, J, V, A = weights[:, joints], body.J, body.V[:, None], body.A[:, None]
    h = momentum(pi, V)
    f = momentum(pi, A) + force_cross(V, h)
    to_A = momentum(pi, J).sum(axis=1)[:, None]
    to_V = -(momentum(pi, motion_cross(V, J)) + force_cross(J, h)).sum(axis=1)[:, None]
    D = motion_cross(body.V_before, J)
    moved = motion_cross(body.A_before, J) + motion_cross(D, V - body.V_before)
    # The pull on axes before j when j turns: an exclusive sum over the joints from the base on.
    pulled = np.cumsum(force_cross(J, f), axis=1)
    pulled[:, 1:] = pulled[:, :-1].copy()
    pulled[:, 0] = 0.0
    slope[0, joints] += inner(D, to_V) + inner(moved, to_A) - inner(J, pulled)
    slope[1, joints] += inner(J, to_V) + inner(2 * D + motion_cross(J, V), to_A)
    slope[2, joints] += inner(J, to_A)
    return float(inner(J, f).sum())


def _turned(axis: Float[Array, "3"], angle: Float[Array, " N"]) -> Float[Array, "3 3 N"]:
    """Rotations about one axis of unit length, or the identity for one of zero length."""
    c, s = np.cos(angle), np.sin(angle)
    if not axis.any():
        return np.broadcast_to(np.eye(3)[:, :, None], (3, 3, len(angle)))
    outer, skew = np.outer(axis, axis), cross(np.tile(axis[:, None], (1, 3)), np.eye(3))
    return outer[:, :, None] * (1 - c) + np.eye(3)[:, :, None] * c + skew[:, :, None] * s
