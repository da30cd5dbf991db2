"""Block bootstrap, and what a probability is: the share of what is known under which an answer leads.

What is known are the blocks that were recorded and the choices that should not matter. Blocks are drawn again with
replacement (a sample's neighbours say the same as it does, a block's hardly do). In each replicate the answer leads
that costs least. The same is asked of each half of the blocks and under every other choice; the probability is the
mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.random_streams import random_stream

REPLICATES = 1000
"""Replicates of every bootstrap: either end of a 95 % interval then rests on 25 of them, and a probability of 0.05,
from which on a rival is listed, is known to 0.007."""

CHOSEN_AGAIN = 40
"""Of them, those in which a choice among hundreds of terms is made again: each costs as much as the choice itself, and
whether six in ten choose the same is known to 0.08 then."""

SAME_PREDICTIONS = 0.05
"""Held-out squares in units of noise below which two answers are the same predictions."""

LEAST_IN_HALF = 4
"""Blocks that a half needs to be judged on its own."""

Costs = Sequence[Float[Array, " m"]]
Lead = Callable[[Float[Array, "R m"]], Float[Array, " m"]]


def block_counts(blocks: int, rng: np.random.Generator, replicates: int = REPLICATES) -> Float[Array, "R B"]:
    """How often each block is drawn in each bootstrap replicate.

    Args:
        blocks: How many there are, of which as many are drawn.
        rng: Of this use.
        replicates: How many; fewer are the first of all.
    """
    draws = rng.integers(0, blocks, size=(replicates, blocks))
    # One count over all replicates: those of each begin where those of the one before end.
    draws += blocks * np.arange(replicates)[:, None]
    return np.bincount(draws.ravel(), minlength=draws.size).reshape(draws.shape).astype(float)


def interval(values: Float[Array, "R ..."], level: float = 0.95) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Both ends of the interval that holds a share of the replicates, as many outside on either side."""
    low, high = np.quantile(values, [0.5 - level / 2, 0.5 + level / 2], axis=0)
    return low, high


def share_of_wins(scores: Float[Array, "R m"]) -> Float[Array, " m"]:
    """How often each answer has the lowest score of a replicate; equal ones share it."""
    tied = scores <= scores.min(axis=1, keepdims=True) + SAME_PREDICTIONS
    return (tied / tied.sum(axis=1, keepdims=True)).mean(axis=0)


def share_by_likelihood(scores: Float[Array, "R m"]) -> Float[Array, " m"]:
    """Mean over replicates of the likelihood of each answer, for scores that are squares in units of a known noise.

    The lowest alone would be certain of a difference that lasts over the blocks, though chance makes larger ones.
    """
    from scipy.special import softmax

    return softmax(-0.5 * scores, axis=1).mean(axis=0)


def halves(blocks: int) -> tuple[Int[Array, " h"], ...]:
    """Blocks of each half of the recordings; none where a half is too short to be judged on its own."""
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
    """Share of what is known under which each answer leads.

    Args:
        losses: Held-out squares of each block in units of noise, by answer.
        costs: What each answer costs beside; where several ways to count are fair, each has the same weight.
        others: The same under each other choice that should not matter, such as another band.
        by_halves: Also as if all blocks were like those of one half.
        lead: How far each answer leads in the replicates: where other choices show how far scores can be trusted
            `share_of_wins`, where the noise alone says it `share_by_likelihood`.
    """
    shares = [_shares(losses, costs, lead, random_stream("bootstrap of rivals"))]
    if by_halves:
        for half in halves(len(losses)):
            grown = losses[half] * (len(losses) / len(half))
            shares.append(_shares(grown, costs, lead, random_stream("bootstrap of halves")))
    shares += [_shares(*other, lead, random_stream("bootstrap of rivals")) for other in others]
    return np.mean(shares, axis=0)


def _shares(losses: Float[Array, "B m"], costs: Costs, lead: Lead, rng: np.random.Generator) -> Float[Array, " m"]:
    """Mean over fair ways to count costs of how far each answer leads in the replicates."""
    drawn = block_counts(len(losses), rng) @ losses
    return np.mean([lead(drawn + cost) for cost in costs], axis=0)
