"""Quick fits of each joint's torque by the model torque times a factor, friction and an offset."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from identification.data.checks.against_model import regress_joints
from identification.data.checks.readings.reading import Reading, varies, with_torques_plus
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.model.robot import Robot

# Ridge on columns of length one, so that the solution exists for equal columns.
_RIDGE = 1e-9


def plain_unexplained(robot: Robot, reading: Reading) -> Float[Array, " nv"]:
    """Unexplained share of each joint's torque variance, with a positive factor of the model torque and of friction.

    It is NaN for torques that do not vary.
    """
    needed = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    torque = reading.tau + reading.external
    ones, low = np.ones(len(torque)), np.array([0.0, 0.0, 0.0, -np.inf])
    out = np.full(torque.shape[1], np.nan)
    for j in np.flatnonzero(varies(torque)):
        columns = np.column_stack([needed[:, j], reading.motion.v[:, j], reading.sign[:, j], ones])
        size = np.linalg.norm(columns, axis=0)
        scaled = np.column_stack([columns / np.where(size > 0, size, 1.0), torque[:, j]])
        factor = np.asarray(np.linalg.qr(scaled, mode="r"))
        x = lsq_linear(factor[:, :-1], factor[:, -1], (low, np.inf), method="bvls", tol=1e-14, max_iter=50).x
        squares = float(np.sum((factor[:, :-1] @ x - factor[:, -1]) ** 2))
        out[j] = squares / len(torque) / float(torque[:, j].var())
    return out


def quick_unexplained(robot: Robot, reading: Reading) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Unexplained share of each torque's variance with friction of either sign, and the factor of the model torque.

    It is faster than `plain_unexplained`, for searches over many readings. A factor that is not positive counts as 0:
    then friction alone explains the torque. Torques that do not vary are left out.
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
    both = np.linalg.solve(normal, products[:, :, None])[:, :, 0]
    friction = np.linalg.solve(normal[:, 1:, 1:], products[:, 1:, None])[:, :, 0]
    positive = both[:, 0] > 0
    explained = np.where(positive, np.sum(both * products, axis=1), np.sum(friction * products[:, 1:], axis=1))
    factors = np.where(positive, both[:, 0] / np.where(size[:, 0, 0] > 0, size[:, 0, 0], 1.0), 0.0)
    return np.maximum(1 - explained / squares, 0.0), factors


def common_ratio(robot: Robot, reading: Reading) -> float | None:
    """Median ratio of measured to modelled torque, if those of two joints or more are within a factor of two of it."""
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
