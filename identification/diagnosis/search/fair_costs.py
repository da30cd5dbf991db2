"""Costs of rival sets of effects, counted in the ways that are fair, and odds of richer laws against simpler ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.search import Search
from identification.engine.fits.projection import taken_out
from identification.gates import rivalry
from phantom_dyn.array_types import Array, Float


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


def losses_in(
    other: Search,
    search: Search,
    options: dict[Chosen, Array],
    keys: list[Chosen],
    same: dict[Chosen, Chosen],
    free: tuple[set[Chosen], set[Chosen]],
) -> tuple[Float[Array, "B m"], tuple[Float[Array, " m"], ...]]:
    """Held-out losses and costs in another search over the same rivals, with the same allowance for richer laws.

    ``free`` are twins of the finding and laws that neither contain it nor are contained in it.
    """
    sets = [same.get(key, key) for key in keys]
    allowance = [options[key] - search.evaluate(one).loss for key, one in zip(keys, sets, strict=True)]
    losses = np.array([other.evaluate(one).loss + more for one, more in zip(sets, allowance, strict=True)]).T
    twins, apart = ([key in some for key in keys] for some in free)
    return losses, (*costs_of(other, sets, twins), *costs_of(other, sets, twins, apart))


def adds_up(search: Search, chosen: Chosen) -> bool:
    """False for effects that hardly show but for what they take off each other.

    On one sine a large lag and much friction make what little friction makes alone: of causes that the data cannot
    separate, those are less likely that have to cancel.
    """
    a, theta = search.problem.total_a, search.evaluate(chosen).theta
    each = [np.array(one.columns) for one in ordered(chosen)]
    every = np.concatenate(each)
    whole = float(theta[every] @ a[np.ix_(every, every)] @ theta[every])
    apart = sum(float(theta[own] @ a[np.ix_(own, own)] @ theta[own]) for own in each)
    return apart <= rivalry.MOST_CANCELLED * whole


def odds_of_richer(search: Search, chosen: frozenset[Term], rich: frozenset[Term]) -> float:
    """Odds of a richer law of the same kind against what it contains, its further parameters not known beforehand.

    By Laplace's approximation: each further direction is expected to carry some half of the torque that was found. If
    the data hardly show such a direction beside the tolerances, they cannot say that it is not there.
    """
    problem, found = search.problem.of(chosen), search.evaluate(chosen)
    more = np.array(sorted({k for term in rich - chosen for k in term.columns} - set(found.active.tolist())), dtype=int)
    old = np.array(sorted({k for term in chosen - rich for k in term.columns}), dtype=int)
    a = problem.total_a
    energy = float(found.theta[old] @ a[np.ix_(old, old)] @ found.theta[old])
    own = np.diag(a)[more]
    if not len(more) or energy <= 0.0 or not np.all(own > 0.0):
        return 0.0
    cross, made, gradient = taken_out(problem, found, more)
    left = a[np.ix_(more, more)] - cross.T @ made
    size = rules.EXPECTED_SHARE * np.sqrt(energy / own)
    shown = np.eye(len(more)) + left * np.outer(size, size)
    pull = gradient * size
    log_odds = 0.5 * float(pull @ np.linalg.solve(shown, pull)) - 0.5 * float(np.linalg.slogdet(shown)[1])
    return float(np.exp(min(log_odds, 0.0)))
