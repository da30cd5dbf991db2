"""Computes Shapley values: the worth that each player adds to the players before it, averaged over all orders.

In a diagnosis the players are the findings, and the worth of a set is the share of the gap that it closes.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from itertools import combinations
from math import factorial
from typing import TypeVar

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.random_streams import random_stream

Player = TypeVar("Player", bound=Hashable)

_EXACT = 7  # largest number of players for exact values: each further player doubles the number of sets
_ORDERS = 4  # number of random orders; the reverse of each is used, too
_ENOUGH = 0.005  # largest standard error of a value that is accurate enough; the worth of all players is about one
_ENOUGH_BY_ORDERS = 0.5 * _ENOUGH  # largest standard error of a mean over orders that is not replaced by a regression
_MOST = 100  # largest number of random sets per player; the complement of each is used, too


def shapley_values(players: tuple[Player, ...], worth: Callable[[frozenset[Player]], float]) -> dict[Player, float]:
    """Shapley value of each player; the sum of all values is the worth of all players.

    The values of up to seven players are exact. For more players they are means over four random orders and their
    reverses, if these have standard errors of at most 0.005. Otherwise those values that differ between the orders come
    from a regression on random sets of players. Sets are drawn until the standard errors are at most 0.005, up to a
    hundred sets per player.

    Args:
        players: Players, in any order.
        worth: Worth of any set of players: zero for the empty set, about one for all players.
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
    """Estimates of the values from random orders; those that differ between the orders come from a regression."""
    rng = random_stream("orders of findings")
    orders = [rng.permutation(len(players)) for _ in range(_ORDERS)]
    forward, backward = ([_added(players, order[::step], worth) for order in orders] for step in (1, -1))
    pairs = 0.5 * np.add(forward, backward)
    values = pairs.mean(axis=0)
    if np.std(pairs, axis=0, ddof=1).max() > _ENOUGH * np.sqrt(_ORDERS):
        every = np.concatenate([forward, backward])
        uncertain = np.std(every, axis=0, ddof=1) > _ENOUGH_BY_ORDERS * np.sqrt(len(every))
        values[uncertain] = _regressed(players, worth, values, uncertain)
    return values


def _added(
    players: tuple[Player, ...], order: Int[Array, " k"], worth: Callable[[frozenset[Player]], float]
) -> Float[Array, " k"]:
    """Worth that each player adds to those before it in one order."""
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
    """The ``unknown`` values from a regression on random sets and their complements; the other values are given.

    Shapley values are coefficients of a weighted regression over all sets of players. The regression fits the worth of
    a set minus the worth of its complement by the values of the players in the set minus the values of the others
    (Lundberg and Lee, "A Unified Approach to Interpreting Model Predictions", 2017, theorem 2; in pairs: Covert and
    Lee, "Improving KernelSHAP", 2021). All sets of one player are used. Larger sets are drawn with probabilities
    proportional to their weights.
    """
    count, everybody = len(players), frozenset(players)
    rng = random_stream("sets of findings")
    sizes = np.arange(1, count)
    weight = (count - 1) / (sizes * (count - sizes))
    of_larger = weight[1:-1] / weight[1:-1].sum()

    def worth_minus_complement(inside: Bool[Array, " k"]) -> float:
        chosen = frozenset(player for player, is_in in zip(players, inside.tolist(), strict=True) if is_in)
        known = np.where(inside, values, -values)[~unknown].sum()
        return worth(chosen) - worth(everybody - chosen) - known

    sets = [*np.eye(count, dtype=bool)]
    differences = [worth_minus_complement(inside) for inside in sets]
    total = worth(everybody) - values[~unknown].sum()
    while True:
        for size in rng.choice(sizes[1:-1], size=count, p=of_larger):
            inside = np.zeros(count, dtype=bool)
            inside[rng.permutation(count)[:size]] = True
            sets.append(inside)
            differences.append(worth_minus_complement(inside))
        drawn = len(sets) - count
        each = np.repeat([2 * weight[0] / count, weight[1:-1].sum() / drawn], [count, drawn])
        found, error = _weighted_fit(np.where(sets, 1.0, -1.0)[:, unknown], np.array(differences), each, total, drawn)
        if (drawn > count and error.max() <= _ENOUGH) or drawn >= _MOST * count:
            return found


def _weighted_fit(
    signs: Float[Array, "s u"], right: Float[Array, " s"], weight: Float[Array, " s"], total: float, drawn: int
) -> tuple[Float[Array, " u"], Float[Array, " u"]]:
    """Weighted least squares under the constraint that the coefficients have the sum ``total``.

    Args:
        signs: Regressors: one for a player in the set of a row, else minus one.
        right: Right side of each row: worth of the set minus worth of its complement.
        weight: Weight of each row.
        total: Sum of the coefficients.
        drawn: Number of rows, counted from the last one, that were drawn at random.

    Returns:
        Coefficients, and their standard errors from the scatter of the drawn rows.
    """
    count = signs.shape[1]
    bordered = np.ones((count + 1, count + 1))
    bordered[count, count] = 0.0
    bordered[:count, :count] = (signs * weight[:, None]).T @ signs
    inverse = np.linalg.inv(bordered)
    found = (inverse @ np.append((signs * weight[:, None]).T @ right, total))[:count]
    slopes = ((weight * (right - signs @ found))[:, None] * signs)[-drawn:]
    slopes -= slopes.mean(axis=0)
    # The last factor accounts for the degrees of freedom of the fit: residuals are smaller than errors.
    cov = inverse[:count, :count] @ (slopes.T @ slopes) @ inverse[:count, :count] * len(signs) / (len(signs) - count)
    return found, np.sqrt(np.diag(cov))
