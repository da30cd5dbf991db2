"""Computes probabilities of rival answers by a block bootstrap: how often each answer has the lowest cost.

An answer is a set of effects that may explain the recordings. Its cost in a replicate is its held-out loss plus its
price. Blocks of samples are drawn with replacement, because neighbouring blocks are nearly independent and neighbouring
samples are not. In each replicate the answer with the lowest cost wins. The bootstrap is repeated with each half of the
blocks, and with other settings that should not matter, such as another frequency band. The probability of an answer is
the share of the replicates that it wins, averaged over these repetitions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.random_streams import random_stream

REPLICATES = 1000
"""Number of replicates of every bootstrap. 25 of them are then beyond each end of a 95 % interval. A probability of
0.05, from which a rival is listed, has a standard error of 0.007."""

REPEATED_CHOICES = 40
"""Number of replicates in which a choice among hundreds of terms is repeated. It is small because each repetition costs
as much as the first choice. A share of 0.6 of them has a standard error of 0.08."""

SAME_PREDICTIONS = 0.05
"""Difference of scores (held-out squares in units of the noise variance) up to which two answers count as equal."""

LEAST_IN_HALF = 4
"""The bootstrap is repeated with each half of the blocks only if a half has at least this many blocks."""

Costs = Sequence[Float[Array, " m"]]
Lead = Callable[[Float[Array, "R m"]], Float[Array, " m"]]


def block_counts(blocks: int, rng: np.random.Generator, replicates: int = REPLICATES) -> Float[Array, "R B"]:
    """How often each block is drawn in each bootstrap replicate.

    Args:
        blocks: Number of blocks, and of draws in a replicate.
        rng: Random stream.
        replicates: Number of replicates. The first replicates do not depend on this number.
    """
    draws = rng.integers(0, blocks, size=(replicates, blocks))
    # Each replicate has its own range of block numbers, so that one call counts the draws of all replicates.
    draws += blocks * np.arange(replicates)[:, None]
    return np.bincount(draws.ravel(), minlength=draws.size).reshape(draws.shape).astype(float)


def interval(values: Float[Array, "R ..."], level: float = 0.95) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Lower and upper end of the central interval that holds the share ``level`` of the replicates."""
    low, high = np.quantile(values, [0.5 - level / 2, 0.5 + level / 2], axis=0)
    return low, high


def share_of_wins(scores: Float[Array, "R m"]) -> Float[Array, " m"]:
    """Share of the replicates in which each answer has the lowest score; equal answers share a replicate."""
    tied = scores <= scores.min(axis=1, keepdims=True) + SAME_PREDICTIONS
    return (tied / tied.sum(axis=1, keepdims=True)).mean(axis=0)


def share_by_likelihood(scores: Float[Array, "R m"]) -> Float[Array, " m"]:
    """Normalised likelihood of each answer, averaged over replicates, for scores that are squares of known noise.

    `share_of_wins` would call an answer certain if it is better by a small constant in all blocks. Such a difference
    may be chance; the likelihood accounts for this.
    """
    from scipy.special import softmax

    return softmax(-0.5 * scores, axis=1).mean(axis=0)


def halves(blocks: int) -> tuple[Int[Array, " h"], ...]:
    """Indices of the blocks of each half of the recordings; empty if a half has less than `LEAST_IN_HALF` blocks."""
    if blocks < 2 * LEAST_IN_HALF:
        return ()
    return tuple(np.array_split(np.arange(blocks), 2))


def probabilities(
    losses: Float[Array, "B m"],
    costs: Costs,
    others: Sequence[tuple[Float[Array, "B m"], Costs]] = (),
    *,
    by_halves: bool = True,
    lead: Lead = share_of_wins,
) -> Float[Array, " m"]:
    """Probability of each answer.

    Args:
        losses: Held-out squares of each block in units of the noise variance, for each answer.
        costs: Price of each answer, which is added to its loss. The result is the mean over the given arrays of prices.
        others: Losses and costs for each other setting that should not matter, such as another frequency band.
        by_halves: True to repeat the bootstrap with each half of the blocks.
        lead: Function from the scores of all replicates to the share of each answer: `share_of_wins` if the repetitions
            show how accurate the scores are, `share_by_likelihood` if only noise limits their accuracy.
    """
    shares = [_shares(losses, costs, lead, random_stream("bootstrap of rivals"))]
    if by_halves:
        for half in halves(len(losses)):
            scaled = losses[half] * (len(losses) / len(half))
            shares.append(_shares(scaled, costs, lead, random_stream("bootstrap of halves")))
    shares += [_shares(*other, lead, random_stream("bootstrap of rivals")) for other in others]
    return np.mean(shares, axis=0)


def _shares(losses: Float[Array, "B m"], costs: Costs, lead: Lead, rng: np.random.Generator) -> Float[Array, " m"]:
    """Share of each answer in the replicates of one bootstrap, averaged over the arrays of prices."""
    drawn = block_counts(len(losses), rng) @ losses
    return np.mean([lead(drawn + cost) for cost in costs], axis=0)
