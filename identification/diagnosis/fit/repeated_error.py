"""Variance of the parameters of a fit whose laws are not exact, from the part of its residual that repeats.

Noise in different blocks is independent. A residual that repeats in other blocks at the same speed, position or
acceleration is not noise, but an error of the laws. The scatter from block to block does not include this error, since
it is the same in every block, and a longer recording does not reduce it.

The score of a sample is its residual times its slopes, the derivatives of the model with respect to the parameters.
Scores of samples at the same state are summed over all blocks, and within each block alone. The variance of the first
sums minus that of the second ones is the additional variance of the parameters. Two-way clustering adds this term to
clustering by blocks (A. C. Cameron, J. B. Gelbach, D. L. Miller: Robust inference with multiway clustering, Journal of
Business and Economic Statistics 29, 2011). Residuals are corrected for the part that the fit has explained (CR2: R. M.
Bell, D. F. McCaffrey: Bias reduction in standard errors for linear regression with multi-stage samples, Survey
Methodology 28, 2002), so that the term is zero on average where the laws are exact.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.fit.whole_model import Linearised, ModelLayout
from phantom_dyn.array_types import Array, Float, Int

# Number of groups into which a joint's samples are divided by velocity (slow and fast in either direction), by position
# and by acceleration, with equally many samples in each. With more groups, fewer blocks have samples in the same group.
STATE_GROUPS = 4
# A variance is set to zero if it is below this many standard deviations of the variance from white noise alone.
CHANCE_DEVIATIONS = 1.0
# Leverage above which one cluster determines a parameter. Its residual is then always zero, so it is not used.
_FULL_LEVERAGE = 1.0 - 1e-9
# Eigenvalues below this share of the largest one are rounding errors, and their directions are left out.
_ROUNDING_SHARE = 1e-12


@dataclass(frozen=True)
class Equations:
    """The equations of a fit, one for each joint and sample, divided by the standard deviation of their noise.

    Attributes:
        slopes: Derivatives of the model with respect to its parameters, ``(m, p)``.
        residual: Residual of the fit, ``(m,)``.
        states: Group of each equation, ``(m,)``, in three ways: by joint and position, by joint and velocity, and by
            joint and acceleration.
        blocks: Block of each equation, ``(m,)``.
    """

    slopes: Float[Array, "m p"]
    residual: Float[Array, " m"]
    states: tuple[Int[Array, " m"], ...]
    blocks: Int[Array, " m"]


def equations(layout: ModelLayout, model: Linearised) -> Equations:
    """Equations of a fit, linearised at a point; the state of an equation is that of its joint.

    Args:
        layout: Layout of the parameter vector.
        model: Torque and slopes at the point.
    """
    problem = layout.problem
    block_of = [np.full(len(residual), -1) for residual in problem.white.residual]
    for k, (block, fold) in enumerate(zip(problem.blocks, problem.grams.fold, strict=True)):
        if fold >= 0:
            block_of[block.log][block.start : block.stop] = k
    slopes, residuals, blocks, states = [], [], [], []
    for j in range(problem.session.robot.nv):
        motion = []
        for log, of_log in enumerate(block_of):
            used = (of_log >= 0) & problem.white.usable[log][:, j]
            scale = problem.weights.scale(log, slice(0, len(used)))[used, j]
            at = problem.session.logs[log].samples[used]
            operation = layout.operations[log]
            slopes.append(model.slopes[log][used, j] * scale[:, None])
            residuals.append((problem.white.residual[log] - model.torque[log])[used, j] * scale)
            blocks.append(of_log[used])
            motion.append(np.stack([operation.q[at, j], operation.v[at, j], operation.a[at, j]]))
        states.append([state_groups(series) + STATE_GROUPS * j for series in np.concatenate(motion, axis=1)])
    groups = tuple(np.concatenate(of_joints) for of_joints in zip(*states, strict=True))
    return Equations(np.concatenate(slopes), np.concatenate(residuals), groups, np.concatenate(blocks))


def repeated_covariance(
    slopes: Float[Array, "m p"],
    residual: Float[Array, " m"],
    total: Float[Array, "p p"],
    states: Iterable[Int[Array, " m"]],
    blocks: Int[Array, " m"],
) -> Float[Array, "p p"]:
    """Covariance of the parameters of a fit from residuals that repeat in several blocks at the same state.

    It is zero for parameters whose variance may be that of white noise alone.

    Args:
        slopes: Derivatives of the equations, divided by the standard deviation of their noise.
        residual: Residuals of the equations, divided by the same.
        total: ``slopes.T @ slopes`` plus the precision of the prior.
        states: Labels of groups of equations at the same state, one array for each way of grouping.
        blocks: Block of each equation.
    """
    root = _inverse_root(total)
    scaled = slopes @ root
    repeated, chance = np.zeros((slopes.shape[1],) * 2), np.zeros(slopes.shape[1])
    for state in states:
        within_blocks = state * (blocks.max(initial=0) + 1) + blocks
        across_blocks = scatter(scaled, residual, state) - scatter(scaled, residual, within_blocks)
        repeated += root @ across_blocks @ root.T
        # With white noise, the variance of a group's score is the group's information on the parameter.
        information = [((scaled[state == group] @ root.T) ** 2).sum(axis=0) for group in np.unique(state)]
        chance += 2.0 * np.square(information).sum(axis=0)
    certain = np.diag(repeated) > CHANCE_DEVIATIONS * np.sqrt(chance)
    return np.where(np.outer(certain, certain), repeated, 0.0)


def scatter(slopes: Float[Array, "m r"], residual: Float[Array, " m"], labels: Int[Array, " m"]) -> Float[Array, "r r"]:
    """Covariance of the parameters of a fit, from the scatter of its scores between clusters (CR2).

    Args:
        slopes: Derivatives of the equations by parameters that are scaled so that the fit's covariance is the identity.
        residual: Residuals of the equations.
        labels: Cluster of each equation; errors within a cluster may be correlated.
    """
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order])) + 1
    scores = np.array([_score(slopes[own], residual[own]) for own in np.split(order, starts)])
    return scores.T @ scores


def _score(slopes: Float[Array, "m r"], residual: Float[Array, " m"]) -> Float[Array, " r"]:
    """Score of one cluster, with its residual corrected for the part that the fit has explained (CR2)."""
    count, size = slopes.shape
    gram = slopes @ slopes.T if count < size else slopes.T @ slopes
    leverage, axes = np.linalg.eigh(gram)
    leverage = np.clip(leverage, 0.0, None)
    factor = np.where(leverage < _FULL_LEVERAGE, 1.0 / np.sqrt(1.0 - np.minimum(leverage, _FULL_LEVERAGE)), 0.0)
    if count < size:
        return slopes.T @ (axes @ (factor * (axes.T @ residual)))
    return axes @ (factor * (axes.T @ (slopes.T @ residual)))


def _inverse_root(total: Float[Array, "p p"]) -> Float[Array, "p r"]:
    """Matrix ``R`` such that ``R R^T`` is the inverse of ``total``, or its pseudo-inverse if it is singular."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    eigenvalues, axes = np.linalg.eigh(total * np.outer(scale, scale))
    regular = eigenvalues > _ROUNDING_SHARE * eigenvalues.max(initial=0.0)
    return scale[:, None] * axes[:, regular] / np.sqrt(eigenvalues[regular])


def state_groups(series: Float[Array, " m"]) -> Int[Array, " m"]:
    """Group of each sample by the value of a series; all `STATE_GROUPS` groups have the same number of samples."""
    if len(series) == 0:  # a joint that never moves
        return np.zeros(0, dtype=int)
    ends = np.quantile(series, np.linspace(0.0, 1.0, STATE_GROUPS + 1)[1:-1])
    return np.searchsorted(ends, series)
