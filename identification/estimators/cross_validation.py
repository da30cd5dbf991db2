"""Error of a model on samples that its fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg import solve_triangular

from identification.data.log import Log
from identification.regression.base_parameters import base_parameters_of_matrix
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from identification.regression.triangular import r_factor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot


def cross_validate(
    robot: Robot, logs: Log | Sequence[Log], effects: Sequence[EffectOnJoint] = (), *, folds: int = 5
) -> Float[Array, " nv"]:
    """Relative error of each joint's torque [%], every sample predicted by a least-squares fit of the other folds.

    Folds are contiguous stretches of all samples in a row. Samples that share a part of the filter's kernel with a
    fold are left out of its training. Each training set chooses its own base parameters.

    Args:
        robot: Gives the rigid body.
        logs: One recording or several.
        effects: What acts on the joints beside the rigid body.
        folds: How many.

    Returns:
        100 times RMS residual over RMS measured torque, shape ``(nv,)``; nan for a joint without torque.

    Raises:
        ParameterError: If there are fewer than two folds, or fewer than two samples in one.
    """
    return cross_validation_error(torque_regressor(robot, logs, effects), folds=folds)


def cross_validation_error(regressor: Regressor, *, folds: int = 5) -> Float[Array, " nv"]:
    """`cross_validate` on equations that are made already.

    Args:
        regressor: The equations.
        folds: How many.

    Raises:
        ParameterError: If there are fewer than two folds, or fewer than two samples in one.
    """
    if folds < 2 or regressor.count < 2 * folds:
        raise ParameterError(
            f"{folds} folds of {regressor.count} samples were asked for: take at least two folds of two samples."
        )
    edges = np.linspace(0, regressor.count, folds + 1).round().astype(int)
    guard = max(2 * log.band.half // log.band.step for log in regressor.logs)
    # Each fold's equations are needed without their ends too: one factor for the middle, one for either end.
    cuts = np.unique(np.concatenate([edges, edges[1:-1] - guard, edges[1:-1] + guard]).clip(0, regressor.count))
    pieces = _factors(regressor, cuts)
    centres = 0.5 * (cuts[:-1] + cuts[1:])
    theta = []
    for start, stop in pairwise(edges):
        outside = (centres < start - guard) | (centres > stop + guard)
        if not outside.any():
            raise ParameterError(f"{folds} folds leave nothing to train on beside the filter's reach: take fewer.")
        theta.append(_solution(regressor, r_factor([p for p, use in zip(pieces, outside, strict=True) if use])))
    residual = np.empty_like(regressor.y)
    fold = np.searchsorted(edges, np.arange(regressor.count), side="right") - 1
    start = 0
    for block in regressor.blocks():
        at = slice(start, start + len(block))
        residual[at] = regressor.y[at] - np.einsum("njp,np->nj", block, np.array(theta)[fold[at]], optimize=True)
        start += len(block)
    error = np.full(regressor.robot.nv, np.nan)
    size = np.sqrt(np.mean(regressor.measured**2, axis=0))
    return np.divide(100 * np.sqrt(np.mean(residual**2, axis=0)), size, out=error, where=size > 0)


def _factors(regressor: Regressor, cuts: Array) -> list[Array]:
    """Triangular factor of columns and torque between each pair of neighbouring cuts."""
    width = len(regressor.names) + 1
    pieces = [np.zeros((0, width)) for _ in cuts[:-1]]
    start = 0
    for block in regressor.blocks():
        stop = start + len(block)
        rows = np.concatenate([block, regressor.y[start:stop][:, :, None]], axis=2)
        for k in range(np.searchsorted(cuts, start, side="right") - 1, np.searchsorted(cuts, stop)):
            low, high = max(cuts[k], start), min(cuts[k + 1], stop)
            pieces[k] = r_factor([pieces[k], rows[low - start : high - start]])
        start = stop
    return pieces


def _solution(regressor: Regressor, factor: Array) -> Array:
    """All parameters, those that regroup at zero, from the factor of columns and torque."""
    base = base_parameters_of_matrix(factor[:, :-1], regressor.names, regressor.units)
    kept = list(base.independent)
    theta = np.zeros(len(regressor.names))
    if kept:
        small = r_factor([factor[:, [*kept, -1]]])
        theta[kept] = solve_triangular(small[: len(kept), : len(kept)], small[: len(kept), -1])
    return theta
