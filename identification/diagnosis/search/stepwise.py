"""Stepwise search for the set of effects that explains the recordings.

Effects are added in the order of their held-out gain, removed once they are needless, and swapped for simpler or better
ones. Then structures without a name, which match no effect of the catalogue, are added to the set, or replace effects
that only resemble them.
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
    rows_touched_by,
)
from identification.diagnosis.search.containment import can_join, is_beside_parts, is_of_many_joints, with_term
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.search import Search, price
from identification.diagnosis.search.swaps import parts_of, with_simpler_laws, with_swaps
from identification.engine.claims import GateResult
from identification.gates import above_chance, exchange
from identification.gates.above_chance import more_than_chance
from identification.gates.exchange import explains_more_than_others
from identification.stages import Announcement, Progress, Stage

# Largest number of rivals that one step tests on held-out data: those with the largest in-sample gains.
_MOST_JUDGED = 24
# The same for rivals of which the best one nearly always has a large in-sample gain: effects below the threshold of
# chance, structures without a name, and effects with which a search begins again where a joint moves in one sine.
_FEW_JUDGED = 8
# Largest number of joints of a robot for which a search begins again.
_MOST_JOINTS_BEGUN = 3
# Largest number of structures without a name in a set.
_MOST_NAMELESS = 4


def stepwise_search(search: Search, progress: Progress, start: frozenset[Term] = frozenset()) -> frozenset[Term]:
    """The set of effects that explains the recordings with the fewest parameters.

    Free inertial parameters of all links explain a little of any missing effect. So the search finds the other effects
    first. If free inertial parameters alone explain more than all found effects together, they replace these, and the
    search goes on from there. On a robot of many joints gains of torque constants are tested last, too, because a fit
    with one takes many times as long.

    Args:
        search: Problem, rivals, threshold.
        progress: Is called at the beginning of each stage.
        start: Effects that an earlier search has found.
    """
    # The laws of these effects were linearised again, so swaps come first: beside a law that is now the wrong one,
    # effects would be added that only correct its errors.
    chosen = with_swaps(search, backward_elimination(search, frozenset(term for term in start if term.named)))
    bodies = next((term for term in search.terms if term.effect.inertial == "free" and term.joint is None), None)
    gains = {term for term in search.terms if search.many_joints and term.effect.scales_joint}
    if bodies is not None or gains:
        chosen = _improved_without(search, gains | {bodies}, chosen, progress)
    if bodies is not None and bodies not in chosen:
        alone = search.alone[bodies]
        # Held-out losses take longer, so they are computed only if bodies are better in sample.
        of_bodies, of_others = (search.in_sample_loss(one) + search.price_of(one) for one in (alone, chosen))
        if of_bodies < of_others:
            stays = explains_more_than_others(search.score(alone) - search.score(chosen), -exchange.ROUNDING)
            if not stays.passed:
                search.record.add_failed(chosen, stays, replaced_by=[bodies])
                search.record.add_passed([bodies])
                chosen = alone
    if bodies is not None and gains:
        chosen = _improved_without(search, gains, chosen, progress)
    chosen = _with_other_starts(search, _improved(search, chosen, progress), progress)
    return with_nameless(search, chosen, progress)


def _improved_without(
    search: Search, late: Collection[Term | None], chosen: frozenset[Term], progress: Progress
) -> frozenset[Term]:
    """The set that `_improved` finds without the effects ``late``; ``chosen`` itself if it contains one of them."""
    if not chosen.isdisjoint(late):
        return chosen
    return _improved(replace(search, terms=tuple(term for term in search.terms if term not in late)), chosen, progress)


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

    In one sine the torque of a joint consists of two numbers: its parts in phase and out of phase with the motion. Two
    true effects may make one part each. A wrong effect that makes both parts then gains most by itself, and the true
    effects gain nothing beside it.
    """
    sines = search.problem.session.in_one_sine
    if not sines or len(search.problem.columns.rows) > _MOST_JOINTS_BEGUN:
        return chosen
    named = tuple(
        term for term in search.terms if term.named and not sines.isdisjoint(rows_touched_by(search.problem, term))
    )
    gains = search.gains(frozenset(), named)
    first: dict[EffectJoint, Term] = {}
    for term in sorted(named, key=lambda term: -gains[term]):
        first.setdefault(term.effect_joint, term)
    best = chosen
    for term in [*first.values()][:_FEW_JUDGED]:
        if term in chosen:
            continue
        trial = replace(search, record=search.record.copy_for_trial())
        tried = backward_elimination(trial, forward_selection(trial, search.alone[term], progress))
        stays = explains_more_than_others(search.score(tried) - search.score(best), -exchange.ROUNDING)
        if not stays.passed:
            search.record.take_over(trial.record)
            search.record.add_failed(best - tried, stays, replaced_by=tried - best)
            best = tried
    return best


def best_below_threshold(search: Search, chosen: frozenset[Term]) -> frozenset[Term] | None:
    """The set with one more named effect, the one with the best score, if its score is better than without; else None.

    Such an effect gains more than its price, but need not exceed the threshold of chance.
    """
    rivals = tuple(term for term in search.terms if term.named and search.can_join(chosen, term))
    promised = search.gains(chosen, rivals, above=0.0)
    best = sorted(rivals, key=lambda term: -promised[term])[:_FEW_JUDGED]
    worth = [with_term(chosen, term) for term in best if _beats_small_parts(search, chosen, term)]
    tried = min(worth, key=search.score, default=None)
    return tried if tried is not None and search.score(tried) < search.score(chosen) else None


def forward_selection(search: Search, chosen: frozenset[Term], progress: Progress) -> frozenset[Term]:
    """Forward selection: add the effect with the largest held-out gain until none gains more than chance.

    A gain in sample is larger than on held-out data. So rivals are tested on held-out data in the order of their gains
    in sample, until no further one can be better than the best so far. An added effect may make earlier ones
    unnecessary, and once they are removed it may be unnecessary itself. If a set repeats for this reason, the best set
    of the cycle is returned.
    """
    seen = [chosen]
    while True:
        progress(Announcement(Stage.RIVALS_TRIED, detail={"found": len(chosen)}))
        base = search.score(chosen)
        rivals = [term for term in search.terms if term.named and search.can_join(chosen, term)]
        promised = search.gains(chosen, tuple(rivals), above=0.0)
        best, most = None, 0.0
        ranked = sorted(rivals, key=lambda term: -promised[term])
        for term in ranked[:_MOST_JUDGED]:
            if promised[term] < most:
                break
            # The threshold of chance applies to the gain before the price is subtracted.
            if not more_than_chance(promised[term] + price(search.sizes[term]), search.threshold.of(term)).passed:
                continue
            gain = base - search.score(with_term(chosen, term))
            if not explains_more_than_others(gain, most).passed or not _beats_small_parts(search, chosen, term):
                continue
            if passes_gates(search, with_term(chosen, term), chosen):
                best, most = term, gain
        if best is None:
            return chosen
        chosen = _with_claimed(search, chosen, best)
        if search.many_joints:
            chosen = _with_other_joints(search, chosen, best, ranked)
        chosen = backward_elimination(search, chosen)
        if chosen in seen:
            return min(seen[seen.index(chosen) :], key=search.score)
        seen.append(chosen)


def _with_other_joints(search: Search, chosen: frozenset[Term], best: Term, ranked: list[Term]) -> frozenset[Term]:
    """The set with the most promising effect of each further joint that passes the gates of a claim.

    Free inertial parameters explain a little of any missing effect, so they are added only as the best effect of a
    step. The same holds for gains of torque constants, because a fit with one takes many times as long.

    Args:
        search: Rivals.
        chosen: The set with the best effect of this step.
        best: That effect.
        ranked: Rivals, the most promising first.
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
    """The set with a claimed effect, without those that it replaces; both are recorded."""
    together = with_term(chosen, term)
    margin = search.score(chosen) - search.score(together)
    search.record.add_failed(chosen - together, explains_more_than_others(-margin), replaced_by=[term])
    search.record.add_passed([term], *gate_results(search, together, chosen), explains_more_than_others(margin))
    return together


def _by_single_effects(search: Search, chosen: frozenset[Term], progress: Progress) -> frozenset[Term]:
    """The set with effects of single joints in place of a law of many joints, if they explain more.

    A law with more parameters than the robot has joints gains most at first, because it explains a little of every
    effect: free inertial parameters explain wrong rotor inertias on all joints. One torque constant for several joints
    also explains wrong friction on all of them. No swap of one effect for another removes such a law, so the search is
    repeated without it. A common torque constant is compared with friction on all of its joints, even where the
    friction of one joint is too small for a claim.
    """
    for term in ordered(chosen):
        rows = search.problem.columns.rows
        if search.sizes[term] <= len(rows) and not is_of_many_joints(term):
            continue
        others = tuple(other for other in search.terms if other.effect is not term.effect)
        without = replace(search, terms=others, record=search.record.copy_for_trial())
        tried = with_swaps(
            without, backward_elimination(without, forward_selection(without, chosen - {term}, progress))
        )
        several = [tried] if search.sizes[term] > len(rows) else [tried, _with_small_parts(without, tried, term)]
        margin = min(search.score(one) for one in several) - search.score(chosen)
        # Many sets were tried, so a small margin may be chance.
        stays = explains_more_than_others(margin, -above_chance.PARAMETER_PRICE)
        if not stays.passed:
            search.record.take_over(without.record)
            search.record.add_failed([term], stays, replaced_by=tried - chosen)
            chosen = tried
        else:
            # The effects of the trial are recorded as failed: they explain no more than the law.
            explains = explains_more_than_others(-margin, above_chance.PARAMETER_PRICE)
            search.record.add_failed(tried - chosen, explains, replaced_by=[term])
    return chosen


def _beats_small_parts(search: Search, chosen: frozenset[Term], term: Term) -> bool:
    """False for an effect with one parameter for several joints that gains no more than its parts on these joints.

    Its gain may come from friction that is too small for a claim on each single joint.
    """
    if not is_beside_parts(chosen, term):
        return True
    parts = _with_small_parts(search, chosen, term)
    gain = search.score(parts) - search.score(with_term(chosen, term))
    return more_than_chance(gain, search.threshold.of(term)).passed


def _with_small_parts(search: Search, chosen: frozenset[Term], term: Term) -> frozenset[Term]:
    """The set plus all effects of single joints whose sum makes nearly the same torque as a law of these joints."""
    for part in parts_of(search, term):
        if part.joint is not None and can_join(chosen, part):
            chosen = with_term(chosen, part)
    return chosen


def with_nameless(search: Search, chosen: frozenset[Term], progress: Progress) -> frozenset[Term]:
    """The set with structures outside the catalogue, added to named effects or in place of them.

    A structure has to gain as much as any claim beyond the best set of named effects; effects that it makes unnecessary
    are then removed. A structure with fewer parameters may replace several effects, except where a joint moves in one
    sine: there a structure with two parameters can make any torque.
    """
    sines = search.problem.session.in_one_sine
    progress(Announcement(Stage.NAMELESS))
    accuracy = exchange.NAMELESS_ACCURACY * max(search.score(frozenset()) - search.score(chosen), 0.0)
    nameless = tuple(term for term in search.terms if not term.named)
    for _ in range(_MOST_NAMELESS):
        better: dict[frozenset[Term], GateResult] = {}
        # A structure is added to all effects, and also to the nameless ones alone; then needed effects are added again.
        for base in dict.fromkeys((chosen, frozenset(term for term in chosen if not term.named))):
            promised = search.gains(base, nameless, above=search.threshold.overall)
            for term in sorted(nameless, key=lambda term: -promised[term])[:_FEW_JUDGED]:
                if not more_than_chance(promised[term], search.threshold.overall).passed or not can_join(base, term):
                    continue
                tried = _with_needed_only(search, term, base, chosen)
                # The present set stays unless the set with the structure has a score that is lower by ``needed``.
                in_one_sine = not sines.isdisjoint(rows_touched_by(search.problem, term))
                needed = _least_nameless_gain(search, term, chosen - tried, accuracy, in_one_sine=in_one_sine)
                stays = explains_more_than_others(search.score(tried) - search.score(chosen), -needed)
                if not stays.passed and passes_gates(search, tried, tried - {term}):
                    better[tried] = stays
        if not better:
            return chosen
        before, chosen = chosen, min(better, key=search.score)
        search.record.add_failed(before - chosen, better[chosen], replaced_by=chosen - before)
    return chosen


def _count_of_causes(effects: frozenset[Term]) -> int:
    """Number of causes of several effects: one effect on many joints, or many effects on one joint, count as one."""
    return min(len({term.effect for term in effects}), len({term.joint for term in effects}))


def _least_nameless_gain(
    search: Search, structure: Term, replaced: frozenset[Term], accuracy: float, *, in_one_sine: bool
) -> float:
    """Least decrease of the score by a nameless structure if it makes some effects unnecessary.

    It is zero if several effects together have more parameters than the structure: then they probably imitate it.

    Args:
        search: Rivals.
        structure: A structure outside the catalogue.
        replaced: Effects that the structure makes unnecessary.
        accuracy: Gain that the structure may owe to inaccuracies of the laws that it replaces.
        in_one_sine: True if the joint of the structure moves in one sine, where two parameters can make any torque.
    """
    simpler = not structure.shape and search.sizes[structure] < search.sizes_of(replaced)
    if simpler and len(replaced) > 1 and not in_one_sine:
        return 0.0
    gone = min(_count_of_causes(replaced), 1 if in_one_sine else len(exchange.NAMELESS_MARGIN) - 1)
    return exchange.NAMELESS_MARGIN[gone] * search.threshold.overall + (accuracy if gone in (1, 2) else 0.0)


def _with_needed_only(
    search: Search, structure: Term, base: frozenset[Term], chosen: frozenset[Term]
) -> frozenset[Term]:
    """The set ``base`` with a structure, and with those named effects of ``chosen`` that are still needed.

    Effects on other joints count as needed without a test. If there are many effects on the structure's joints, only
    those are tested whose removal raises the loss least; the others count as needed.
    """
    rows = rows_touched_by(search.problem, structure)
    whole = with_term(chosen, structure)
    untested = whole.difference(least_needed(search, whole))
    needed = [
        term
        for term in ordered(chosen)
        if term.named and (term in untested or rows.isdisjoint(rows_touched_by(search.problem, term)))
    ]
    tried = with_term(base, structure)
    for term in needed:
        if can_join(tried, term):
            tried = with_term(tried, term)
    for term in ordered(chosen.difference(needed)):
        more = with_term(tried, term)
        if term.named and can_join(tried, term) and passes_gates(search, more, tried) and more >= tried:
            tried = more
    while True:
        tested = ordered(tried.difference(needed))
        needless = [term for term in tested if term.named and not passes_gates(search, tried, tried - {term})]
        if not needless:
            return tried
        tried = tried - {min(needless, key=lambda term: search.score(tried - {term}))}
