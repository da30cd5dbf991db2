"""Gain of the best of many columns by chance: thresholds for it, and residuals in random order to estimate it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phantom_dyn.array_types import Array, Float


def exceeded_by_chance(best: Float[Array, " R"], wrong: float) -> float:
    """Threshold that the largest gain exceeds with a given probability, from a Gumbel distribution fitted to samples.

    Args:
        best: Largest gain in each recording without a gap; the distribution has their mean and standard deviation.
        wrong: Probability of a larger gain.
    """
    spread = best.std() * np.sqrt(6) / np.pi
    return float(best.mean() - np.euler_gamma * spread - spread * np.log(-np.log1p(-wrong)))


def squares_by_chance(count: int, free: float, wrong: float) -> float:
    """Sum of squares, in units of the noise, that the best of several columns exceeds by chance with a probability.

    Args:
        count: Number of columns.
        free: Degrees of freedom of the estimate of the noise.
        wrong: Probability of a larger sum.
    """
    from scipy.special import fdtri

    return 1.0 / float(fdtri(free, 1, wrong / max(count, 1)))


def shuffled_pieces(pieces: Sequence[Float[Array, " n"]], rng: np.random.Generator) -> Float[Array, " N"]:
    """Pieces of a series in random order with random signs, which keep their spectra and sizes."""
    order = rng.permutation(len(pieces))
    return np.concatenate([pieces[k] * rng.choice([-1.0, 1.0]) for k in order])
