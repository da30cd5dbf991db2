"""Quick fits of each joint's torque by the model torque times a factor, friction and an offset."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from identification.data.checks.against_model import regress_joints
from identification.data.checks.readings.reading import Reading, varies, with_torques_plus
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.model.robot import Robot

# Ridge penalty for columns of length one, so that equal columns have a solution, too.
_RIDGE = 1e-9


def plain_unexplained(robot: Robot, reading: Reading) -> Float[Array, " nv"]:
    """Unexplained share of each joint's torque variance, shape ``(nv,)``; NaN for torques that do not vary.

    Each torque is fitted by the model torque, viscous and Coulomb friction with coefficients that are not negative, and
    a free offset.
    """
    needed = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    torque = reading.tau + reading.external
    ones, low = np.ones(len(torque)), np.array([0.0, 0.0, 0.0, -np.inf])
    out = np.full(torque.shape[1], np.nan)
    for j in np.flatnonzero(varies(torque)):
        columns = np.column_stack([needed[:, j], reading.motion.v[:, j], reading.sign[:, j], ones])
        size = np.linalg.norm(columns, axis=0)
        scaled = np.column_stack([columns / np.where(size > 0, size, 1.0), torque[:, j]])
        # The triangular factor has the same solution and residual, with far fewer rows.
        factor = np.asarray(np.linalg.qr(scaled, mode="r"))
        x = lsq_linear(factor[:, :-1], factor[:, -1], (low, np.inf), method="bvls", tol=1e-14, max_iter=50).x
        squares = float(np.sum((factor[:, :-1] @ x - factor[:, -1]) ** 2))
        out[j] = squares / len(torque) / float(torque[:, j].var())
    return out


def quick_unexplained(robot: Robot, reading: Reading) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Unexplained share of each torque's variance, and the factor of the model torque, shape ``(k,)`` each.

    It is faster than `plain_unexplained`, for searches over many readings: all ``k`` torques that vary are fitted at
    once, by normal equations, with friction of either sign. If the factor of a model torque is not positive, it is set
    to 0, and friction alone is fitted.
    """
    torque = reading.tau + reading.external
    vary = varies(torque)
    torque = torque[:, vary] - torque[:, vary].mean(axis=0)
    needed = (inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion))[:, vary]
    columns = np.stack([needed, reading.motion.v[:, vary], reading.sign[:, vary]], axis=2).transpose(1, 0, 2)
    columns = columns - columns.mean(axis=1, keepdims=True)
    size = np.linalg.norm(columns, axis=1, keepdims=True)
    columns = columns / np.where(size > 0, size, 1.0)
    normal = columns.transpose(0, 2, 1) @ columns + _RIDGE * np.eye(3)
    products = np.einsum("jnk,nj->jk", columns, torque)
    squares = np.sum(torque**2, axis=0)
    model_and_friction = np.linalg.solve(normal, products[:, :, None])[:, :, 0]
    friction = np.linalg.solve(normal[:, 1:, 1:], products[:, 1:, None])[:, :, 0]
    positive = model_and_friction[:, 0] > 0
    # The coefficients times the products of columns and torque are the explained sum of squares.
    by_both, by_friction = np.sum(model_and_friction * products, axis=1), np.sum(friction * products[:, 1:], axis=1)
    explained = np.where(positive, by_both, by_friction)
    factors = np.where(positive, model_and_friction[:, 0] / np.where(size[:, 0, 0] > 0, size[:, 0, 0], 1.0), 0.0)
    return np.maximum(1 - explained / squares, 0.0), factors


def common_ratio(robot: Robot, reading: Reading) -> float | None:
    """Median over the joints of the ratio of measured to modelled torque, or None.

    It is None unless the ratios of at least two joints are within a factor of two of the median. Only joints whose
    model torque explains a tenth of their torque, with a positive ratio in both halves of the recording, have a ratio.
    """
    model = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    found = regress_joints(with_torques_plus(reading, reading.external), model)
    slopes = [
        float(np.mean(one.slope)) for one in found if one is not None and one.model_share > 0.1 and min(one.slope) > 0
    ]
    if len(slopes) < 2:
        return None
    median = float(np.exp(np.median(np.log(slopes))))
    agree = [slope for slope in slopes if 0.5 < slope / median < 2.0]
    return median if len(agree) >= 2 else None
