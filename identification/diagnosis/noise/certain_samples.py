"""Estimates the variance of torque noise from samples in which friction is certain: those in which the joint moves.

A row is one joint's torque. The noise of a row is the part of its residual that no fit predicts. A joint at standstill
has any friction up to its breakaway torque, so its residual there may be many times its noise. In a recording that is
mostly standstill, this residual would count as noise, and would hide friction that the motion shows clearly. Errors at
reversals count as noise: they recur with the motion, so that they do not average out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.motion.standstill import noise_share
from identification.diagnosis.columns.residual_columns import Columns
from phantom_dyn.array_types import Array, Bool, Float

_ROUNDS = 30  # largest number of iterations between variance and weights
_CONVERGED = 0.99  # ratio of two successive variances above which the iteration has converged


def certain_variance(squares: Float[Array, " n"], friction: Float[Array, " n"]) -> float:
    """Variance of the noise, from samples that have a low weight where friction is uncertain.

    The weights depend on the variance (`noise_share`). Both are computed in turn, starting from the mean of all
    samples, until the variance converges or too few samples have a large weight.

    Args:
        squares: Squared noise of each usable sample.
        friction: Variance of the friction at standstill in each of these samples.
    """
    if not len(squares):
        return 0.0
    variance = float(np.mean(squares))
    for _ in range(_ROUNDS):
        weights = noise_share(variance, friction) ** 2
        # The effective number of samples is sum(w)^2 / sum(w^2).
        if weights.sum() ** 2 < rules.SURE_SHARE * len(squares) * (weights @ weights):
            break
        before, variance = variance, float(weights @ squares / max(weights.sum(), 1e-300))
        if variance > _CONVERGED * before:
            break
    return variance


def moving_variance(columns: Columns, noise: Sequence[Float[Array, " n"]], row: int) -> float:
    """Variance of the noise of a row while its joint moves; above zero.

    Args:
        columns: Usable samples, and the standard deviation of friction at standstill.
        noise: Noise of the row, for each log.
        row: Index of the row.
    """
    use = [part[:, row] for part in columns.usable]
    squares = np.concatenate([part[u] ** 2 for part, u in zip(noise, use, strict=True)])
    friction = np.concatenate([part[u, row] ** 2 for part, u in zip(columns.standstill_std, use, strict=True)])
    return max(certain_variance(squares, friction), 1e-300)


def root_weights(columns: Columns, noise: Sequence[Float[Array, " n"]], row: int) -> list[Float[Array, " n"]]:
    """Square root of the weight of each sample of a row, for each log; the weight is one where the joint moves.

    Args:
        columns: Usable samples, and the standard deviation of friction at standstill.
        noise: Noise of the row, for each log.
        row: Index of the row.
    """
    return roots_of_shares(columns, row, moving_variance(columns, noise, row))


def roots_of_shares(columns: Columns, row: int, variance: float) -> list[Float[Array, " n"]]:
    """Square root of the weight of each sample of a row, as in `root_weights`, for a given variance of the noise."""
    return [np.sqrt(noise_share(variance, part[:, row] ** 2)) for part in columns.standstill_std]


def certain_samples(columns: Columns, log: int, row: int, variance: float) -> Bool[Array, " n"]:
    """True for usable samples in which the variance of friction at standstill is less than that of the noise.

    Args:
        columns: Usable samples, and the standard deviation of friction at standstill.
        log: Index of the log.
        row: Index of the row.
        variance: Variance of the noise of the row.
    """
    return columns.usable[log][:, row] & (columns.standstill_std[log][:, row] ** 2 < variance)
