"""Tests the effects that the search has found in the judged band, gate by gate, until all shown effects pass.

The search keeps the shapes of laws constant and uses other weights than the final fit, from which sizes are stated. So
its result is tested again. The gates have the order of `identification.gates.GATES`; those that compare rivals are
last, because they take longest. A gate removes or replaces the effect that fails worst; then the loop begins with the
first gate again. All results are recorded for the ledger.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.judge.findings.certain_gaps import closes_certain_gap, gain_in_highest_noise
from identification.diagnosis.judge.findings.gate_state import GateContext, LoopState, ShownEffects
from identification.diagnosis.judge.findings.missing_parts import (
    bodies_expressing_part,
    missing_part_shares,
    payload_term,
)
from identification.diagnosis.judge.findings.outside_catalogue import weighed_with_structures
from identification.diagnosis.judge.findings.timing_rivals import hidden_twins, strong_motion_loss_increases
from identification.diagnosis.judge.shares import least_shares_closed, residual_sums_with
from identification.diagnosis.judge.strong_motion import depends_on_acceleration, motion_results, noise_may_imitate
from identification.diagnosis.search.containment import are_parts, can_join, with_term
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.rival_sets import RivalComparison, compare_with_rivals
from identification.diagnosis.search.special_cases import nearest_case, nearest_case_at_shape, simplest_effects
from identification.diagnosis.search.swaps import with_replacement
from identification.engine.claims import GateResult, until_nothing_changes, worst_failure
from identification.gates.in_band import closes_for_sure
from identification.gates.moved_joints import shown_above_noise
from identification.gates.rivalry import likelier_than_rivals
from identification.gates.special_case import differs_from_simpler, more_than_a_missing_part

# Largest number of sets whose effects are compared with rivals, if in each set some rival is more probable than a
# finding. After that, the set in which a rival leads by least is shown.
_MOST_COMPARED_SETS = 8

_Step = Callable[[GateContext, LoopState], LoopState]
# Function that returns the state without an effect, and the effects that replace it.
_Removal = Callable[[LoopState, Term], tuple[LoopState, Iterable[Term]]]


def after_motion_gate(context: GateContext, state: LoopState) -> LoopState:
    """The state without effects that fail the gate `shown_by_motion`, the first gate of the judge."""
    return _until_all_pass(context, state, (_motion_gate,))


def shown_effects(context: GateContext, state: LoopState) -> ShownEffects:
    """Effects that pass every gate of the judge.

    An effect that was replaced by a rival does not return while the rival is in the set. It may happen that in each set
    a rival is more probable than a finding. Then the set in which the rival leads by least is shown, and the finding
    and this rival get equal probabilities.
    """
    steps = (_motion_gate, _closing_gate, _noise_gate, _simpler_law_gate, _missing_part_gate, _rival_gate)
    return _until_all_pass(context, state, steps).compared_sets[-1]


def _until_all_pass(context: GateContext, state: LoopState, steps: tuple[_Step, ...]) -> LoopState:
    """The state after all steps, repeated until a whole round changes nothing."""

    def apply(step: _Step, before: LoopState) -> LoopState:
        return before if before.done else _with_exchanges_undone(context, before, step(context, before))

    return until_nothing_changes(state, [partial(apply, step) for step in steps])


def _with_exchanges_undone(context: GateContext, before: LoopState, after: LoopState) -> LoopState:
    """The state after a step. If a rival failed in this step, the effects that it had replaced return to the set.

    If several rivals replaced an effect and one of them failed, the others alone may explain less than the effect. So
    the effect returns, and the failed rival is barred. If a single rival replaced an effect and failed, the rival may
    exist and be too small to be shown. So the effect returns only if no other rival was more probable, and the failed
    rival remains its rival, but may not replace it again. Rivals that are parts of the effect count as a single rival.
    """
    failed = before.shown - after.shown
    if not failed or after.shown - before.shown:
        return after
    for replaced, rivals in after.exchanges:
        if not rivals & failed:
            continue
        single = len(rivals) == 1 or any(are_parts(rivals, term) for term in replaced)
        if single and not _no_other_rival_likelier(rivals, replaced, after.compared_sets):
            continue
        found = after.found - rivals
        for term in ordered(replaced):
            found = with_term(found, term) if can_join(found, term) else found
        if rivals - failed:
            # The other rivals leave the set, too, by the same result of a gate.
            for term in ordered(rivals & failed):
                last_result = context.record.results_of(term.effect_joint)[-1:]
                context.record.add_failed(rivals - failed, *last_result, replaced_by=replaced)
        causes = frozenset(term.effect_joint for term in rivals & failed)
        displaced = after.displaced - {term.effect_joint for term in replaced}
        return replace(
            after.with_others(found),
            barred=after.barred if single else after.barred | causes,
            displaced=displaced | causes if single else displaced,
            exchanges=tuple(pair for pair in after.exchanges if pair[1] != rivals),
        )
    return after


def _no_other_rival_likelier(
    rivals: frozenset[Term], replaced: frozenset[Term], compared_sets: tuple[ShownEffects, ...]
) -> bool:
    """True if no other rival was more probable than an effect that ``rivals`` replaced, when last compared."""
    causes = {term.effect_joint for term in rivals}
    for shown in reversed(compared_sets):
        compared = replaced & shown.comparisons.keys()
        if compared:
            return not any(
                rival.probability > shown.comparisons[term].probability
                and {(one.effect, one.joint) for one in rival.effects} != causes
                for term in compared
                for rival in shown.comparisons[term].rivals
            )
    return True


def _without_worst(
    context: GateContext, state: LoopState, results: dict[Term, GateResult], without: _Removal
) -> LoopState:
    """The state after ``without`` has removed the effect that fails a gate worst, if any; results are recorded."""
    for term, result in results.items():
        if result.passed:
            context.record.add_passed([term], result)
    worst = worst_failure(results)
    if worst is None:
        return state
    after, replacements = without(state, worst)
    context.record.add_failed([worst], results[worst], replaced_by=replacements)
    return after


def _hide(state: LoopState, term: Term) -> tuple[LoopState, Iterable[Term]]:
    """The state in which an effect is no longer shown, but remains in the set in which rivals are compared."""
    return replace(state, shown=state.shown - {term}), ()


def _motion_gate(context: GateContext, state: LoopState) -> LoopState:
    """The state after the gate `shown_by_motion`: is an effect visible where the motion is far above the noise?"""
    if not any(depends_on_acceleration(term) for term in state.shown):
        return state
    search, terms = context.with_strong_motion(state.found | state.shown)
    return _without_worst(context, state, motion_results(search, terms, state.shown), _hide)


def _closing_gate(context: GateContext, state: LoopState) -> LoopState:
    """The state after the gate `closes_for_sure`: does an effect close a part of the gap for sure?

    An effect that fails is replaced by its most probable rival that passes, if there is one.
    """
    if not state.shown:
        return state
    squares_of = context.subset_residuals(state.found | state.shown)
    sound = context.residuals.judged_band_of(state.shown).sound_residual
    least_shares = least_shares_closed(squares_of, state.shown, sound)
    named = frozenset(term for term in state.shown if term.named)
    if named != state.shown:
        # Structures without a name are not in the corrected model. An effect that closes the gap only together with
        # such a structure would enlarge the gap of the corrected model.
        without_structures = least_shares_closed(squares_of, named, sound)
        least_shares = {term: min(share, without_structures.get(term, share)) for term, share in least_shares.items()}

    def without(state: LoopState, term: Term) -> tuple[LoopState, Iterable[Term]]:
        # An effect that closes a part of the gap, but not for sure, may be the wrong law on the right joint: its rivals
        # are tested, once.
        closes_some = least_shares[term] > -1.0 and term.named and term in state.found
        if not closes_some or term.effect_joint in state.compared:
            return _hide(state, term)
        state = replace(state, compared=state.compared | {term.effect_joint})
        rival_set = _rival_that_closes(context, state, term)
        if rival_set is None:
            return _hide(state, term)
        rivals = rival_set - state.found
        shown, displaced = (state.shown & rival_set) | rivals, state.displaced | {term.effect_joint}
        return replace(state, found=rival_set, shown=shown, displaced=displaced), rivals

    results = {term: closes_for_sure(share) for term, share in least_shares.items()}
    return _without_worst(context, state, results, without)


def _comparison_with_rivals(context: GateContext, state: LoopState, term: Term) -> RivalComparison:
    """Comparison of a finding with its rivals, also under other conditions that should not change the result."""
    increases = strong_motion_loss_increases(context, state.found, term, state.barred)
    return compare_with_rivals(context.search, state.found, term, state.barred, context.other_conditions, increases)


def _rival_that_closes(context: GateContext, state: LoopState, term: Term) -> frozenset[Term] | None:
    """The set with the most probable rival that passes the gate `closes_for_sure`; None if no rival passes."""
    comparison = _comparison_with_rivals(context, state, term)
    for found, _ in sorted(comparison.rival_sets, key=lambda rival_set: -rival_set[1]):
        rivals = found - state.found
        if not state.displaced.isdisjoint(rival.effect_joint for rival in rivals):
            continue
        sound = context.residuals.judged_band_of(found).sound_residual
        least_shares = least_shares_closed(context.subset_residuals(found), found, sound)
        if all(closes_for_sure(least_shares.get(rival, 0.0)).passed for rival in rivals):
            return found
    return None


def _noise_gate(context: GateContext, state: LoopState) -> LoopState:
    """The state after the gate `shown_above_noise`: is an effect that noise may imitate more than noise?"""
    # A barred effect is in the set only if it replaced another law as its special case. It has failed a gate before.
    imitable = [
        term for term in ordered(state.shown) if noise_may_imitate(term) and term.effect_joint not in state.barred
    ]
    if not imitable:
        return state
    results: dict[Term, GateResult] = {}
    residual = np.maximum(residual_sums_with(context.plain, state.shown).rms(), 1e-300)
    for term in imitable:
        others = state.shown - {term}
        growth = (residual_sums_with(context.plain, others).rms() / residual) ** 2 - 1.0
        over_allowed = partial(context.residuals.over_allowed, others)
        has_structure = partial(context.residuals.has_structure, others)
        in_highest_noise = partial(gain_in_highest_noise, context, state.shown, term)
        results[term] = shown_above_noise(growth, over_allowed, has_structure, in_highest_noise)
    return _without_worst(context, state, results, _bar)


def _bar(state: LoopState, term: Term) -> tuple[LoopState, Iterable[Term]]:
    """The state without an effect, in all its shapes, which is also excluded as a rival."""
    found = frozenset(other for other in state.found if other.effect_joint != term.effect_joint)
    return replace(state, found=found, shown=state.shown & found, barred=state.barred | {term.effect_joint}), ()


def _simpler_law_gate(context: GateContext, state: LoopState) -> LoopState:
    """The state after the gate `differs_from_simpler`: does an effect differ from zero or from a simpler law?

    An effect that fails is removed, or replaced by the simpler law. The gate is applied to the plain fit, and then, if
    the effect fails in comparison with a simpler law, to the whitened fit.
    """
    robot, fitted = context.plain.problem.session.robot, context.fit(state.shown)
    whitened = context.search.held_out_fit(state.found)
    nearest = ((term, nearest_case(robot, term, fitted)) for term in ordered(state.shown) if term.named)
    cases = {term: case for term, case in nearest if case is not None}

    def result(term: Term, certain: float, laws: Iterable[str]) -> GateResult:
        if laws:
            return differs_from_simpler(certain, effect_is_certain=True)
        strict = differs_from_simpler(certain, effect_is_certain=False)
        if strict.passed or not differs_from_simpler(certain, effect_is_certain=True).passed:
            return strict
        return differs_from_simpler(certain, closes_certain_gap(context, state.shown, term))

    results = {term: result(term, certain, laws) for term, (certain, laws) in cases.items()}
    for term, (certain, laws) in cases.items():
        uncertain = not results[term].passed and laws and certain > 0.0 and term in state.found
        if uncertain and simplest_effects(robot, term, whitened) == (term.effect_joint,):
            case = nearest_case_at_shape(robot, term, whitened, laws)
            # None if the simpler law is a limit of the shape, which is constant in this fit.
            if case is not None:
                results[term] = result(term, *case)

    def without(state: LoopState, term: Term) -> tuple[LoopState, Iterable[Term]]:
        shown, (_, laws) = state.shown - {term}, cases[term]
        if not laws:
            return replace(state, shown=shown), ()
        simpler = [other for other in context.plain.terms if other.effect.name in laws and other.joint == term.joint]
        found = with_replacement(state.found, term, frozenset(simpler))
        for other in simpler:
            shown = with_term(shown, other) if can_join(shown, other) else shown
        return replace(state, found=found, shown=shown, barred=state.barred | {term.effect_joint}), shown - state.shown

    return _without_worst(context, state, results, without)


def _missing_part_gate(context: GateContext, state: LoopState) -> LoopState:
    """The state after the gate `more_than_a_missing_part`: do inertial parameters express only an absent part?

    Inertial parameters that fail are replaced by a payload, which may be negative.
    """
    shares = missing_part_shares(context.plain, state.shown, context.fit(state.shown))

    def without(state: LoopState, term: Term) -> tuple[LoopState, Iterable[Term]]:
        payload = payload_term(context.plain)
        assert payload is not None
        shown, found = (with_replacement(terms, term, frozenset([payload])) for terms in (state.shown, state.found))
        barred = state.barred | {term.effect_joint} | bodies_expressing_part(context.search, found, payload)
        return replace(state, found=found, shown=shown, barred=barred), [payload]

    results = {term: more_than_a_missing_part(share) for term, share in shares.items()}
    return _without_worst(context, state, results, without)


def _rival_gate(context: GateContext, state: LoopState) -> LoopState:
    """The state after the comparison of all findings with their rivals.

    More probable rivals replace findings, as long as this leads to a new set. Otherwise the result is reached.
    """
    state = replace(state, found=state.found - hidden_twins(state.found, state.shown))
    named = [term for term in ordered(state.shown) if term.named]
    comparisons = {term: _comparison_with_rivals(context, state, term) for term in named}
    shown = ShownEffects(context.plain.of(state.shown), state.shown, context.fit(state.shown), comparisons, state.found)
    compared_sets = (*state.compared_sets, shown)
    replacements = [each.leading_set for each in comparisons.values() if each.leading_set is not None]
    found = with_replacements(state.found, replacements, set(state.displaced))
    finished = not replacements or found == state.found or len(compared_sets) == _MOST_COMPARED_SETS
    if finished and replacements:
        # In each set a rival is more probable than a finding: take the set in which a rival leads by least.
        result_set = min(compared_sets, key=_largest_lead)
        for term in ordered(frozenset(named) - result_set.chosen):
            best_rival = max((rival.probability for rival in comparisons[term].rivals), default=0.0)
            result = likelier_than_rivals(comparisons[term].probability, best_rival, leads=False)
            context.record.add_failed([term], result, replaced_by=result_set.chosen - state.shown)
        comparisons, compared_sets = result_set.comparisons, (*compared_sets, result_set)
    if finished:
        comparisons = {term: with_equal_probabilities(each) for term, each in comparisons.items()}
        comparisons = _weighed_with_structures(context, compared_sets[-1].all_found, comparisons)
    for term, comparison in comparisons.items():
        if finished or term in found:
            context.record.add_passed([term], *comparison.gates)
        else:
            context.record.add_failed([term], *comparison.gates, replaced_by=found - state.found)
    if finished:
        last = replace(compared_sets[-1], comparisons=comparisons)
        return replace(state, shown=last.chosen, compared_sets=(*compared_sets, last), done=True)
    displaced = state.displaced | {term.effect_joint for term in state.found - found}
    exchanges = (*state.exchanges, (state.found - found, found - state.found))
    return replace(state.with_others(found), displaced=displaced, exchanges=exchanges, compared_sets=compared_sets)


def _weighed_with_structures(
    context: GateContext, found: frozenset[Term], comparisons: dict[Term, RivalComparison]
) -> dict[Term, RivalComparison]:
    """The comparisons of a set, with lower probabilities if a cause outside the catalogue may fit as well."""
    search, conditions = context.search, context.other_conditions
    return {term: weighed_with_structures(search, found, term, each, conditions) for term, each in comparisons.items()}


def with_replacements(
    chosen: frozenset[Term], replacements: list[frozenset[Term]], displaced: set[EffectJoint]
) -> frozenset[Term]:
    """The set after several replacements, each given as the set after it alone; ``displaced`` effects do not return.

    Of two replacements on the same joint only the first is made; the second is compared again in the new set. A
    replacement that concerns the whole robot is made only if it is the first, and then it is the only one.
    """
    out, changed = chosen, set[str | None]()
    for replacement in replacements:
        joints = {term.joint for term in chosen ^ replacement}
        whole_robot = None in joints | changed
        separate = not changed if whole_robot else joints.isdisjoint(changed)
        if separate and displaced.isdisjoint(term.effect_joint for term in replacement - chosen):
            out, changed = (out - (chosen - replacement)) | (replacement - chosen), changed | joints
    return out


def _largest_lead(shown: ShownEffects) -> float:
    """Largest lead of a rival over its finding in a set, in probability; zero if no rival leads."""
    return max(
        (
            one.rivals[0].probability - one.probability if one.leading_set is not None else 0.0
            for one in shown.comparisons.values()
        ),
        default=0.0,
    )


def with_equal_probabilities(comparison: RivalComparison) -> RivalComparison:
    """The comparison in which a finding and its more probable rivals have equal probabilities.

    Such rivals cannot replace the finding: the resulting set was compared before, or their sizes are implausible.
    """
    if all(rival.probability <= comparison.probability for rival in comparison.rivals):
        return comparison
    shares = [comparison.probability]
    for rival in comparison.rivals:
        if rival.probability > np.mean(shares):
            shares.append(rival.probability)
    equal, count = float(np.mean(shares)), len(shares) - 1
    equal_rivals = (replace(rival, probability=equal) for rival in comparison.rivals[:count])
    gates = (likelier_than_rivals(equal, equal, leads=True),)
    rivals = (*equal_rivals, *comparison.rivals[count:])
    return replace(comparison, probability=equal, rivals=rivals, leading_set=None, gates=gates)
