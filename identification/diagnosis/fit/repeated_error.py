"""Error of a fit because its laws are not exact: the part of its residual that repeats at the same state.

Noise in different blocks is independent. A residual that repeats in other blocks at the same speed, position or
acceleration is no noise, but the difference between the law and the robot. The scatter from block to block does not
show it, since every block has it, and a longer recording does not make it smaller.

The variance that it gives to the parameters of a fit is that of scores summed over groups of the same state, less that
of the same scores summed within blocks alone. This is the difference that two-way clustering adds to clustering by
blocks (A. C. Cameron, J. B. Gelbach, D. L. Miller: Robust inference with multiway clustering, Journal of Business and
Economic Statistics 29, 2011). Residuals are corrected for the part that the fit has explained (CR2: R. M. Bell, D. F.
McCaffrey: Bias reduction in standard errors for linear regression with multi-stage samples, Survey Methodology 28,
2002), so that the difference is zero on average where the laws are exact.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.fit.whole_model import Linearised, ModelLayout
from phantom_dyn.array_types import Array, Float, Int

# Number of groups, of equally many samples, of a joint's velocity (slow and fast in either direction), and likewise of
# its position and its acceleration. The more groups, the fewer blocks share one.
GROUPS = 4
# A variance below this many standard deviations of what white noise alone gives counts as zero.
CHANCE = 1.0
# Leverage from which on a group alone determines a parameter: it then has no residual left to judge by.
_DECIDES = 1.0 - 1e-9
# Eigenvalues this much smaller than the largest one are rounding.
_RANK = 1e-12


@dataclass(frozen=True)
class Equations:
    """The samples of all joints that a fit has seen, one equation each, in deviations of their noise.

    Attributes:
        slopes: Derivatives of the model by its parameters, ``(m, p)``.
        residual: Residual of the fit, ``(m,)``.
        states: Group of each equation by joint and position, velocity or acceleration, ``(m,)`` each.
        blocks: Block of each equation, ``(m,)``.
    """

    slopes: Float[Array, "m p"]
    residual: Float[Array, " m"]
    states: tuple[Int[Array, " m"], ...]
    blocks: Int[Array, " m"]


def equations(layout: ModelLayout, model: Linearised) -> Equations:
    """Equations of a fit at a point, with the state of each joint in its own equations.

    Args:
        layout: Layout of the parameter vector.
        model: Torque and slopes at the point.
    """
    problem = layout.problem
    block_of = [np.full(len(residual), -1) for residual in problem.white.residual]
    for k, (block, fold) in enumerate(zip(problem.blocks, problem.grams.fold, strict=True)):
        if fold >= 0:
            block_of[block.log][block.start : block.stop] = k
    slopes, left, blocks, states = [], [], [], []
    for j, scale in enumerate(np.sqrt(problem.weights.per_sample)):
        moved = []
        for log, of_log in enumerate(block_of):
            used = (of_log >= 0) & problem.white.usable[log][:, j]
            at = problem.session.logs[log].samples[used]
            operation = layout.operations[log]
            slopes.append(model.slopes[log][used, j] * scale)
            left.append((problem.white.residual[log] - model.torque[log])[used, j] * scale)
            blocks.append(of_log[used])
            moved.append(np.stack([operation.q[at, j], operation.v[at, j], operation.a[at, j]]))
        states.append([same_states(series) + GROUPS * j for series in np.concatenate(moved, axis=1)])
    together = tuple(np.concatenate(one) for one in zip(*states, strict=True))
    return Equations(np.concatenate(slopes), np.concatenate(left), together, np.concatenate(blocks))


def repeated_variance(
    slopes: Float[Array, "m p"],
    residual: Float[Array, " m"],
    total: Float[Array, "p p"],
    states: Iterable[Int[Array, " m"]],
    blocks: Int[Array, " m"],
) -> Float[Array, " p"]:
    """Variance of each parameter of a fit by what its residual repeats from block to block at the same state.

    It is zero where white noise alone gives as much.

    Args:
        slopes: Derivatives of the equations, in deviations of their noise.
        residual: Residuals of the equations, in the same unit.
        total: ``slopes.T @ slopes`` plus the prior precision.
        states: Groups of the same state, one series of labels for each way of grouping.
        blocks: Block of each equation.
    """
    root = _root(total)
    fitted = slopes @ root
    more, chance = np.zeros(slopes.shape[1]), np.zeros(slopes.shape[1])
    for state in states:
        within_blocks = state * (blocks.max(initial=0) + 1) + blocks
        again = scatter(fitted, residual, state) - scatter(fitted, residual, within_blocks)
        more += np.einsum("pr,rs,ps->p", root, again, root)
        # With white noise, the variance of a group's score is the group's information on the parameter.
        said = [((fitted[state == group] @ root.T) ** 2).sum(axis=0) for group in np.unique(state)]
        chance += 2.0 * np.square(said).sum(axis=0)
    return np.where(more > CHANCE * np.sqrt(chance), more, 0.0)


def scatter(slopes: Float[Array, "m r"], residual: Float[Array, " m"], labels: Int[Array, " m"]) -> Float[Array, "r r"]:
    """Covariance of the parameters of a fit by the scatter of its scores from cluster to cluster (CR2).

    Args:
        slopes: Derivatives of the equations by parameters scaled so that the fit's covariance is the unit matrix.
        residual: Residuals of the equations.
        labels: Cluster of each equation; errors within one may be correlated.
    """
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order])) + 1
    scores = np.array([_score(slopes[own], residual[own]) for own in np.split(order, starts)])
    return scores.T @ scores


def _score(slopes: Float[Array, "m r"], residual: Float[Array, " m"]) -> Float[Array, " r"]:
    """Score of one cluster, with its residual corrected for the part that the fit has explained."""
    count, size = slopes.shape
    gram = slopes @ slopes.T if count < size else slopes.T @ slopes
    taken, axes = np.linalg.eigh(gram)
    taken = np.clip(taken, 0.0, None)
    grown = np.where(taken < _DECIDES, 1.0 / np.sqrt(1.0 - np.minimum(taken, _DECIDES)), 0.0)
    if count < size:
        return slopes.T @ (axes @ (grown * (axes.T @ residual)))
    return axes @ (grown * (axes.T @ (slopes.T @ residual)))


def _root(total: Float[Array, "p p"]) -> Float[Array, "p r"]:
    """``R`` with ``R R^T`` the inverse of a matrix."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    squares, axes = np.linalg.eigh(total * np.outer(scale, scale))
    kept = squares > _RANK * squares.max(initial=0.0)
    return scale[:, None] * axes[:, kept] / np.sqrt(squares[kept])


def same_states(series: Float[Array, " m"]) -> Int[Array, " m"]:
    """Groups of samples of a series by its size, equally many in each."""
    if len(series) == 0:  # a joint that never moves
        return np.zeros(0, dtype=int)
    ends = np.quantile(series, np.linspace(0.0, 1.0, GROUPS + 1)[1:-1])
    return np.searchsorted(ends, series)
