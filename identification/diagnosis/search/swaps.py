"""Swaps of the stepwise search: an effect of the set is replaced by one or several that are better or simpler.

Sets are compared by their score, the held-out loss plus the price of their parameters. ``chosen`` is the present set.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.search.claims import backward_elimination, passes_gates, rows_of_term
from identification.diagnosis.search.containment import (
    are_near_twins,
    are_parts,
    can_join,
    contains,
    is_of_many_joints,
    joints_of,
    with_term,
)
from identification.diagnosis.search.search import Search, price
from identification.engine.claims import GateResult
from identification.engine.numerics.bounded import solve
from identification.gates import above_chance, exchange, fair_part
from identification.gates.exchange import explains_more_than_others, worth_its_numbers
from phantom_dyn.array_types import Array, Float

# Largest number of swaps that are tested on held-out data: those that are best in sample.
_MOST_TESTED = 8
# The same number for the swaps on each set of joints, if the robot has many joints.
_MOST_TESTED_ON_JOINTS = 3


def with_swaps(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """The set after swaps of single effects for better or simpler ones, until no swap lowers the score."""
    for _ in range(20):
        # In-sample scores take less time, so they decide which swaps are tested on held-out data.
        largest_score = search.in_sample_score(chosen) + above_chance.PARAMETER_PRICE
        tried = {
            with_replacement(chosen, term, others)
            for term in ordered(chosen)
            for others in relevant_alternatives(search, chosen, term, 2 * above_chance.PARAMETER_PRICE)
        }
        ranked = sorted(tried - {chosen}, key=lambda other: (search.in_sample_score(other), _tie_break(other)))
        promising = [other for other in ranked if search.in_sample_score(other) < largest_score]
        if search.many_joints:
            best = _swapped_on_all_joints(search, chosen, promising)
        else:
            better = [other for other in promising[:_MOST_TESTED] if _is_better(search, other, chosen)]
            best = min(better, key=lambda other: (search.score(other), _tie_break(other)), default=chosen)
        if best == chosen:
            return chosen
        search.record.add_failed(chosen - best, _exchange_gate(search, best, chosen), replaced_by=best - chosen)
        search.record.add_passed(best - chosen, _exchange_gate(search, chosen, best))
        chosen = backward_elimination(search, best)
    return chosen


def _is_better(search: Search, other: frozenset[Term], chosen: frozenset[Term]) -> bool:
    """True if another set has a lower score, and passes the gates of a claim if its price is higher.

    A set that fails these gates would lose the new effects in the next elimination.
    """
    cheaper = search.price_of(other) <= search.price_of(chosen)
    return _exchange_gate(search, chosen, other).passed and (cheaper or passes_gates(search, other, chosen))


def _exchange_gate(search: Search, before: frozenset[Term], after: frozenset[Term]) -> GateResult:
    """Result of the gate that asks whether the set ``after`` scores better than the set ``before``."""
    return explains_more_than_others(search.score(before) - search.score(after), exchange.ROUNDING)


def _swapped_on_all_joints(search: Search, chosen: frozenset[Term], ranked: list[frozenset[Term]]) -> frozenset[Term]:
    """The set after swaps on all joints in one step, the most promising swap of each joint first.

    Args:
        search: Fits and scores of sets.
        chosen: The current set.
        ranked: Sets that differ from it by a swap, the most promising first.
    """
    current, changed_rows, tested = chosen, frozenset[int](), Counter[frozenset[int]]()
    for other in ranked:
        swap = chosen ^ other
        rows = frozenset[int]().union(*(rows_of_term(search.problem, term) for term in swap))
        if rows.isdisjoint(changed_rows) and tested[rows] < _MOST_TESTED_ON_JOINTS:
            tested[rows] += 1
            # The swap is tested in the current set, which may already contain swaps on other joints.
            if _is_better(search, current ^ swap, current):
                current, changed_rows = current ^ swap, changed_rows | rows
    return current


def with_simpler_laws(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """The set with special cases in place of effects, if they explain as much within the accuracy of the method.

    If the torque of an effect is far above the noise, additional parameters of its law may fit only the errors of
    filters and of the linearised tolerances.
    """
    for term in ordered(chosen):
        accuracy = fair_part.ACCURACY * explained_loss(search, chosen, term)
        simpler = [
            with_replacement(chosen, term, others)
            for others in alternatives(search, term)
            if all(contains(term, other) for other in others)
        ]
        simpler = [other for other in simpler if search.price_of(other) < search.price_of(chosen)]
        best = min(simpler, key=lambda other: (search.score(other), _tie_break(other)), default=chosen)
        worth = worth_its_numbers(search.score(best) - search.score(chosen), accuracy)
        if not worth.passed:
            search.record.add_failed(chosen - best, worth, replaced_by=best - chosen)
            search.record.add_passed(best - chosen)
            chosen = best
    return _with_shared_parameters(search, chosen)


def _with_shared_parameters(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """The set with one parameter for several joints in place of one for each joint, if it explains as much."""
    of_joint = {term.joint: term for term in ordered(chosen) if term.effect.shared and len(joints_of(term)) == 1}
    for term in search.terms:
        single = [of_joint[joint] for joint in joints_of(term) if joint in of_joint] if term.effect.shared else []
        if len(single) < 2 or len(single) < len(joints_of(term)) or not chosen.issuperset(single):
            continue
        other = with_term(chosen, term)
        accuracy = fair_part.ACCURACY * sum(explained_loss(search, chosen, one) for one in single)
        worth = worth_its_numbers(search.score(other) - search.score(chosen), accuracy)
        if not worth.passed:
            search.record.add_failed(chosen - other, worth, replaced_by=[term])
            search.record.add_passed([term])
            chosen = other
    return chosen


def explained_loss(search: Search, chosen: frozenset[Term], term: Term) -> float:
    """Increase of the in-sample loss of a set if one of its effects is removed."""
    return search.in_sample_loss(chosen - {term}) - search.in_sample_loss(chosen)


def alternatives(search: Search, term: Term) -> tuple[frozenset[Term], ...]:
    """Sets of effects that may replace ``term``: single effects, special cases, and sums of effects.

    An effect between two joints makes the same torque as friction on both joints if these move alike, with fewer
    parameters. So it is compared with all sets of friction on both joints. A torque constant scales all torques of its
    drive. So it is compared with sums of effects that make these torques.
    """
    single = [
        search.alone[other]
        for other in search.terms
        if other.named
        and other.effect_joint != term.effect_joint
        and not (is_of_many_joints(other) and are_parts([term], other))
    ]
    parts = [
        other
        for other in search.terms
        if (contains(term, other) and other.joint == term.joint) or _is_friction_on_passive_joint(search, term, other)
    ]
    joints = joints_of(term) if term.effect.scope == "pair" else ()
    on_each_joint = [
        other for other in search.terms if other.joint in joints and other.effect.name in term.effect.on_each_joint
    ]
    several = [*_subsets(parts, most=3), *_subsets(on_each_joint), *_pairs_with_near_twins(search, term)]
    several += _sums_of_parts(search, term)
    other_shapes = [
        search.alone[other] for other in search.terms if other.effect_joint == term.effect_joint and other is not term
    ]
    return (*single, *several, *other_shapes)


def _subsets(terms: list[Term], most: int | None = None) -> list[frozenset[Term]]:
    """All sets of at least two, and at most ``most``, of some effects; None for no limit."""
    sizes = range(2, (len(terms) if most is None else most) + 1)
    return [frozenset(group) for size in sizes for group in combinations(terms, size)]


def _sums_of_parts(search: Search, term: Term) -> list[frozenset[Term]]:
    """Sets of two or more effects whose sum may make the torque of ``term``.

    For an effect with one parameter for several joints, it is the set of all parts on these joints. For an effect of
    one joint, these are pairs of a part on this joint and another part, and the set of all parts.
    """
    parts = parts_of(search, term)
    if len(joints_of(term)) > 1:
        return [frozenset(part for part in parts if part.joint is not None)]
    pairs = [frozenset([one, other]) for one in parts for other in parts if one.joint == term.joint and one != other]
    return list(dict.fromkeys([*pairs, frozenset(parts)])) if len(parts) > 1 else []


def parts_of(search: Search, term: Term) -> list[Term]:
    """Effects of the whole robot, or of joints on which ``term`` acts, whose sum may make nearly its torque."""
    names = search.problem.session.robot.joint_names
    rows = frozenset[int]().union(*(search.problem.rows_of_column[column] for column in term.columns))
    joints = {None, *(names[row] for row in rows)}
    return [other for other in search.terms if other.effect.name in term.effect.sum_parts and other.joint in joints]


def _pairs_with_near_twins(search: Search, term: Term) -> list[frozenset[Term]]:
    """Pairs of a near twin of an effect, which makes nearly the same torque, and a further effect.

    The further effect may be another part of a law with more parameters that contains the effect or its twin: without
    this part, the twin would seem worse than it is. It may also be the replaced effect itself: if the set contains this
    effect, its twin gains too little for a claim of its own.
    """
    on_joint = [other for other in search.terms if other.joint == term.joint]
    twins = [other for other in search.terms if are_near_twins(term, other)]
    names = {term.effect.name, *(twin.effect.name for twin in twins)}
    richer = [other.effect for other in on_joint if names & set(other.effect.contains)]
    further = {name for effect in richer for name in effect.contains} - names
    pairs = [(twin, other) for twin in twins for other in on_joint if other.effect.name in further]
    return [frozenset(pair) for pair in (*pairs, *((term, twin) for twin in twins))]


def _is_friction_on_passive_joint(search: Search, term: Term, other: Term) -> bool:
    """True if ``term`` couples two joints, and can make the torque of ``other`` on a passive joint that they move."""
    passive = search.problem.session.robot.passive_names
    if term.effect.scope != "pair" or other.joint not in passive or other.shape:
        return False
    return can_make_torque(search, list(other.columns), np.ones(len(other.columns)), list(term.columns))


def can_make_torque(
    search: Search, columns: list[int], theta: Float[Array, " k"], by: list[int], most_left: float = fair_part.ACCURACY
) -> bool:
    """True if the columns ``by`` can make the torque ``columns @ theta``, within the accuracy of the method.

    Args:
        search: Search with the products of all columns.
        columns: Columns that make the torque.
        theta: Their coefficients.
        by: The other columns, fitted to that torque.
        most_left: Largest allowed squared residual of that fit, as a share of the squared torque.
    """
    a = search.problem.total_a
    energy = float(theta @ a[np.ix_(columns, columns)] @ theta)
    cross = a[np.ix_(by, columns)] @ theta
    return energy - float(cross @ solve(a[np.ix_(by, by)], cross)) < most_left * energy


def relevant_alternatives(
    search: Search, chosen: frozenset[Term], term: Term, slack: float
) -> tuple[frozenset[Term], ...]:
    """Alternatives of an effect that act on one of its joints and may gain nearly as much in sample.

    Args:
        search: Fits and scores of sets.
        chosen: A set with ``term`` in it.
        term: The effect to be replaced.
        slack: Largest difference between the gains of the effect and of an alternative, with prices subtracted.
    """
    remaining = chosen - {term}
    if term not in search.alternatives_on_joint:
        rows = rows_of_term(search.problem, term)
        search.alternatives_on_joint[term] = tuple(
            others
            for others in alternatives(search, term)
            if any(rows & rows_of_term(search.problem, other) for other in others)
        )
    compatible = [
        others
        for others in search.alternatives_on_joint[term]
        if all(remaining.isdisjoint(search.contained_in(other)) for other in others)
    ]
    singles = tuple(other for others in compatible if len(others) == 1 for other in others if other not in remaining)
    explained = explained_loss(search, chosen, term)
    # The estimated gains of nonlinear laws may have errors of a few per cent.
    least = explained - price(search.counts[term]) - max(slack, 0.05 * explained)
    gains = search.gains(remaining, singles, above=least, instead_of=term)
    return tuple(others for others in compatible if len(others) > 1 or gains.get(next(iter(others)), -np.inf) >= least)


def with_replacement(chosen: frozenset[Term], term: Term, others: frozenset[Term]) -> frozenset[Term]:
    """``chosen`` with ``others`` in place of ``term``."""
    out = chosen - {term}
    for other in ordered(others):
        if can_join(out, other):
            out = with_term(out, other)
    return out


def _tie_break(chosen: frozenset[Term]) -> list[tuple[int, ...]]:
    """Sort key that breaks ties between sets, whatever the order of their elements."""
    return [term.columns for term in ordered(chosen)]
