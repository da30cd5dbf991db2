"""Swaps of the stepwise search: an effect of the set is replaced by one or several that are better or simpler.

Sets are compared by their score, the held-out loss plus the price of their parameters. ``chosen`` is the present set.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.search.claims import backward_elimination, passes_gates, rows_touched_by
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

# Largest number of swaps that are evaluated on held-out data: those that are best in sample.
_WORTH_TRYING = 8
# The same for the swaps on each set of joints, if the robot has many joints.
_TRIED_EACH = 3


def with_swaps(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """The set after swaps of single effects for better or simpler ones, until no swap lowers the score."""
    for _ in range(20):
        # In-sample losses take less time, so they decide which swaps are tested on held-out data.
        present = search.in_sample_loss(chosen) + search.price_of(chosen)
        tried = {
            with_replacement(chosen, term, others)
            for term in ordered(chosen)
            for others in relevant_alternatives(search, chosen, term, 2 * above_chance.PARAMETER_PRICE)
        }
        ranked = sorted(
            tried - {chosen}, key=lambda other: (search.in_sample_loss(other) + search.price_of(other), _key(other))
        )
        worth = [
            other
            for other in ranked
            if search.in_sample_loss(other) + search.price_of(other) < present + above_chance.PARAMETER_PRICE
        ]
        if search.many_joints:
            best = _swapped_everywhere(search, chosen, worth)
        else:
            better = [other for other in worth[:_WORTH_TRYING] if _is_better(search, other, chosen)]
            best = min(better, key=lambda other: (search.score(other), _key(other)), default=chosen)
        if best == chosen:
            return chosen
        search.record.add_failed(chosen - best, _exchange(search, best, chosen), replaced_by=best - chosen)
        search.record.add_passed(best - chosen, _exchange(search, chosen, best))
        chosen = backward_elimination(search, best)
    return chosen


def _is_better(search: Search, other: frozenset[Term], chosen: frozenset[Term]) -> bool:
    """True if another set has the lower score, and passes the gates of a claim if it has more parameters.

    Without these gates the next elimination would undo the swap.
    """
    cheaper = search.price_of(other) <= search.price_of(chosen)
    return _exchange(search, chosen, other).passed and (cheaper or passes_gates(search, other, chosen))


def _exchange(search: Search, before: frozenset[Term], after: frozenset[Term]) -> GateResult:
    """Result of the gate that asks whether the set ``after`` scores better than the set ``before``."""
    return explains_more_than_others(search.score(before) - search.score(after), exchange.ROUNDING)


def _swapped_everywhere(search: Search, chosen: frozenset[Term], ranked: list[frozenset[Term]]) -> frozenset[Term]:
    """The set after swaps on all joints in one step, the most promising swap of each joint first.

    Args:
        search: Fits and scores of sets.
        chosen: The current set.
        ranked: Sets that differ from it by a swap, the most promising first.
    """
    current, touched, tried = chosen, frozenset[int](), Counter[frozenset[int]]()
    for other in ranked:
        changed = chosen ^ other
        rows = frozenset[int]().union(*(rows_touched_by(search.problem, term) for term in changed))
        if rows.isdisjoint(touched) and tried[rows] < _TRIED_EACH:
            tried[rows] += 1
            # The same swap in the current set, which may contain swaps on other joints by now.
            if _is_better(search, current ^ changed, current):
                current, touched = current ^ changed, touched | rows
    return current


def with_simpler_laws(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """The set with special cases in place of effects, if they explain as much within the accuracy of the method.

    If the torque of an effect is far above the noise, additional parameters of its law can fit the errors of filters
    and of the linearised tolerances.
    """
    for term in ordered(chosen):
        accuracy = fair_part.ACCURACY * explained_loss(search, chosen, term)
        simpler = [
            with_replacement(chosen, term, others)
            for others in alternatives(search, term)
            if all(contains(term, other) for other in others)
        ]
        simpler = [other for other in simpler if search.price_of(other) < search.price_of(chosen)]
        best = min(simpler, key=lambda other: (search.score(other), _key(other)), default=chosen)
        worth = worth_its_numbers(search.score(best) - search.score(chosen), accuracy)
        if not worth.passed:
            search.record.add_failed(chosen - best, worth, replaced_by=best - chosen)
            search.record.add_passed(best - chosen)
            chosen = best
    return _with_one_number(search, chosen)


def _with_one_number(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """The set with one parameter for several joints in place of one for each joint, if the set explains as much."""
    single = {term.joint: term for term in ordered(chosen) if term.effect.shared and len(joints_of(term)) == 1}
    for term in search.terms:
        own = [single[joint] for joint in joints_of(term) if joint in single] if term.effect.shared else []
        if len(own) < 2 or len(own) < len(joints_of(term)) or not chosen.issuperset(own):
            continue
        other = with_term(chosen, term)
        accuracy = fair_part.ACCURACY * sum(explained_loss(search, chosen, one) for one in own)
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

    An effect between two joints makes the same torque as friction on both joints if these move alike, and has fewer
    parameters. So an effect between two joints is compared with all sets of friction on both. A torque constant scales
    all torques of its drive. So a torque constant is compared with sums of effects that make these torques.
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
        if (contains(term, other) and other.joint == term.joint) or _of_passive_joint(search, term, other)
    ]
    joints = joints_of(term) if term.effect.scope == "pair" else ()
    on_each_joint = [
        other for other in search.terms if other.joint in joints and other.effect.name in term.effect.on_each_joint
    ]
    several = [*_groups(parts, most=3), *_groups(on_each_joint), *_of_near_twins(search, term)]
    several += _sums_of_parts(search, term)
    same = [
        search.alone[other] for other in search.terms if other.effect_joint == term.effect_joint and other is not term
    ]
    return (*single, *several, *same)


def _groups(terms: list[Term], most: int | None = None) -> list[frozenset[Term]]:
    """All sets of two to ``most`` of some effects; None: of two to all."""
    sizes = range(2, (len(terms) if most is None else most) + 1)
    return [frozenset(group) for size in sizes for group in combinations(terms, size)]


def _sums_of_parts(search: Search, term: Term) -> list[frozenset[Term]]:
    """Sets of two or more effects whose sum may make the torque of one effect.

    An effect with one parameter for several joints is replaced by parts on all of these joints. An effect of one joint
    is replaced by pairs of a part on this joint and another part, and by all parts together.
    """
    parts = parts_of(search, term)
    if len(joints_of(term)) > 1:
        return [frozenset(part for part in parts if part.joint is not None)]
    pairs = [frozenset([one, other]) for one in parts for other in parts if one.joint == term.joint and one != other]
    return list(dict.fromkeys([*pairs, frozenset(parts)])) if len(parts) > 1 else []


def parts_of(search: Search, term: Term) -> list[Term]:
    """Effects whose sum may make nearly the torque of ``term``, on joints on which it acts or of the whole robot."""
    names = search.problem.session.robot.joint_names
    rows = frozenset[int]().union(*(search.problem.rows_of_column[column] for column in term.columns))
    joints = {None, *(names[row] for row in rows)}
    return [other for other in search.terms if other.effect.name in term.effect.sum_parts and other.joint in joints]


def _of_near_twins(search: Search, term: Term) -> list[frozenset[Term]]:
    """Pairs of a near twin of an effect, which makes nearly the same torque, with a further effect.

    The further effect may be another part of a law with more parameters that contains the effect or its twin: without
    this part the twin would seem worse than it is. The further effect may also be the replaced effect itself, because
    the gain of a twin that is added to the other one is too small for a claim.
    """
    on_joint = [other for other in search.terms if other.joint == term.joint]
    twins = [other for other in search.terms if are_near_twins(term, other)]
    names = {term.effect.name, *(twin.effect.name for twin in twins)}
    richer = [other.effect for other in on_joint if names & set(other.effect.contains)]
    further = {name for effect in richer for name in effect.contains} - names
    pairs = [(twin, other) for twin in twins for other in on_joint if other.effect.name in further]
    return [frozenset(pair) for pair in (*pairs, *((term, twin) for twin in twins))]


def _of_passive_joint(search: Search, term: Term, other: Term) -> bool:
    """True if a coupling of two joints can make the torque of friction on a passive joint that moves with these two."""
    passive = search.problem.session.robot.passive_names
    if term.effect.scope != "pair" or other.joint not in passive or other.shape:
        return False
    return can_make_torque(search, list(other.columns), np.ones(len(other.columns)), list(term.columns))


def can_make_torque(
    search: Search, columns: list[int], theta: Float[Array, " k"], by: list[int], most_left: float = fair_part.ACCURACY
) -> bool:
    """True if the columns ``by`` can make the torque ``columns @ theta``, within the accuracy of the method.

    Args:
        search: Has the products of all columns.
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
        slack: How much smaller the gain of an alternative may be than that of the effect, with prices subtracted.
    """
    remaining = chosen - {term}
    if term not in search.near:
        rows = rows_touched_by(search.problem, term)
        search.near[term] = tuple(
            others
            for others in alternatives(search, term)
            if any(rows & rows_touched_by(search.problem, other) for other in others)
        )
    near = [
        others for others in search.near[term] if all(remaining.isdisjoint(search.covering(other)) for other in others)
    ]
    singles = tuple(other for others in near if len(others) == 1 for other in others if other not in remaining)
    explained = explained_loss(search, chosen, term)
    # The estimated gains of nonlinear laws may have errors of a few per cent.
    least = explained - price(search.sizes[term]) - max(slack, 0.05 * explained)
    gains = search.gains(remaining, singles, above=least, instead_of=term)
    return tuple(others for others in near if len(others) > 1 or gains.get(next(iter(others)), -np.inf) >= least)


def with_replacement(chosen: frozenset[Term], term: Term, others: frozenset[Term]) -> frozenset[Term]:
    """``chosen`` with ``others`` in place of ``term``."""
    out = chosen - {term}
    for other in ordered(others):
        if can_join(out, other):
            out = with_term(out, other)
    return out


def _key(chosen: frozenset[Term]) -> list[tuple[int, ...]]:
    """Sort key that breaks ties independently of the order of a set."""
    return [term.columns for term in ordered(chosen)]
