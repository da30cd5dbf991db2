"""Shapley value of each member of a set: what it adds to those before it, in the mean over all orders."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from itertools import combinations
from math import factorial
from typing import TypeVar

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.random_streams import random_stream

Player = TypeVar("Player", bound=Hashable)

_EXACT = 7  # players: beyond, orders and sets are sampled, as each more doubles the sets
_ORDERS = 4  # pairs of an order and its reverse
_KNOWN = 0.005  # of the worth of all: standard error of a value at which drawing sets ends
_KNOWN_BY_ORDERS = 0.5 * _KNOWN  # error of a mean over orders below which it is kept where others are not
_MOST = 100  # pairs of sets a player


def shapley_values(players: tuple[Player, ...], worth: Callable[[frozenset[Player]], float]) -> dict[Player, float]:
    """Mean over all orders of what each player adds to those before it; the values add up to the worth of all.

    Exact to seven players. Beyond, the mean over four random orders and their reverses, where that is known to half a
    percent: what acts on different joints hardly depends on the order. Elsewhere values that scatter over these orders
    come from a regression on random sets, as many as it takes to know them to half a percent, up to a hundred pairs of
    sets a player.

    Args:
        players: All of them.
        worth: Of any set of them; zero of none.
    """
    count = len(players)
    if count > _EXACT:
        return dict(zip(players, _sampled(players, worth).tolist(), strict=True))
    out = dict.fromkeys(players, 0.0)
    for player in players:
        others = [other for other in players if other is not player]
        for size in range(count):
            weight = factorial(size) * factorial(count - size - 1) / factorial(count)
            for before in (frozenset(some) for some in combinations(others, size)):
                out[player] += weight * (worth(before | {player}) - worth(before))
    return out


def _sampled(players: tuple[Player, ...], worth: Callable[[frozenset[Player]], float]) -> Float[Array, " k"]:
    rng = random_stream("orders of findings")
    orders = [rng.permutation(len(players)) for _ in range(_ORDERS)]
    there, back = ([_added(players, order[::way], worth) for order in orders] for way in (1, -1))
    pairs = 0.5 * np.add(there, back)
    values = pairs.mean(axis=0)
    if np.std(pairs, axis=0, ddof=1).max() > _KNOWN * np.sqrt(_ORDERS):
        every = np.concatenate([there, back])
        uncertain = np.std(every, axis=0, ddof=1) > _KNOWN_BY_ORDERS * np.sqrt(len(every))
        values[uncertain] = _regressed(players, worth, values, uncertain)
    return values


def _added(
    players: tuple[Player, ...], order: Int[Array, " k"], worth: Callable[[frozenset[Player]], float]
) -> Float[Array, " k"]:
    """What each player adds to those before it."""
    out, before = np.zeros(len(players)), frozenset[Player]()
    for k in order.tolist():
        out[k] = worth(before | {players[k]}) - worth(before)
        before |= {players[k]}
    return out


def _regressed(
    players: tuple[Player, ...],
    worth: Callable[[frozenset[Player]], float],
    values: Float[Array, " k"],
    unknown: Bool[Array, " k"],
) -> Float[Array, " u"]:
    """Some of the values, where the others are known, from pairs of sets.

    Shapley values are coefficients of a weighted regression over all sets of players: the worth of a set less that of
    its complement is fitted by the sum of its players' values less those of the others (Lundberg and Lee, "A Unified
    Approach to Interpreting Model Predictions", 2017, theorem 2; in pairs: Covert and Lee, "Improving KernelSHAP",
    2021). Sets of one player are all used, larger ones drawn by their weight.
    """
    count, everybody = len(players), frozenset(players)
    rng = random_stream("sets of findings")
    sizes = np.arange(1, count)
    weight = (count - 1) / (sizes * (count - sizes))
    of_larger = weight[1:-1] / weight[1:-1].sum()

    def beyond_complement(inside: Bool[Array, " k"]) -> float:
        some = frozenset(player for player, one in zip(players, inside.tolist(), strict=True) if one)
        known = np.where(inside, values, -values)[~unknown].sum()
        return worth(some) - worth(everybody - some) - known

    sets = [*np.eye(count, dtype=bool)]
    answers = [beyond_complement(inside) for inside in sets]
    total = worth(everybody) - values[~unknown].sum()
    while True:
        for size in rng.choice(sizes[1:-1], size=count, p=of_larger):
            inside = np.zeros(count, dtype=bool)
            inside[rng.permutation(count)[:size]] = True
            sets.append(inside)
            answers.append(beyond_complement(inside))
        drawn = len(sets) - count
        each = np.repeat([2 * weight[0] / count, weight[1:-1].sum() / drawn], [count, drawn])
        found, error = _weighted_fit(np.where(sets, 1.0, -1.0)[:, unknown], np.array(answers), each, total, drawn)
        if (drawn > count and error.max() <= _KNOWN) or drawn >= _MOST * count:
            return found


def _weighted_fit(
    signs: Float[Array, "s u"], answers: Float[Array, " s"], weight: Float[Array, " s"], total: float, drawn: int
) -> tuple[Float[Array, " u"], Float[Array, " u"]]:
    """Coefficients that add up to a total, and their standard errors, where the last ``drawn`` rows are random."""
    count = signs.shape[1]
    bordered = np.ones((count + 1, count + 1))
    bordered[count, count] = 0.0
    bordered[:count, :count] = (signs * weight[:, None]).T @ signs
    inverse = np.linalg.inv(bordered)
    found = (inverse @ np.append((signs * weight[:, None]).T @ answers, total))[:count]
    pull = ((weight * (answers - signs @ found))[:, None] * signs)[-drawn:]
    pull -= pull.mean(axis=0)
    # Residuals are smaller than errors by the degrees of freedom of the fit.
    spread = inverse[:count, :count] @ (pull.T @ pull) @ inverse[:count, :count] * len(signs) / (len(signs) - count)
    return found, np.sqrt(np.diag(spread))
