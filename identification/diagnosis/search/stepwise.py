"""Stepwise search for the set of effects that explains the recordings.

Effects are added in the order of their held-out gains. They are removed when they are no longer needed, and swapped for
simpler or better ones. Then structures without a name (they match no effect of the catalogue) are added to the set, or
replace effects that only resemble them.

The score of a set is its held-out loss plus the price of its parameters; a smaller score is better. The gain of an
effect is the decrease of the loss when the effect is added to a set. The search records each decision as the result of
a gate, a test that an effect has to pass. In this file ``comparison`` is the result of the gate that compares the
present set with another one. If it passes, the search keeps the present set.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.search.claims import (
    backward_elimination,
    gate_results,
    least_needed,
    passes_gates,
    rows_of_term,
)
from identification.diagnosis.search.containment import can_join, has_parts_in, is_of_many_joints, with_term
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.search import Search, price
from identification.diagnosis.search.swaps import parts_of, with_simpler_laws, with_swaps
from identification.engine.claims import GateResult
from identification.gates import above_chance, exchange
from identification.gates.above_chance import more_than_chance
from identification.gates.exchange import explains_more_than_others
from identification.stages import Announcement, Progress, Stage

# Largest number of candidates that one step tests on held-out data: those with the largest in-sample gains.
_MOST_TESTED = 24
# The same number where the best candidate nearly always has one of the largest in-sample gains: for effects below the
# threshold of chance, structures without a name, and the first effects of `_with_other_starts`.
_FEW_TESTED = 8
# `_with_other_starts` is used for robots with at most this many joints.
_MOST_JOINTS_WITH_OTHER_STARTS = 3
# Largest number of structures without a name in a set.
_MOST_NAMELESS = 4


def stepwise_search(search: Search, progress: Progress, start: frozenset[Term] = frozenset()) -> frozenset[Term]:
    """The set of effects that explains the recordings with the fewest parameters.

    Free inertial parameters of all links explain a little of any missing effect. So the search finds the other effects
    first. If free inertial parameters alone explain more than all found effects together, they replace these, and the
    search continues with them. On a robot with many joints, torque constants are tested last, too, because a fit with
    such a constant takes many times as long.

    Args:
        search: Problem, candidates, threshold.
        progress: Function that is called at the beginning of each stage.
        start: Effects that an earlier search has found.
    """
    # Laws are now linearised about the result of the earlier search, so another law may fit better. Swaps come first:
    # otherwise the search would add effects that only correct the errors of a wrong law.
    chosen = with_swaps(search, backward_elimination(search, frozenset(term for term in start if term.named)))
    inertias = next((term for term in search.terms if term.effect.inertial == "free" and term.joint is None), None)
    constants = {term for term in search.terms if search.many_joints and term.effect.scales_joint}
    if inertias is not None or constants:
        chosen = _improved_without(search, constants | {inertias}, chosen, progress)
    if inertias is not None and inertias not in chosen:
        chosen = _alone_if_better(search, inertias, chosen)
    if inertias is not None and constants:
        chosen = _improved_without(search, constants, chosen, progress)
    chosen = _with_other_starts(search, _improved(search, chosen, progress), progress)
    return with_nameless(search, chosen, progress)


def _alone_if_better(search: Search, term: Term, chosen: frozenset[Term]) -> frozenset[Term]:
    """The set of one effect alone if its score is better than that of the chosen set, else the chosen set."""
    alone = search.alone[term]
    # Held-out scores take longer, so they are computed only if the effect is better in sample.
    if not search.in_sample_score(alone) < search.in_sample_score(chosen):
        return chosen
    comparison = explains_more_than_others(search.score(alone) - search.score(chosen), -exchange.ROUNDING)
    if comparison.passed:
        return chosen
    search.record.add_failed(chosen, comparison, replaced_by=[term])
    search.record.add_passed([term])
    return alone


def _improved_without(
    search: Search, late: Collection[Term | None], chosen: frozenset[Term], progress: Progress
) -> frozenset[Term]:
    """The set that `_improved` finds without the effects ``late``; ``chosen`` itself if it contains one of them."""
    if not chosen.isdisjoint(late):
        return chosen
    without_late = replace(search, terms=tuple(term for term in search.terms if term not in late))
    return _improved(without_late, chosen, progress)


def _improved(search: Search, chosen: frozenset[Term], progress: Progress) -> frozenset[Term]:
    """The set after additions, removals and swaps of effects, repeated until they change nothing."""
    for _ in range(4):
        before = chosen
        chosen = forward_selection(search, chosen, progress)
        progress(Announcement(Stage.ALTERNATIVES))
        chosen = with_simpler_laws(search, with_swaps(search, backward_elimination(search, chosen)))
        chosen = _by_single_effects(search, chosen, progress)
        if chosen == before:
            break
    return chosen


def _with_other_starts(search: Search, chosen: frozenset[Term], progress: Progress) -> frozenset[Term]:
    """The set, or a better one from a search that begins with another effect, if a joint moves in one sine.

    In one sine, two numbers determine the torque of a joint: its amplitudes in phase and out of phase with the motion.
    Suppose that each of two true effects makes one of these amplitudes, and a wrong effect makes both. Then the wrong
    effect gains most by itself and is added first. In a set with the wrong effect, the true effects gain nothing.
    """
    sines = search.problem.session.in_one_sine
    if not sines or len(search.problem.columns.rows) > _MOST_JOINTS_WITH_OTHER_STARTS:
        return chosen
    named = tuple(
        term for term in search.terms if term.named and not sines.isdisjoint(rows_of_term(search.problem, term))
    )
    gains = search.gains(frozenset(), named)
    best_shapes: dict[EffectJoint, Term] = {}
    for term in sorted(named, key=lambda term: -gains[term]):
        best_shapes.setdefault(term.effect_joint, term)
    best = chosen
    for term in [*best_shapes.values()][:_FEW_TESTED]:
        if term in chosen:
            continue
        trial = replace(search, record=search.record.copy_for_trial())
        tried = backward_elimination(trial, forward_selection(trial, search.alone[term], progress))
        comparison = explains_more_than_others(search.score(tried) - search.score(best), -exchange.ROUNDING)
        if not comparison.passed:
            search.record.take_over(trial.record)
            search.record.add_failed(best - tried, comparison, replaced_by=tried - best)
            best = tried
    return best


def best_below_threshold(search: Search, chosen: frozenset[Term]) -> frozenset[Term] | None:
    """The set with one more named effect if that improves the score, else None.

    The effect has to gain more than its price, but need not gain more than chance.
    """
    candidates = tuple(term for term in search.terms if term.named and search.can_join(chosen, term))
    in_sample_gains = search.gains(chosen, candidates, above=0.0)
    most_promising = sorted(candidates, key=lambda term: -in_sample_gains[term])[:_FEW_TESTED]
    sets = [with_term(chosen, term) for term in most_promising if _beats_small_parts(search, chosen, term)]
    best = min(sets, key=search.score, default=None)
    return best if best is not None and search.score(best) < search.score(chosen) else None


def forward_selection(search: Search, chosen: frozenset[Term], progress: Progress) -> frozenset[Term]:
    """Forward selection: add the effect with the largest held-out gain until none gains more than chance.

    The in-sample gain of an effect is larger than its held-out gain. So effects are tested on held-out data in the
    order of their in-sample gains, until no further one can be better than the best so far.

    After each addition, unnecessary effects are removed. Then the added effect may become unnecessary, too, and the
    search returns to an earlier set. If so, the result is the best set since the first occurrence of that set.
    """
    visited = [chosen]
    while True:
        progress(Announcement(Stage.RIVALS_TRIED, detail={"found": len(chosen)}))
        score = search.score(chosen)
        candidates = [term for term in search.terms if term.named and search.can_join(chosen, term)]
        in_sample_gains = search.gains(chosen, tuple(candidates), above=0.0)
        best, largest_gain = None, 0.0
        ranked = sorted(candidates, key=lambda term: -in_sample_gains[term])
        for term in ranked[:_MOST_TESTED]:
            if in_sample_gains[term] < largest_gain:
                break
            # The threshold of chance applies to the gain before the price is subtracted.
            gain_before_price = in_sample_gains[term] + price(search.counts[term])
            if not more_than_chance(gain_before_price, search.threshold.of(term)).passed:
                continue
            gain = score - search.score(with_term(chosen, term))
            if not explains_more_than_others(gain, largest_gain).passed:
                continue
            if _beats_small_parts(search, chosen, term) and passes_gates(search, with_term(chosen, term), chosen):
                best, largest_gain = term, gain
        if best is None:
            return chosen
        chosen = _with_claimed(search, chosen, best)
        if search.many_joints:
            chosen = _with_other_joints(search, chosen, best, ranked)
        chosen = backward_elimination(search, chosen)
        if chosen in visited:
            return min(visited[visited.index(chosen) :], key=search.score)
        visited.append(chosen)


def _with_other_joints(search: Search, chosen: frozenset[Term], best: Term, ranked: list[Term]) -> frozenset[Term]:
    """The set with the most promising effect of each other joint, if it passes the gates of a claim.

    Free inertial parameters and torque constants are not added here, but only as the best effect of a step: free
    inertial parameters explain a little of any missing effect, and fits with a torque constant take very long.

    Args:
        search: Fits and scores of sets.
        chosen: The set with the best effect of this step.
        best: The best effect of this step.
        ranked: Candidates in the order of their in-sample gains, the largest first.
    """
    joints = {best.joint}
    for term in ranked:
        if term.joint is None or term.joint in joints or term.effect.inertial == "free" or term.effect.scales_joint:
            continue
        joints.add(term.joint)
        if can_join(chosen, term) and passes_gates(search, with_term(chosen, term), chosen):
            chosen = _with_claimed(search, chosen, term)
    return chosen


def _with_claimed(search: Search, chosen: frozenset[Term], term: Term) -> frozenset[Term]:
    """The set with a claimed effect and without the effects that it replaces; both are recorded."""
    with_claim = with_term(chosen, term)
    margin = search.score(chosen) - search.score(with_claim)
    search.record.add_failed(chosen - with_claim, explains_more_than_others(-margin), replaced_by=[term])
    search.record.add_passed([term], *gate_results(search, with_claim, chosen), explains_more_than_others(margin))
    return with_claim


def _by_single_effects(search: Search, chosen: frozenset[Term], progress: Progress) -> frozenset[Term]:
    """The set with effects of single joints in place of a law of many joints, if they explain more.

    A law of many joints has more parameters than the robot has joints, or is one torque constant for several joints.
    The former are free inertial parameters, which explain wrong rotor inertias; the latter explains wrong friction on
    all these joints. Such a law gains most at first, because it explains a little of the effects of all joints. No swap
    of one effect for another removes it, so the search is repeated without it.
    """
    for term in ordered(chosen):
        has_many_parameters = search.counts[term] > len(search.problem.columns.rows)
        if not has_many_parameters and not is_of_many_joints(term):
            continue
        others = tuple(other for other in search.terms if other.effect is not term.effect)
        without = replace(search, terms=others, record=search.record.copy_for_trial())
        tried = forward_selection(without, chosen - {term}, progress)
        tried = with_swaps(without, backward_elimination(without, tried))
        score = search.score(tried)
        if not has_many_parameters:
            # The common torque constant is also compared with friction on each of its joints, although the friction of
            # one joint may be too small for a claim.
            score = min(score, search.score(_with_small_parts(without, tried, term)))
        # Many sets were tried, so a small margin may be chance.
        comparison = explains_more_than_others(score - search.score(chosen), -above_chance.PARAMETER_PRICE)
        if not comparison.passed:
            search.record.take_over(without.record)
            search.record.add_failed([term], comparison, replaced_by=tried - chosen)
            chosen = tried
        else:
            # The effects of the trial explain no more than the law, so they are recorded as failed.
            trial = explains_more_than_others(search.score(chosen) - score, above_chance.PARAMETER_PRICE)
            search.record.add_failed(tried - chosen, trial, replaced_by=[term])
    return chosen


def _beats_small_parts(search: Search, chosen: frozenset[Term], term: Term) -> bool:
    """False for an effect with one parameter for several joints that gains hardly more than its parts on these joints.

    The gain of such an effect may come from friction on several joints that is too small for a claim on each joint. The
    result is True for all other effects.
    """
    if not has_parts_in(chosen, term):
        return True
    parts = _with_small_parts(search, chosen, term)
    gain = search.score(parts) - search.score(with_term(chosen, term))
    return more_than_chance(gain, search.threshold.of(term)).passed


def _with_small_parts(search: Search, chosen: frozenset[Term], term: Term) -> frozenset[Term]:
    """The set with the effects of single joints whose sum makes nearly the torque of an effect of all these joints."""
    for part in parts_of(search, term):
        if part.joint is not None and can_join(chosen, part):
            chosen = with_term(chosen, part)
    return chosen


def with_nameless(search: Search, chosen: frozenset[Term], progress: Progress) -> frozenset[Term]:
    """The set after structures without a name are added to named effects, or replace them.

    A structure has to gain as much as any claim compared with the best set of named effects; effects that it makes
    unnecessary are then removed. A structure with fewer parameters than several effects together may replace them with
    less gain, except if a joint moves in one sine: there a structure with two parameters can make any torque.
    """
    progress(Announcement(Stage.NAMELESS))
    accuracy = exchange.NAMELESS_ACCURACY * max(search.score(frozenset()) - search.score(chosen), 0.0)
    for _ in range(_MOST_NAMELESS):
        better = _better_with_structure(search, chosen, accuracy)
        if not better:
            return chosen
        before, chosen = chosen, min(better, key=search.score)
        search.record.add_failed(before - chosen, better[chosen], replaced_by=chosen - before)
    return chosen


def _better_with_structure(
    search: Search, chosen: frozenset[Term], accuracy: float
) -> dict[frozenset[Term], GateResult]:
    """Better sets with one more structure, each with the result of the gate that the present set fails against it.

    Args:
        search: Fits and scores of sets.
        chosen: The present set.
        accuracy: Gain that a structure may owe to inaccuracies of the laws that it replaces.
    """
    structures = tuple(term for term in search.terms if not term.named)
    sines = search.problem.session.in_one_sine
    better: dict[frozenset[Term], GateResult] = {}
    # A structure is added to the whole set, and to its structures alone. Then needed effects are added again.
    for base in dict.fromkeys((chosen, frozenset(term for term in chosen if not term.named))):
        in_sample_gains = search.gains(base, structures, above=search.threshold.overall)
        for term in sorted(structures, key=lambda term: -in_sample_gains[term])[:_FEW_TESTED]:
            if not more_than_chance(in_sample_gains[term], search.threshold.overall).passed or not can_join(base, term):
                continue
            tried = _with_needed_only(search, term, base, chosen)
            in_one_sine = not sines.isdisjoint(rows_of_term(search.problem, term))
            needed = _least_nameless_gain(search, term, chosen - tried, accuracy, in_one_sine=in_one_sine)
            # The present set is kept unless the score of the set with the structure is lower by ``needed``.
            comparison = explains_more_than_others(search.score(tried) - search.score(chosen), -needed)
            if not comparison.passed and passes_gates(search, tried, tried - {term}):
                better[tried] = comparison
    return better


def _count_of_causes(effects: frozenset[Term]) -> int:
    """Number of causes behind some effects: one effect on many joints, or many effects on one joint, is one cause."""
    return min(len({term.effect for term in effects}), len({term.joint for term in effects}))


def _least_nameless_gain(
    search: Search, structure: Term, replaced: frozenset[Term], accuracy: float, *, in_one_sine: bool
) -> float:
    """Decrease of the score that a structure without a name needs if it makes some effects unnecessary.

    The result is zero if the structure has fewer parameters than several effects together: then these effects probably
    imitate what the structure describes.

    Args:
        search: Number of parameters of each effect, and the threshold of chance.
        structure: A structure without a name.
        replaced: Effects that the structure makes unnecessary.
        accuracy: Gain that the structure may owe to inaccuracies of the laws that it replaces.
        in_one_sine: True if the joint of the structure moves in one sine, where two parameters can make any torque.
    """
    simpler = not structure.shape and search.counts[structure] < search.parameter_count(replaced)
    if simpler and len(replaced) > 1 and not in_one_sine:
        return 0.0
    most = 1 if in_one_sine else len(exchange.NAMELESS_MARGIN) - 1
    causes = min(_count_of_causes(replaced), most)
    margin = exchange.NAMELESS_MARGIN[causes] * search.threshold.overall
    return margin + accuracy if causes in (1, 2) else margin


def _with_needed_only(
    search: Search, structure: Term, base: frozenset[Term], chosen: frozenset[Term]
) -> frozenset[Term]:
    """The set ``base`` with a structure, and with those named effects of ``chosen`` that are still needed.

    Effects that act on none of the structure's joints are needed without a test. If the set has many effects, those
    whose removal increases the loss least are tested; the others are needed without a test, too.
    """
    rows = rows_of_term(search.problem, structure)
    with_all = with_term(chosen, structure)
    untested = with_all.difference(least_needed(search, with_all))
    needed = [
        term
        for term in ordered(chosen)
        if term.named and (term in untested or rows.isdisjoint(rows_of_term(search.problem, term)))
    ]
    # First the needed effects are added, then those that pass the gates and replace no effect of the set.
    tried = with_term(base, structure)
    for term in needed:
        if can_join(tried, term):
            tried = with_term(tried, term)
    for term in ordered(chosen.difference(needed)):
        more = with_term(tried, term)
        if term.named and can_join(tried, term) and passes_gates(search, more, tried) and more >= tried:
            tried = more
    # Then tested effects that fail the gates are removed one by one.
    while True:
        tested = ordered(tried.difference(needed))
        unnecessary = [term for term in tested if term.named and not passes_gates(search, tried, tried - {term})]
        if not unnecessary:
            return tried
        tried = tried - {min(unnecessary, key=lambda term: search.score(tried - {term}))}
