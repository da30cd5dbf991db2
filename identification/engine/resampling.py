"""Computes probabilities of rival answers by a block bootstrap: how often each answer has the lowest cost.

Blocks of samples are drawn with replacement, because neighbouring blocks are nearly independent and neighbouring
samples are not. In each replicate the answer with the lowest cost wins. The same is done for each half of the blocks,
and for other choices that should not matter, such as another band. The probability of an answer is the mean share of
the replicates that it wins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.random_streams import random_stream

REPLICATES = 1000
"""Replicates of every bootstrap. Each end of a 95 % interval is then determined by 25 of them. A probability of 0.05,
from which a rival is listed, has a standard error of 0.007."""

REPEATED_CHOICES = 40
"""Replicates in which a choice among hundreds of terms is repeated, because each costs as much as the first choice. A
share of 0.6 of them has a standard error of 0.08."""

SAME_PREDICTIONS = 0.05
"""Difference of predictions, as held-out squares in units of noise, below which two answers count as the same."""

LEAST_IN_HALF = 4
"""Blocks that a half needs to be judged on its own."""

Costs = Sequence[Float[Array, " m"]]
Lead = Callable[[Float[Array, "R m"]], Float[Array, " m"]]


def block_counts(blocks: int, rng: np.random.Generator, replicates: int = REPLICATES) -> Float[Array, "R B"]:
    """How often each block is drawn in each bootstrap replicate.

    Args:
        blocks: Number of blocks, and of draws in a replicate.
        rng: Random stream of this use.
        replicates: Number of replicates; a smaller number gives the first ones of a larger number.
    """
    draws = rng.integers(0, blocks, size=(replicates, blocks))
    # One count over all replicates, whose blocks are numbered consecutively.
    draws += blocks * np.arange(replicates)[:, None]
    return np.bincount(draws.ravel(), minlength=draws.size).reshape(draws.shape).astype(float)


def interval(values: Float[Array, "R ..."], level: float = 0.95) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Both ends of the central interval that holds a share of the replicates."""
    low, high = np.quantile(values, [0.5 - level / 2, 0.5 + level / 2], axis=0)
    return low, high


def share_of_wins(scores: Float[Array, "R m"]) -> Float[Array, " m"]:
    """Share of the replicates in which each answer has the lowest score; equal ones share a replicate."""
    tied = scores <= scores.min(axis=1, keepdims=True) + SAME_PREDICTIONS
    return (tied / tied.sum(axis=1, keepdims=True)).mean(axis=0)


def share_by_likelihood(scores: Float[Array, "R m"]) -> Float[Array, " m"]:
    """Mean over replicates of the likelihood of each answer, for scores that are squares in units of a known noise.

    With `share_of_wins`, a small difference that is equal in all blocks would be certain, although it may be chance.
    """
    from scipy.special import softmax

    return softmax(-0.5 * scores, axis=1).mean(axis=0)


def halves(blocks: int) -> tuple[Int[Array, " h"], ...]:
    """Blocks of each half of the recordings; empty if a half is too short to be judged alone."""
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
        losses: Held-out squares of each block in units of noise, by answer.
        costs: Price of each answer, which is added to the losses; the mean over several arrays of prices is taken.
        others: Losses and costs with each other choice that should not matter, such as another band.
        by_halves: True to use each half of the blocks alone as well.
        lead: `share_of_wins` if other choices show how accurate the scores are, `share_by_likelihood` if only noise
            limits them.
    """
    shares = [_shares(losses, costs, lead, random_stream("bootstrap of rivals"))]
    if by_halves:
        for half in halves(len(losses)):
            grown = losses[half] * (len(losses) / len(half))
            shares.append(_shares(grown, costs, lead, random_stream("bootstrap of halves")))
    shares += [_shares(*other, lead, random_stream("bootstrap of rivals")) for other in others]
    return np.mean(shares, axis=0)


def _shares(losses: Float[Array, "B m"], costs: Costs, lead: Lead, rng: np.random.Generator) -> Float[Array, " m"]:
    """Share of each answer in the replicates, averaged over the prices."""
    drawn = block_counts(len(losses), rng) @ losses
    return np.mean([lead(drawn + cost) for cost in costs], axis=0)
