"""How much of the gap the findings close, together and one by one (Shapley value)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from itertools import combinations
from math import factorial

import numpy as np

from identification.diagnosis.fit.gap import Sums, held_out_torque, residual_after, sums
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.model.terms import Term, ordered
from identification.diagnosis.result import Gap
from identification.diagnosis.search.bootstrap_wins import block_counts
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.squares_left import squares_left
from phantom_dyn.array_types import Float
from phantom_dyn.random_streams import random_stream

Array = np.ndarray

_EXACT = 12  # findings: beyond, their orders are sampled
_FEWEST, _MOST = 4, 100  # pairs of an order and its reverse
_KNOWN = 0.005  # of the gap: standard error of a share at which no more orders are drawn
_LEAST_GAP = 1e-3  # of the loss, in every bootstrap replicate


def left_by(judge: Judge, plain: Search, chosen: frozenset[Term]) -> Sums:
    """Squared residuals in the judged band after moves and effects, on blocks held out of their fit."""
    torque = held_out_torque(plain.problem, chosen, plain.evaluate(chosen))
    return sums(plain.problem, judge.narrow(residual_after(plain.problem, torque)))


def beyond_the_floor(judge: Judge, within: Sums) -> bool:
    """True if the loss within the tolerances is more than the noise floor's interval allows."""
    once = np.ones((1, len(within.counts)))
    return float(within.loss(judge.floor, once)[0]) > float(np.mean((judge.highest / judge.floor) ** 2))


def gap_of(judge: Judge, within: Sums, after: Sums, weights: Float[Array, "R B"]) -> Float[Array, " R"]:
    """What shares are shares of: the loss within the tolerances beyond one, when each block counts ``weights`` times.

    The mean over joints may be within the floor while a joint is not: then it is what the findings take off.
    """
    base = within.loss(judge.floor, weights)
    beyond = base - 1.0 if beyond_the_floor(judge, within) else base - after.loss(judge.floor, weights)
    # In a replicate that happens to have next to no gap, a share is as good as no number.
    return np.maximum(beyond, _LEAST_GAP * base)


def closed_together(judge: Judge, within: Sums, after: Sums) -> Gap:
    """Share of the gap within tolerance that the findings close, with its interval from a block bootstrap.

    Args:
        judge: Gives the noise floor.
        within: What the best moves within the tolerances leave.
        after: What moves and findings leave.
    """
    once = np.ones((1, len(within.counts)))
    if not beyond_the_floor(judge, within):
        return Gap()

    def closed(weights: Float[Array, "R B"]) -> Float[Array, " R"]:
        base = within.loss(judge.floor, weights)
        return (base - after.loss(judge.floor, weights)) / gap_of(judge, within, after, weights)

    drawn = block_counts(len(within.counts), random_stream("bootstrap of the gap closed"))
    low, high = np.percentile(closed(drawn), [2.5, 97.5])
    return Gap(float(closed(once)[0]), (float(low), float(high)))


def shares_of(judge: Judge, plain: Search, named: frozenset[Term]) -> dict[Term, float]:
    """Shapley value of each finding in the share of the gap that all close; the moves are refitted in every coalition.

    Args:
        judge: Gives the noise floor.
        plain: Fits in the judged band.
        named: The findings.
    """
    left = squares_left(plain, named)
    within, after = left(frozenset()), left(named)
    once = np.ones((1, len(within.counts)))
    base, gap = within.loss(judge.floor, once)[0], gap_of(judge, within, after, once)[0]

    @cache
    def closed(chosen: frozenset[Term]) -> float:
        return float((base - left(chosen).loss(judge.floor, once)[0]) / gap)

    return shapley_values(ordered(named), closed)


def shapley_values(players: tuple[Term, ...], worth: Callable[[frozenset[Term]], float]) -> dict[Term, float]:
    """Mean over all orders of what each player adds to those before it; the values add up to the worth of all.

    Exact to twelve players. Beyond, the mean over random orders and their reverses, as many as it takes to know each
    value to half a percent: what acts on different joints hardly depends on the order.
    """
    count = len(players)
    if count > _EXACT:
        return _sampled(players, worth)
    out = dict.fromkeys(players, 0.0)
    for player in players:
        others = [other for other in players if other is not player]
        for size in range(count):
            weight = factorial(size) * factorial(count - size - 1) / factorial(count)
            for before in _sets(others, size):
                out[player] += weight * (worth(before | {player}) - worth(before))
    return out


def _sets(players: Iterable[Term], size: int) -> Iterable[frozenset[Term]]:
    return (frozenset(some) for some in combinations(players, size))


def _sampled(players: tuple[Term, ...], worth: Callable[[frozenset[Term]], float]) -> dict[Term, float]:
    rng = random_stream("orders of findings")
    added: list[Float[Array, " k"]] = []
    for pairs in range(1, _MOST + 1):
        order = rng.permutation(len(players)).tolist()
        added.append(0.5 * (_added(players, order, worth) + _added(players, order[::-1], worth)))
        if pairs >= _FEWEST and np.std(added, axis=0, ddof=1).max() <= _KNOWN * np.sqrt(pairs):
            break
    return dict(zip(players, np.mean(added, axis=0).tolist(), strict=True))


def _added(
    players: tuple[Term, ...], order: list[int], worth: Callable[[frozenset[Term]], float]
) -> Float[Array, " k"]:
    """What each player adds to those before it."""
    out, before = np.zeros(len(players)), frozenset[Term]()
    for k in order:
        out[k] = worth(before | {players[k]}) - worth(before)
        before |= {players[k]}
    return out
