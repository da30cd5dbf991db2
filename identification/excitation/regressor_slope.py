# pyright: reportAttributeAccessIssue=false
r"""Exact gradient of a scalar made of the rigid-body regressor, :math:`\sum_k \mathrm{tr}(S_k^T Y(q_k, v_k, a_k))`.

Every criterion of excitation, and every torque, is such a scalar to first order. One pass over the bodies gives its
slope in all positions, velocities and accelerations, at the cost of about two regressors and without differences.

In the frame of body b, let :math:`J_i` be the axes of the joints that carry it, V and A its velocity and acceleration
(gravity included), and :math:`I^{(i)}` the inertia whose parameters are row i of S. Then

.. math:: L = \sum_b \sum_i J_i \cdot f_i, \qquad f_i = I^{(i)} A + V \times^* I^{(i)} V .

As seen from body b, a motion of joint j moves only what lies before j. With l the parent of j and
:math:`D_j = V_l \times J_j`, it is :math:`\delta J_i = J_i \times J_j` for i before j, :math:`\delta V = D_j`, and
:math:`\delta A = A_l \times J_j + D_j \times (V - V_l)`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.excitation.slope_loop import slope_loop
from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class Slope:
    """Slope of a scalar in the positions, velocities and accelerations of N samples of the tree, each ``(N, nt)``."""

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
    r""":math:`\sum_k \mathrm{tr}(S_k^T Y_k)` and its slope in the motion, with S constant.

    Args:
        model: A tree of joints with one velocity each.
        q: Joint positions [rad or m], shape ``(N, nt)``; a continuous joint by its angle.
        v: Joint velocities, shape ``(N, nt)``.
        a: Joint accelerations, shape ``(N, nt)``.
        S: Weight of each entry of the regressor, columns as in `phantom_dyn.dynamics.dynamics.rigid_body_regressor`.

    Returns:
        The sum, and its slope.
    """
    motion = np.stack([q, v, a], axis=2)
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
