"""Gates of the search, applied to effects in a set, and backward elimination of effects that fail them.

A claim says that effects are present. A gate is a test that a claim has to pass. The gap is the squared residual of the
given model minus that of noise alone. The gain of a claim is the decrease of the loss (sum of squared residuals in
units of the noise variance) when its effects are added to a set.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.gap import row_counts
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.search.containment import are_near_twins
from identification.diagnosis.search.search import IMPOSSIBLE, Search
from identification.engine.claims import GateResult, until_failed
from identification.gates import above_chance, fair_part
from identification.gates.above_chance import more_than_chance
from identification.gates.existing_bodies import bodies_can_exist
from identification.gates.fair_part import fair_part_of_the_gap
from identification.gates.over_blocks import in_enough_blocks
from identification.gates.possible import possible_size
from phantom_dyn.array_types import Array, Float

# Largest number of effects whose removal from a set is tried: those whose removal raises the loss least.
_MOST_TRIED = 12


def least_gain(search: Search, terms: frozenset[Term], others: frozenset[Term], by_row: Float[Array, " nv"]) -> float:
    """Held-out gain that a claim needs: above chance, and a fair part of the gap on the joints where the claim gains.

    An effect may have columns on a joint with a large gap, and gain on another joint only. So its gain is counted only
    on joints where the gain is a fair part of the gap, or of the residual after the other effects of the set. If these
    include corrections of inertial parameters, the gap is the residual after the corrections, because their columns are
    exact.

    Args:
        search: Thresholds of chance and gaps of the rows.
        terms: The claimed effects.
        others: The other effects of the set.
        by_row: Gain on each joint, in any unit, ``(nv,)``.
    """
    shares = np.maximum(by_row, 0.0) / max(float(np.maximum(by_row, 0.0).sum()), 1e-300)
    # Total gain at which the gain on each joint is a fair part of the joint's gap.
    fair = _fair_part(search, others) / np.maximum(shares, 1e-12)
    order = np.argsort(fair)
    # At a total gain of ``fair[order][k]``, the gain on the first k + 1 joints is counted. It has to exceed chance.
    counted = np.maximum(np.cumsum(shares[order]), 1e-12)
    least = float(np.min(np.maximum(fair[order], search.threshold.of(*terms) / counted)))
    return least + fair_part.SPURIOUS_FACTOR * sum(search.spurious.get(term.effect_joint, 0.0) for term in terms)


def _fair_part(search: Search, others: frozenset[Term]) -> Float[Array, " nv"]:
    """Gain on each row that is a fair part of its gap, or of the residual after the other effects, ``(nv,)``."""
    gap, exact = search.gaps.gap, frozenset(term for term in others if term.effect.exact)
    if exact:
        gap_after_exact = search.fits.row_losses(exact) - row_counts(search.problem)
        gap = np.minimum(gap, np.maximum(gap_after_exact, 0.0))
    fair = fair_part.LEAST_SHARE_OF_GAP * gap + search.gaps.accuracy
    if not others:
        return fair
    gap_after_others = np.maximum(search.fits.row_losses(others) - row_counts(search.problem), 0.0)
    return np.minimum(fair, np.maximum(fair_part.SHARE_OF_LEFT * gap_after_others, search.gaps.accuracy))


def passes_gates(search: Search, chosen: frozenset[Term], without: frozenset[Term]) -> bool:
    """True if the effects that are in ``chosen`` but not in ``without`` pass all gates of a claim."""
    return gate_results(search, chosen, without)[-1].passed


def gate_results(search: Search, chosen: frozenset[Term], without: frozenset[Term]) -> tuple[GateResult, ...]:
    """Results of the gates of the search for the effects that are in ``chosen`` but not in ``without``.

    The gates are applied up to the first that fails. First, sizes and bodies have to be physically possible. Then the
    gain has to be above chance, on held-out data and in sample, has to be a fair part of the gap, and has to come from
    enough blocks.
    """
    return until_failed(_results(search, chosen, without))


def _results(search: Search, chosen: frozenset[Term], without: frozenset[Term]) -> Iterator[GateResult]:
    yield possible_size(int(search.score(chosen) >= IMPOSSIBLE))
    with_new, without_new, new = search.held_out_fit(chosen), search.held_out_fit(without), chosen - without
    if any(term.effect.inertial == "free" for term in new):
        possible = without_new.objective - with_new.objective
        yield bodies_can_exist(possible, possible + with_new.denied_gain, search.threshold.of(*new))
    # The smaller of both gains counts: a held-out gain exceeds that in sample only if a few blocks agree by chance.
    held_out = without_new.total - with_new.total
    gain = min(held_out, without_new.objective - with_new.objective)
    yield more_than_chance(gain, search.threshold.of(*new))
    extra = search.price_of(chosen) - search.price_of(without)
    by_row = without_new.row_losses - with_new.row_losses
    needed = least_gain(search, new, without, by_row) + max(extra - above_chance.PARAMETER_PRICE, 0.0)
    # In a set with a near twin an effect gains little. If its torque is large enough, only the threshold of chance
    # applies.
    if _torque_with_twins(new, without, with_new) > needed:
        needed = min(needed, search.threshold.of(*new))
    yield fair_part_of_the_gap(gain, needed)
    yield in_enough_blocks(
        without_new.loss - with_new.loss,
        held_out,
        gain,
        needed,
        lambda: energy_by_block(search.problem, new),
        named=any(term.named for term in new),
    )


def _torque_with_twins(new: frozenset[Term], without: frozenset[Term], fitted: Fitted) -> float:
    """Squared torque of new effects that have a near twin in the set; zero without twins.

    In a set with its twin, an effect gains little even if its own torque is large, because the twin explains nearly the
    same torque with a wrong size.
    """
    if not any(are_near_twins(one, other) for one in new for other in without):
        return 0.0
    own = sorted({column for term in new for column in term.columns})
    return float(fitted.theta[own] @ fitted.problem.total_a[np.ix_(own, own)] @ fitted.theta[own])


def energy_by_block(problem: Problem, terms: frozenset[Term]) -> Float[Array, " B"]:
    """Energy of the columns of effects in each block, as a share of that in the block with the largest energy.

    The share is set to zero in blocks where the columns consist of rounding errors.
    """
    energy = problem.grams.core_a.diagonal(np.array(sorted({column for term in terms for column in term.columns})))
    share = energy / np.maximum(energy.max(axis=0), 1e-300)
    return np.where(share > 1e-12, share, 0.0).max(axis=1)


def backward_elimination(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """The set after effects that fail the gates of a claim are removed one by one.

    If there are many effects, only those whose removal raises the loss least are tried. On a robot of many joints, one
    step may remove several effects, if no two of them act on the same joint.
    """
    while chosen:
        whole, changed_rows = chosen, frozenset[int]()
        for term in sorted(least_needed(search, whole), key=lambda term: search.score(whole - {term})):
            rows = rows_of_term(search.problem, term)
            if rows.isdisjoint(changed_rows):
                results = gate_results(search, chosen, chosen - {term})
                if not results[-1].passed:
                    search.record.add_failed([term], *results)
                    chosen, changed_rows = chosen - {term}, changed_rows | rows
            if not changed_rows or not search.many_joints:
                break
        if chosen == whole:
            return chosen
    return chosen


def least_needed(search: Search, chosen: frozenset[Term]) -> tuple[Term, ...]:
    """The effects whose removal raises the in-sample loss least, to second order; all effects if there are few."""
    terms = ordered(chosen)
    if len(terms) <= _MOST_TRIED:
        return terms
    found = search.held_out_fit(chosen)
    cov, increase = found.cov, {}
    for term in terms:
        own = np.searchsorted(found.active, term.columns)
        x = found.theta[list(term.columns)]
        # Increase of the loss if the coefficients of the effect are set to zero and all others are fitted again.
        increase[term] = float(x @ np.linalg.pinv(cov[np.ix_(own, own)], hermitian=True) @ x)
    return tuple(sorted(terms, key=lambda term: increase[term])[:_MOST_TRIED])


def rows_of_term(problem: Problem, term: Term) -> frozenset[int]:
    """Indices of the joints on which a term makes a torque."""
    return problem.rows_of_column[term.columns[0]]
