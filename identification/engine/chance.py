"""Thresholds for the gain that the best of many columns reaches by chance, and random residuals to estimate them.

The gain of a column is the decrease of the sum of squared residuals when the column is fitted to the residual.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phantom_dyn.array_types import Array, Float


def exceeded_by_chance(best: Float[Array, " R"], wrong: float) -> float:
    """Threshold that the largest gain exceeds with a given probability, from a fitted Gumbel distribution.

    Args:
        best: Largest gain in each of ``R`` recordings without a gap. The Gumbel distribution has the mean and standard
            deviation of these gains.
        wrong: Probability that the largest gain exceeds the threshold by chance.
    """
    spread = best.std() * np.sqrt(6) / np.pi
    return float(best.mean() - np.euler_gamma * spread - spread * np.log(-np.log1p(-wrong)))


def squares_by_chance(count: int, free: float, wrong: float) -> float:
    """Sum of squares, in units of the noise variance, that the best of several columns exceeds by chance.

    Args:
        count: Number of columns.
        free: Degrees of freedom of the estimate of the noise.
        wrong: Probability that the best column exceeds the sum.
    """
    from scipy.special import fdtri

    return 1.0 / float(fdtri(free, 1, wrong / max(count, 1)))


def shuffled_pieces(pieces: Sequence[Float[Array, " n"]], rng: np.random.Generator) -> Float[Array, " N"]:
    """Pieces of a series, joined in random order and with random signs.

    Each piece keeps its spectrum, so that the result resembles the series but has no relation to the columns.
    """
    order = rng.permutation(len(pieces))
    return np.concatenate([pieces[k] * rng.choice([-1.0, 1.0]) for k in order])
