"""Variance of the noise from samples in which a joint moves: a standstill shows little of the noise of a torque.

A joint at standstill has any friction up to its breakaway torque, so its residual there may be many times its noise. In
a recording that is mostly standstill, that residual would count as the noise, and friction that shows plainly in motion
would be below it. Errors at reversals do count: they recur with the motion, and more of them do not average out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.motion.standstill import noise_share
from identification.diagnosis.columns.residual_columns import Columns
from phantom_dyn.array_types import Array, Bool, Float

_ROUNDS = 30  # most iterations between variance and weights
_CONVERGED = 0.99  # ratio of two successive variances above which the iteration has converged


def certain_variance(squares: Float[Array, " n"], doubt: Float[Array, " n"]) -> float:
    """Variance of the noise, in which samples with uncertain friction have a low weight.

    The weights depend on the variance (`noise_share`). Both are computed in turn, starting from the mean of all
    samples, as long as enough samples have a fair weight.

    Args:
        squares: Squared noise of each usable sample.
        doubt: Variance of its friction at standstill.
    """
    if not len(squares):
        return 0.0
    variance = float(np.mean(squares))
    for _ in range(_ROUNDS):
        weights = noise_share(variance, doubt) ** 2
        if weights.sum() ** 2 < rules.SURE_SHARE * len(squares) * (weights @ weights):
            break
        before, variance = variance, float(weights @ squares / max(weights.sum(), 1e-300))
        if variance > _CONVERGED * before:
            break
    return variance


def moving_variance(columns: Columns, noise: Sequence[Float[Array, " n"]], row: int) -> float:
    """Variance of the noise of a row while its joint moves; above zero.

    Args:
        columns: Which samples are usable, and the friction of standing joints.
        noise: Noise of the row, for each log.
        row: Index of the row.
    """
    use = [part[:, row] for part in columns.usable]
    doubt = [part[:, row] ** 2 for part in columns.standstill_std]
    squares, beside = (
        np.concatenate([part[u] for part, u in zip(parts, use, strict=True)]) for parts in (noise, doubt)
    )
    return max(certain_variance(squares**2, beside), 1e-300)


def root_weights(columns: Columns, noise: Sequence[Float[Array, " n"]], row: int) -> list[Float[Array, " n"]]:
    """Square root of the weight of each sample of a row, for each log: one where the joint moves.

    Args:
        columns: Which samples are usable, and the friction of standing joints.
        noise: Noise of the row, for each log.
        row: Index of the row.
    """
    return roots_of_shares(columns, row, moving_variance(columns, noise, row))


def roots_of_shares(columns: Columns, row: int, variance: float) -> list[Float[Array, " n"]]:
    """`root_weights` at a given variance of the noise."""
    return [np.sqrt(noise_share(variance, part[:, row] ** 2)) for part in columns.standstill_std]


def certain_samples(columns: Columns, log: int, row: int, variance: float) -> Bool[Array, " n"]:
    """Usable samples at which friction at standstill is less uncertain than the torque is noisy.

    Args:
        columns: Usable samples, and the static friction at standstill.
        log: Index of the log.
        row: Index of the row.
        variance: Variance of the noise of the row.
    """
    return columns.usable[log][:, row] & (columns.standstill_std[log][:, row] ** 2 < variance)
