"""Bootstrap over blocks of the held-out data: in which share of replicates each set of effects costs least."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.model.terms import Term
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.search import Search
from phantom_dyn.array_types import Float, Int
from phantom_dyn.random_streams import random_stream

Array = np.ndarray

REPLICATES = 1000


def block_counts(blocks: int, rng: np.random.Generator) -> Float[Array, "R B"]:
    """How often each block is drawn in each of a thousand bootstrap replicates."""
    draws = rng.integers(0, blocks, size=(REPLICATES, blocks))
    # One count over all replicates: those of each begin where those of the one before end.
    draws += blocks * np.arange(REPLICATES)[:, None]
    return np.bincount(draws.ravel(), minlength=draws.size).reshape(draws.shape).astype(float)


def share_of_wins(scores: Float[Array, "R m"]) -> Float[Array, " m"]:
    """How often each set has the lowest score of a replicate; equal ones share it."""
    tied = scores <= scores.min(axis=1, keepdims=True) + rules.SAME_PREDICTIONS
    return (tied / tied.sum(axis=1, keepdims=True)).mean(axis=0)


def costs_of(
    search: Search, sets: list[frozenset[Term]], twins: list[bool], free: Sequence[bool] = ()
) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Cost of each set in every bootstrap replicate: price plus moves of the model, counted in two fair ways.

    Either all moves count, or those only that cost four more than the first set's (two tolerances of one quantity), or
    four less: how wrong a model is within its tolerance is not known that well.

    Args:
        search: Rivals.
        sets: What is compared, the finding's set first.
        twins: Those that cost what the first set costs.
        free: Those whose price does not count either, nor what more numbers save in moves: inertias that are free take
            over what the model is wrong by within its tolerances. Empty: none.
    """
    prices = np.array([search.price_of(chosen) for chosen in sets])
    dearer = prices - prices[0]
    prices[twins] = prices[0]
    moves = np.array([search.evaluate(chosen).penalty for chosen in sets])
    more = moves - moves[0]
    if free:
        prices[list(free)] = prices[0]
        more = np.where(np.array(free) & (more * dearer < 0.0), 0.0, more)
    return prices + more, prices + np.sign(more) * np.maximum(np.abs(more) - 4.0, 0.0)


def halves(blocks: int) -> tuple[Int[Array, " h"], ...]:
    """Blocks of each half of the recordings; none where a half is too short to be judged on its own."""
    if blocks < 2 * rules.LEAST_BLOCKS:
        return ()
    return tuple(np.array_split(np.arange(blocks), 2))


def half_wins(
    options: dict[Chosen, Array], keys: list[Chosen], half: Int[Array, " h"], costs: Sequence[Array]
) -> Float[Array, " m"]:
    """How often each set wins if all of the recordings were like one half of them."""
    losses = np.array([options[key] for key in keys]).T
    drawn = block_counts(len(half), random_stream("bootstrap of halves")) * (len(losses) / len(half))
    return np.mean([share_of_wins(drawn @ losses[half] + cost) for cost in costs], axis=0)


def wins_in(
    other: Search,
    search: Search,
    options: dict[Chosen, Array],
    keys: list[Chosen],
    same: dict[Chosen, Chosen],
    free: tuple[set[Chosen], set[Chosen]],
    counts: Float[Array, "R B"],
) -> Float[Array, " m"]:
    """How often each set wins in another search over the same rivals, with the same allowance for richer laws.

    ``free`` are twins of the finding and laws that neither contain it nor are contained in it.
    """
    sets = [same.get(key, key) for key in keys]
    allowance = [options[key] - search.evaluate(one).loss for key, one in zip(keys, sets, strict=True)]
    losses = np.array([other.evaluate(one).loss + more for one, more in zip(sets, allowance, strict=True)]).T
    twins, apart = ([key in some for key in keys] for some in free)
    costs = (*costs_of(other, sets, twins), *costs_of(other, sets, twins, apart))
    return np.mean([share_of_wins(counts @ losses + cost) for cost in costs], axis=0)
