"""Costs of sets of effects that are compared as rivals, and corrections that make the comparison fair.

The cost of a set is added to its held-out loss. It is the price of its parameters, plus the penalty on the changes of
the model within its tolerances that the fit needs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.plausible_sizes import rarity
from identification.diagnosis.search.search import Search
from identification.gates import fair_part, rivalry
from phantom_dyn.array_types import Array, Float


def costs_of(
    search: Search, sets: list[frozenset[Term]], twins: list[bool], unnested: Sequence[bool] = ()
) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Cost of each set, price plus penalty on changes within tolerance, in two versions of equal weight.

    The penalty is relative to that of the first set. In the first version the whole difference counts. Stated
    tolerances are only rough. So in the second version a difference is reduced by four, the penalty of a change by two
    tolerances: a difference of six counts as two, and one of less than four as zero.

    Args:
        search: Prices and fits of the sets.
        sets: The compared sets, that of the finding first.
        twins: True for sets that make the same torque as the first set. They get its price.
        unnested: True for sets with a law that neither contains the finding nor is its special case; may be empty. They
            get the price of the first set. If their price and their penalty differ from those of the first set in
            opposite directions, they get its penalty, too: free inertias also take over errors of the model within its
            tolerances.
    """
    prices = np.array([search.price_of(chosen) for chosen in sets])
    more_price = prices - prices[0]
    prices[twins] = prices[0]
    penalties = np.array([search.held_out_fit(chosen).penalty for chosen in sets])
    more_penalty = penalties - penalties[0]
    if unnested:
        prices[list(unnested)] = prices[0]
        more_penalty = np.where(np.array(unnested) & (more_penalty * more_price < 0.0), 0.0, more_penalty)
    return prices + more_penalty, prices + np.sign(more_penalty) * np.maximum(np.abs(more_penalty) - 4.0, 0.0)


def rarities_of(search: Search, sets: list[frozenset[Term]]) -> Float[Array, " m"]:
    """Rarity of the sizes of all effects of each set: minus two log likelihoods by their prior, ``(m,)``."""
    session, fits = search.problem.session, [search.held_out_fit(chosen) for chosen in sets]
    return np.array(
        [
            sum(rarity(session, one, *fit.coefficients_of(one)) for one in chosen)
            for chosen, fit in zip(sets, fits, strict=True)
        ]
    )


def weighted_by_rarity(shares: Float[Array, " m"], rarities: Float[Array, " m"]) -> Float[Array, " m"]:
    """Probabilities of sets, multiplied by the prior of the sizes in each set and scaled to the same sum, ``(m,)``.

    Args:
        shares: Probability of each set from the data alone.
        rarities: Result of `rarities_of`.
    """
    likely = shares * np.exp(-0.5 * (rarities - rarities.min()))
    return likely * (shares.sum() / likely.sum())


def without_method_errors(
    losses: Float[Array, "B m"], more_parameters: Float[Array, " m"], reduced: Sequence[bool], gain: float
) -> Float[Array, "B m"]:
    """Losses of rivals whose differences from the finding's loss are reduced by the errors of the method.

    Derivatives, filters and the linearised tolerances have errors. So a difference between two causes that is a tiny
    part of what they explain is no evidence, even if it is far above the noise. A difference in favour of the set with
    fewer parameters counts in full, because additional parameters can only fit such errors.

    Args:
        losses: Held-out losses by block and set, that of the finding first.
        more_parameters: Number of parameters of each set minus that of the finding's set.
        reduced: True for sets whose difference is reduced.
        gain: Decrease of the loss by the finding; the errors are a fixed share of it.
    """
    difference = losses - losses[:, :1]
    total = difference.sum(axis=0)
    factor = np.maximum(np.abs(total) - fair_part.ACCURACY * gain, 0.0) / np.maximum(np.abs(total), 1e-300)
    return losses[:, :1] + difference * np.where(np.array(reduced) & (total * more_parameters <= 0.0), factor, 1.0)


def does_not_cancel(search: Search, chosen: Chosen) -> bool:
    """True unless the torques of the effects of a set nearly cancel each other.

    For example, in a motion of one sine a large lag and much friction together make the torque of little friction. If
    the data do not separate two causes, the one whose torques have to cancel is less likely.
    """
    a, theta = search.problem.total_a, search.held_out_fit(chosen).theta
    each = [np.array(one.columns) for one in ordered(chosen)]
    every = np.concatenate(each)
    power_of_sum = float(theta[every] @ a[np.ix_(every, every)] @ theta[every])
    sum_of_powers = sum(float(theta[own] @ a[np.ix_(own, own)] @ theta[own]) for own in each)
    return sum_of_powers <= rivalry.MOST_CANCELLED * power_of_sum
