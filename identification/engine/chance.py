"""What the best of many columns gains by chance: recordings without a gap, noise, blocks in another order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phantom_dyn.array_types import Array, Float

_EULER = 0.5772156649


def exceeded_by_chance(best: Float[Array, " R"], wrong: float) -> float:
    """What the largest gain exceeds with a probability, by a Gumbel law with the mean and deviation of some of them.

    Args:
        best: Largest gain of each recording without a gap.
        wrong: Probability.
    """
    spread = best.std() * np.sqrt(6) / np.pi
    return float(best.mean() - _EULER * spread - spread * np.log(-np.log1p(-wrong)))


def squares_by_chance(count: int, free: float, wrong: float) -> float:
    """Squares in units of noise that the best of some independent columns explains with a probability.

    Args:
        count: Of the columns.
        free: Degrees of freedom that the noise is known by.
        wrong: Probability.
    """
    from scipy.special import fdtri

    return 1.0 / float(fdtri(free, 1, wrong / max(count, 1)))


def in_another_order(pieces: Sequence[Float[Array, " n"]], rng: np.random.Generator) -> Float[Array, " N"]:
    """Pieces of a series in another order with other signs: each keeps its colour and size, and loses its place."""
    order = rng.permutation(len(pieces))
    return np.concatenate([pieces[k] * rng.choice([-1.0, 1.0]) for k in order])
