"""The loop of the judge: every gate is applied to all remaining effects, and the effect that fails worst is removed.

The search keeps shapes fixed and uses other weights than the fit that states sizes. So its result is tested again in
the band in which gaps are measured, gate by gate in the order of `identification.gates.GATES`, those of rivals last, as
they cost most. After each change the loop begins with the first gate again. All results are recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import residual_sums
from identification.diagnosis.judge.findings.bench import Bench, Shown, State
from identification.diagnosis.judge.findings.missing_parts import (
    bodies_expressing_part,
    missing_part_shares,
    payload_term,
)
from identification.diagnosis.judge.findings.outside_catalogue import beside_structures
from identification.diagnosis.judge.findings.timing_rivals import losses_beyond
from identification.diagnosis.judge.moved_by_noise import (
    depends_on_acceleration,
    motion_results,
    noise_may_imitate,
)
from identification.diagnosis.judge.shares import least_shares_closed, residual_sums_with
from identification.diagnosis.search.containment import are_parts, can_join, with_term
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.rival_sets import RivalComparison, compare_with_rivals
from identification.diagnosis.search.special_cases import nearest_case, nearest_case_at_shape, simplest_effects
from identification.diagnosis.search.swaps import with_replacement
from identification.engine import contract_levels
from identification.engine.claims import GateResult, fails_worst, until_nothing_changes
from identification.gates.in_band import closes_for_sure
from identification.gates.moved_joints import shown_above_noise
from identification.gates.rivalry import likelier_than_rivals
from identification.gates.special_case import differs_from_simpler, more_than_a_missing_part

# Largest number of sets that are compared if a rival is more probable in each; the set with the least excess is shown.
_MOST_LEADERS = 8

# Gives the state without an effect, and the effects that replace it.
_Removal = Callable[[State, Term], tuple[State, Iterable[Term]]]


def after_motion_gate(bench: Bench, state: State) -> State:
    """The state without effects that fail the gate `shown_by_motion`, the first gate of the judge."""
    return _until_all_pass(bench, state, (_motion_gate,))


def shown_effects(bench: Bench, state: State) -> Shown:
    """Effects that pass every gate of the judge.

    An effect that a rival has replaced does not come back while that rival is in the set. It may happen that in every
    set a rival is more probable than a finding. Then the set with the smallest excess is shown, and the finding and its
    rival get equal probabilities.
    """
    steps = (
        _motion_gate,
        _closing_gate,
        _noise_gate,
        _simpler_law_gate,
        _missing_part_gate,
        _rival_gate,
    )
    return _until_all_pass(bench, state, steps).compared_sets[-1]


def _until_all_pass(bench: Bench, state: State, steps: tuple[Callable[[Bench, State], State], ...]) -> State:
    """The state after all steps, repeated until a whole round changes nothing."""

    def unless_done(step: Callable[[Bench, State], State]) -> Callable[[State], State]:
        return lambda now: now if now.done else _with_exchanges_undone(bench, now, step(bench, now))

    return until_nothing_changes(state, [unless_done(step) for step in steps])


def _with_exchanges_undone(bench: Bench, before: State, after: State) -> State:
    """The state with an exchange undone if one of its rivals has failed a gate: the effects that they replaced return.

    If several rivals replaced an effect and one of them has failed, the others alone may explain less than the effect.
    The effect returns, and the failed rival is barred. If a single rival replaced it, the failed rival may exist and be
    too small to be shown. The effect then returns only if no other rival was more probable, and the failed rival
    remains its rival with the same probability. Rivals that are parts of the effect count as a single rival.
    """
    fallen = before.shown - after.shown
    if not fallen or after.shown - before.shown:
        return after
    for gone, rivals in after.exchanges:
        single = len(rivals) == 1 or any(are_parts(rivals, term) for term in gone)
        if not rivals & fallen or (single and not _no_other_rival_likelier(rivals, gone, after.compared_sets)):
            continue
        found = after.found - rivals
        for term in ordered(gone):
            found = with_term(found, term) if can_join(found, term) else found
        causes = frozenset(term.effect_joint for term in rivals & fallen)
        for term in ordered(rivals & fallen) if rivals - fallen else ():
            bench.record.add_failed(rivals - fallen, *bench.record.results_of(term.effect_joint)[-1:], replaced_by=gone)
        displaced = after.displaced - {term.effect_joint for term in gone}
        return replace(
            after.with_others(found),
            barred=after.barred if single else after.barred | causes,
            displaced=displaced | causes if single else displaced,
            exchanges=tuple(pair for pair in after.exchanges if pair[1] != rivals),
        )
    return after


def _no_other_rival_likelier(rivals: frozenset[Term], gone: frozenset[Term], compared_sets: tuple[Shown, ...]) -> bool:
    """True if no rival other than these was more probable than an effect that they replaced."""
    causes = {term.effect_joint for term in rivals}
    comparisons = next((shown.comparisons for shown in reversed(compared_sets) if gone & shown.comparisons.keys()), {})
    return not any(
        rival.probability > comparison.probability and {(e.effect, e.joint) for e in rival.effects} != causes
        for comparison in (comparisons[term] for term in gone & comparisons.keys())
        for rival in comparison.rivals
    )


def _without_worst(bench: Bench, state: State, results: dict[Term, GateResult], without: _Removal) -> State:
    """The state without the effect that fails a gate worst; the same state if all pass. Results are recorded."""
    for term, result in results.items():
        if result.passed:
            bench.record.add_passed([term], result)
    worst = fails_worst(results)
    if worst is None:
        return state
    after, replacements = without(state, worst)
    bench.record.add_failed([worst], results[worst], replaced_by=replacements)
    return after


def _hide(state: State, term: Term) -> tuple[State, Iterable[Term]]:
    """The state without an effect that is too small to be shown; rivals are still compared with it in the set."""
    return replace(state, shown=state.shown - {term}), ()


def _motion_gate(bench: Bench, state: State) -> State:
    """The state without the effect that gains least where the motion is far above the noise."""
    if not any(depends_on_acceleration(term) for term in state.shown):
        return state
    search, terms = bench.with_strong_motion(state.found | state.shown)
    return _without_worst(bench, state, motion_results(search, terms, state.shown), _hide)


def _closing_gate(bench: Bench, state: State) -> State:
    """The state without the effect that fails the gate `closes_for_sure` worst; a rival that passes replaces it."""
    if not state.shown:
        return state
    squares_of, sound = bench.subset_residuals(state.found | state.shown), bench.residuals.judge_of(state.shown).sound
    least_shares = least_shares_closed(squares_of, state.shown, sound)
    named = frozenset(term for term in state.shown if term.named)
    if named != state.shown:
        # Structures without a name are not in the corrected model. An effect that closes the gap only with such a
        # structure would enlarge the gap of the corrected model.
        beside_named = least_shares_closed(squares_of, named, sound)
        least_shares = {term: min(share, beside_named.get(term, share)) for term, share in least_shares.items()}

    def without(state: State, term: Term) -> tuple[State, Iterable[Term]]:
        # An effect that closes some of the gap, but not everywhere, may be the wrong law of the right joint.
        closes = least_shares[term] > -1.0 and term.named and term in state.found
        if not closes or term.effect_joint in state.compared:
            return _hide(state, term)
        state = replace(state, compared=state.compared | {term.effect_joint})
        rival_set = _rival_that_closes(bench, state, term)
        if rival_set is None:
            return _hide(state, term)
        rivals = rival_set - state.found
        shown, displaced = (state.shown & rival_set) | rivals, state.displaced | {term.effect_joint}
        return replace(state, found=rival_set, shown=shown, displaced=displaced), rivals

    return _without_worst(bench, state, {term: closes_for_sure(share) for term, share in least_shares.items()}, without)


def _compared(bench: Bench, state: State, term: Term) -> RivalComparison:
    """Comparison of a finding with its rivals, under all conditions that should not change the result."""
    beyond = losses_beyond(bench, state.found, term, state.barred)
    return compare_with_rivals(bench.search, state.found, term, state.barred, bench.other_conditions, beyond)


def _rival_that_closes(bench: Bench, state: State, term: Term) -> frozenset[Term] | None:
    """The set with the most probable rival of an effect that passes the gate `closes_for_sure`; None if none does."""
    comparison = _compared(bench, state, term)
    for found, _ in sorted(comparison.rival_sets, key=lambda rival_set: -rival_set[1]):
        rivals = found - state.found
        if not state.displaced.isdisjoint(rival.effect_joint for rival in rivals):
            continue
        sound = bench.residuals.judge_of(found).sound
        least_shares = least_shares_closed(bench.subset_residuals(found), found, sound)
        if all(closes_for_sure(least_shares.get(rival, 0.0)).passed for rival in rivals):
            return found
    return None


def _noise_gate(bench: Bench, state: State) -> State:
    """The state without the effect that noise may imitate and without which there would be no gap."""
    # A barred effect is in the set only as the special case of another law, and it has failed a gate before.
    imitable = [
        term for term in ordered(state.shown) if noise_may_imitate(term) and term.effect_joint not in state.barred
    ]
    if not imitable:
        return state
    results: dict[Term, GateResult] = {}
    residual = np.maximum(residual_sums_with(bench.plain, state.shown).rms(), 1e-300)
    for term in imitable:
        others = state.shown - {term}
        growth = (residual_sums_with(bench.plain, others).rms() / residual) ** 2 - 1.0
        over_allowed = partial(bench.residuals.over_allowed, others)
        has_structure = partial(bench.residuals.has_structure, others)
        in_highest_noise = partial(_gain_in_highest_noise, bench, state.shown, term)
        results[term] = shown_above_noise(growth, over_allowed, has_structure, in_highest_noise)
    return _without_worst(bench, state, results, _bar)


def _gain_in_highest_noise(bench: Bench, shown: frozenset[Term], term: Term) -> tuple[float, float]:
    """Gain of an effect in sample with the largest possible noise of each joint, and the gain by chance.

    Joints count that have a gap without the effect and none with it. Most of the largest possible noise is friction in
    doubt, which recurs with the motion: no chance limits what an effect gains of it. But its shape is hardly ever that
    of an effect, so that it leaves a gap. The fits are weighted by the noise that flexible fits leave, which may be too
    small.
    """
    fits, problem, others = bench.search.fits, bench.search.problem, shown - {term}
    weighted = residual_sums(problem, problem.session.in_judged_band(bench.noise)).rms()
    judge = bench.residuals.judge_of(others)
    has_gap, has_gap_with = (
        residual_sums_with(bench.plain, terms).rms()
        > contract_levels.FLOORS_LEFT * bench.residuals.judge_of(terms).floor
        for terms in (others, shown)
    )
    gains = np.where(has_gap & ~has_gap_with, fits.row_losses(others) - fits.row_losses(shown), 0.0)
    noise_ratio = weighted / np.maximum(np.maximum(judge.highest, weighted), 1e-300)
    return float(gains @ noise_ratio**2), bench.search.threshold.of(term)


def _bar(state: State, term: Term) -> tuple[State, Iterable[Term]]:
    """The state without an effect that noise may imitate, which is excluded as a rival, too."""
    found = frozenset(other for other in state.found if other.effect_joint != term.effect_joint)
    return replace(state, found=found, shown=state.shown & found, barred=state.barred | {term.effect_joint}), ()


def _simpler_law_gate(bench: Bench, state: State) -> State:
    """The state with an effect replaced by its special case, or removed, where neither fit distinguishes the two."""
    robot, fitted = bench.plain.problem.session.robot, bench.fit(state.shown)
    white = bench.search.held_out_fit(state.found)
    nearest = ((term, nearest_case(robot, term, fitted)) for term in ordered(state.shown) if term.named)
    cases = {term: case for term, case in nearest if case is not None}
    results = {term: differs_from_simpler(certain) for term, (certain, _) in cases.items()}
    for term, (certain, laws) in cases.items():
        uncertain = not results[term].passed and laws and certain > 0.0 and term in state.found
        if uncertain and simplest_effects(robot, term, white) == (term.effect_joint,):
            case = nearest_case_at_shape(robot, term, white, laws)
            # None if the simpler law has another shape: the shape is constant in this fit, which says nothing about it.
            if case is not None:
                results[term] = differs_from_simpler(case[0])

    def without(state: State, term: Term) -> tuple[State, Iterable[Term]]:
        shown, (_, laws) = state.shown - {term}, cases[term]
        if not laws:
            return replace(state, shown=shown), ()
        simpler = [other for other in bench.plain.terms if other.effect.name in laws and other.joint == term.joint]
        found = with_replacement(state.found, term, frozenset(simpler))
        for other in simpler:
            shown = with_term(shown, other) if can_join(shown, other) else shown
        return replace(state, found=found, shown=shown, barred=state.barred | {term.effect_joint}), shown - state.shown

    return _without_worst(bench, state, results, without)


def _missing_part_gate(bench: Bench, state: State) -> State:
    """The state with inertial parameters replaced by a payload, where they express the absence of a part."""
    shares = missing_part_shares(bench.plain, state.shown, bench.fit(state.shown))

    def without(state: State, term: Term) -> tuple[State, Iterable[Term]]:
        payload = payload_term(bench.plain)
        assert payload is not None
        shown, found = (with_replacement(terms, term, frozenset([payload])) for terms in (state.shown, state.found))
        barred = state.barred | {term.effect_joint} | bodies_expressing_part(bench.search, found, payload)
        return replace(state, found=found, shown=shown, barred=barred), [payload]

    results = {term: more_than_a_missing_part(share) for term, share in shares.items()}
    return _without_worst(bench, state, results, without)


def _rival_gate(bench: Bench, state: State) -> State:
    """The state with findings replaced by more probable rivals, as long as that leads to new sets."""
    named = [term for term in ordered(state.shown) if term.named]
    comparisons = {term: _compared(bench, state, term) for term in named}
    shown = Shown(bench.plain.of(state.shown), state.shown, bench.fit(state.shown), comparisons, state.found)
    compared_sets = (*state.compared_sets, shown)
    replacements = [each.leading_set for each in comparisons.values() if each.leading_set is not None]
    found = with_replacements(state.found, replacements, set(state.displaced))
    finished = not replacements or found == state.found or len(compared_sets) == _MOST_LEADERS
    if finished and replacements:
        least = min(compared_sets, key=lambda each: max(map(_lead_of_rival, each.comparisons.values()), default=0.0))
        for term in ordered(frozenset(named) - least.chosen):
            best_rival = max((rival.probability for rival in comparisons[term].rivals), default=0.0)
            result = likelier_than_rivals(comparisons[term].probability, best_rival, leads=False)
            bench.record.add_failed([term], result, replaced_by=least.chosen - state.shown)
        comparisons, compared_sets = least.comparisons, (*compared_sets, least)
    if finished:
        comparisons = {term: with_equal_probabilities(each) for term, each in comparisons.items()}
        comparisons = _beside_structures(bench, compared_sets[-1].all_found, comparisons)
    for term, comparison in comparisons.items():
        if finished or term in found:
            bench.record.add_passed([term], *comparison.gates)
        else:
            bench.record.add_failed([term], *comparison.gates, replaced_by=found - state.found)
    if finished:
        last = replace(compared_sets[-1], comparisons=comparisons)
        return replace(state, shown=last.chosen, compared_sets=(*compared_sets, last), done=True)
    displaced = state.displaced | {term.effect_joint for term in state.found - found}
    exchanges = (*state.exchanges, (state.found - found, found - state.found))
    return replace(state.with_others(found), displaced=displaced, exchanges=exchanges, compared_sets=compared_sets)


def _beside_structures(
    bench: Bench, found: frozenset[Term], comparisons: dict[Term, RivalComparison]
) -> dict[Term, RivalComparison]:
    """The comparisons of a set, with lower probabilities where a cause outside of the catalogue fits as well."""
    search, conditions = bench.search, bench.other_conditions
    return {term: beside_structures(search, found, term, each, conditions) for term, each in comparisons.items()}


def with_replacements(
    chosen: frozenset[Term], replacements: list[frozenset[Term]], displaced: set[EffectJoint]
) -> frozenset[Term]:
    """The set after all replacements on different joints that bring back no replaced effect.

    Of two replacements on the same joint only the first is made. The second is compared again with the new set.
    """
    out, changed = chosen, set[str | None]()
    for replacement in replacements:
        joints = {term.joint for term in chosen ^ replacement}
        separate = joints.isdisjoint(changed) and None not in changed and (None not in joints or not changed)
        if separate and displaced.isdisjoint(term.effect_joint for term in replacement - chosen):
            out, changed = (out - (chosen - replacement)) | (replacement - chosen), changed | joints
    return out


def _lead_of_rival(comparison: RivalComparison) -> float:
    """Probability of the best rival less that of the finding; zero if the rival is not more probable."""
    return comparison.rivals[0].probability - comparison.probability if comparison.leading_set is not None else 0.0


def with_equal_probabilities(comparison: RivalComparison) -> RivalComparison:
    """The comparison in which a finding and the rivals that are more probable than it have equal probabilities.

    Such rivals do not replace the finding, as that gives a set that was seen before, or their sizes are not plausible.
    """
    if all(rival.probability <= comparison.probability for rival in comparison.rivals):
        return comparison
    shares = [comparison.probability]
    for rival in comparison.rivals:
        if rival.probability > np.mean(shares):
            shares.append(rival.probability)
    even, above = float(np.mean(shares)), len(shares) - 1
    likelier = (replace(rival, probability=even) for rival in comparison.rivals[:above])
    gates = (likelier_than_rivals(even, even, leads=True),)
    rivals = (*likelier, *comparison.rivals[above:])
    return replace(comparison, probability=even, rivals=rivals, leading_set=None, gates=gates)
