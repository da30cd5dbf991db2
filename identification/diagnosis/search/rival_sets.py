"""Rivals of a finding: other sets of effects that explain the held-out data, with their probabilities."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.containment import are_parts, contains, has_parts, is_nested, scales_all_bodies
from identification.diagnosis.search.fair_costs import adds_up, costs_of, losses_in, within_accuracy
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.plausible_sizes import implausible
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.richer_laws import has_plausible_sizes, odds_of_richer, odds_of_richer_laws
from identification.diagnosis.search.search import IMPOSSIBLE, Search
from identification.diagnosis.search.special_cases import simplest_effects
from identification.diagnosis.search.swaps import explained, relevant, replaced, spanned
from identification.engine import contract_levels
from identification.engine.claims import GateResult, until_failed
from identification.engine.resampling import probabilities
from identification.gates import fair_part, rivalry
from identification.gates.rivalry import likelier_than_rivals, plausible_size
from phantom_dyn.array_types import Array, Float

NONE_BARRED: frozenset[EffectJoint] = frozenset()

# Largest share of what an implausible size explains that a plausible cause may leave.
_MOSTLY = 0.5
# Most passes over all findings.
_LOOKS = 3


@dataclass(frozen=True)
class RivalComparison:
    """Probabilities of a finding and of its rivals.

    Attributes:
        probability: Probability of the finding.
        rivals: The rivals with their probabilities, the most probable first.
        leading_set: The whole set with a rival that leads in the finding's place (the most probable of those with
            plausible sizes, or of all if none is plausible); None if the finding leads.
        gates: Results of the gates of rivals for the finding.
        rival_sets: Whole sets with a rival in the finding's place, each with its probability; without sets whose
            effects nearly cancel each other.
    """

    probability: float
    rivals: tuple[Rival, ...]
    leading_set: frozenset[Term] | None = None
    gates: tuple[GateResult, ...] = ()
    rival_sets: tuple[tuple[frozenset[Term], float], ...] = ()


def compare_with_rivals(
    search: Search,
    chosen: frozenset[Term],
    term: Term,
    barred: frozenset[EffectJoint] = NONE_BARRED,
    other_conditions: tuple[Search, ...] = (),
) -> RivalComparison:
    """Compare a finding with all effects and sets of effects that could replace it.

    In a robot that was diagnosed before, a new finding of an implausible size has the probability zero where other
    causes of plausible sizes explain most of it: the robot is known to be sound.

    An effect with more parameters that contains the finding is a rival only if these lower the held-out loss. It leads
    in a replicate only if they gain more there than their price and the errors of the method; equal predictions share a
    replicate. It need not pass the threshold of chance over the whole catalogue, as laws of one kind on one joint are
    few. Rivals that make the torque of the finding, and the other way round, are compared without prices: the number of
    parameters is no argument then. Losses of two laws, one of which has a shape, that differ by less than the errors of
    the method count as equal, unless the better one has fewer numbers.
    Of two laws of which neither contains the other, probabilities are means with and
    without prices: on held-out blocks a law already loses by parameters that fit noise. So are a law and a sum of
    effects that are its parts. A law that has come to a special case of itself counts as that case.

    Args:
        search: Rivals.
        chosen: A set of effects.
        term: One of them.
        barred: Laws, with their joints, that do not differ from a simpler one. As parts of a sum they may be rivals.
        other_conditions: Searches over the same rivals under conditions that should not matter, such as another band.
            If there are any, the comparison is repeated with each of them and on each half of the blocks, and
            probabilities are means over all of these.
    """
    base, diagnosed = search.evaluate(chosen), bool(search.problem.session.known)
    sound = has_plausible_sizes(search, chosen, frozenset([term]))
    options, names, richer_laws = _options(search, chosen, term, barred, other_conditions, sound=sound or not diagnosed)
    possible = {key for key in names if has_plausible_sizes(search, key, key - chosen)}
    if possible or sound:
        # An implausible size is left out where a plausible cause explains most of it.
        names = {key: others for key, others in names.items() if key in possible}
        options = {key: loss for key, loss in options.items() if key == chosen or key in names}
    if diagnosed and not sound and any(has_plausible_sizes(search, key, key) for key in possible):
        options[chosen] = options[chosen] + IMPOSSIBLE / len(base.loss)
    twins = {key for key in names if _same_in_data(search, term, chosen, names[key], key)}
    same = {}
    for others, swapped in _twins(search, chosen, term):
        options[swapped], same[swapped] = base.loss, chosen
        names[swapped] = others
    richer = odds_of_richer_laws(search, chosen, term, barred, richer_laws)
    if len(options) == 1 and not richer:
        return RivalComparison(1.0, (), gates=(likelier_than_rivals(1.0, 0.0, leads=True),))
    keys = list(options)
    apart = {key for key in names if not is_nested(term, names[key])}
    sets = [same.get(key, key) for key in keys]
    costs = costs_of(search, sets, [key in twins for key in keys])
    costs += costs_of(search, sets, [key in twins for key in keys], [key in apart for key in keys])
    effects = {key: _replacing_effects(search, chosen, names[key], key, same) for key in keys[1:]}
    # Laws without a shape are linear in their numbers, and have no errors of their own.
    alike = [key in apart and any(one.shape for one in (term, *names[key])) for key in keys]
    more = np.array([search.sizes_of(one) for one in sets], dtype=float)
    more -= more[0]
    losses = within_accuracy(np.array([options[key] for key in keys]).T, more, alike, explained(search, chosen, term))
    others = []
    for other in other_conditions:
        own, prices = losses_in(other, search, options, keys, same, (twins, apart))
        others.append((within_accuracy(own, more, alike, explained(other, chosen, term)), prices))
    shares = _by_effects(keys, effects, probabilities(losses, costs, others, by_halves=bool(other_conditions)))
    for causes, odds in richer.items():
        shares[causes] = max(shares.get(causes, 0.0), odds * shares[()])
    for swapped, others in names.items():
        # The same two sets have the same odds, whichever of them holds the finding.
        if effects[swapped] and all(contains(term, other) for other in others):
            same_sum = has_parts(term, {other.effect.name for other in others})
            odds = 1.0 if same_sum else min(odds_of_richer(search, swapped, chosen), 1.0)
            shares[()] = max(shares[()], odds * shares[effects[swapped]])
    own = shares[()]
    listed = min(contract_levels.LISTED, max(shares.values()))
    kept = {causes: share for causes, share in shares.items() if share >= listed and causes}
    # Odds of laws with more parameters are added to the shares, so that the sum may be above one.
    while kept and min(kept.values()) < contract_levels.LISTED * (own + sum(kept.values())):
        del kept[min(kept, key=lambda causes: kept[causes])]
    total = own + sum(kept.values())
    rivals = tuple(
        Rival(tuple(EffectAt(*cause) for cause in causes), share / total)
        for causes, share in sorted(kept.items(), key=lambda item: -item[1])
    )
    likely = {at: share / total for at, share in kept.items()}
    best_sets = _likeliest(search, chosen, term, likely, effects)
    leader, gates = _leader(search, chosen, term, own / total, likely, best_sets)
    rival_sets = tuple((key, likely[at]) for at, key in best_sets.items() if key not in same and adds_up(search, key))
    return RivalComparison(own / total, rivals, leader, gates, rival_sets)


def _options(
    search: Search,
    chosen: Chosen,
    term: Term,
    barred: frozenset[EffectJoint],
    other_conditions: tuple[Search, ...],
    *,
    sound: bool,
) -> tuple[dict[Chosen, Array], dict[Chosen, Chosen], list[Chosen]]:
    """Held-out losses, by block, of the set and of all sets with another cause in place of a finding.

    Sets that are far worse are left out, if they are so in the judged band, too: frequencies above that band have the
    same weight where noise is white, and a small error of the model there could exclude the true cause. The search with
    wider tolerances is not used for this: where these explain the whole gap, no set is far worse.

    Returns:
        Losses by set; for each set the effects in the finding's place; and laws with more parameters.
    """
    base, accuracy = search.evaluate(chosen), fair_part.ACCURACY * explained(search, chosen, term)
    options: dict[Chosen, Array] = {chosen: base.loss}
    names: dict[Chosen, Chosen] = {}
    richer_laws: list[Chosen] = []
    searches = (search, *(one for one in other_conditions if one.problem.white is not search.problem.white))
    slack = [rules.HOPELESS_LOSS if sound else _MOSTLY * explained(one, chosen, term) for one in searches]
    near = dict.fromkeys(
        others for one, own in zip(searches, slack, strict=True) for others in relevant(one, chosen, term, own)
    )
    for others in near:
        is_sum = len(others) > 1 and are_parts(others, term)
        allowed = is_sum or barred.isdisjoint(other.effect_joint for other in others)
        if not allowed or not all(other.named for other in others):
            continue
        swapped = replaced(chosen, term, others)
        if swapped in options or not others <= swapped:
            continue
        priced, both = is_nested(term, others), zip(searches, slack, strict=True)
        if all(
            _hopeless(one, chosen, swapped, priced=priced) if sound else one.quick(swapped) > one.quick(chosen) + own
            for one, own in both
        ):
            continue
        found = search.evaluate(swapped)
        if any(simplest_effects(search.problem.session.robot, other, found) is None for other in others):
            continue
        richer = any(contains(other, term) for other in others) and search.sizes_of(others) > search.sizes[term]
        if richer:
            richer_laws.append(others)
        if richer and found.total >= base.total:
            continue
        options[swapped] = found.loss + (accuracy / len(found.loss) if richer else 0.0)
        names[swapped] = others
    return options, names, richer_laws


def _replacing_effects(
    search: Search, chosen: Chosen, others: Chosen, swapped: Chosen, same: dict[Chosen, Chosen]
) -> tuple[EffectJoint, ...]:
    """Effects and joints that replace a finding; for a law that has come to a special case those of that case.

    None where these are the effects of the set with the finding.
    """
    if swapped in same:
        return tuple(other.effect_joint for other in ordered(others))
    robot, found = search.problem.session.robot, search.evaluate(swapped)
    effects = tuple(
        dict.fromkeys(cause for other in ordered(others) for cause in simplest_effects(robot, other, found) or ())
    )
    whole = {*effects, *(one.effect_joint for one in swapped - others)}
    return () if whole == {one.effect_joint for one in chosen} else effects


def _likeliest(
    search: Search,
    chosen: Chosen,
    term: Term,
    kept: dict[tuple[EffectJoint, ...], float],
    effects: dict[Chosen, tuple[EffectJoint, ...]],
) -> dict[tuple[EffectJoint, ...], Chosen]:
    """The best whole set of each rival in a finding's place."""
    best_sets: dict[tuple[EffectJoint, ...], Chosen] = {}
    for key in sorted(effects, key=search.score):
        # In place of a law that has come to a special case, the set with the case itself leads.
        known = {one.effect_joint for one in key - chosen} <= set(effects[key])
        if effects[key] in kept and effects[key] not in best_sets:
            leading = key if known else _with_effects(search, chosen, term, effects[key])
            best_sets |= {} if leading is None else {effects[key]: leading}
    return best_sets


def _leader(
    search: Search,
    chosen: Chosen,
    term: Term,
    own: float,
    kept: dict[tuple[EffectJoint, ...], float],
    best_sets: dict[tuple[EffectJoint, ...], Chosen],
) -> tuple[Chosen | None, tuple[GateResult, ...]]:
    """The set with the rival that leads in the finding's place, None if the finding leads; and the gates' results."""
    if not best_sets:
        return None, (likelier_than_rivals(own, 0.0, leads=True),)
    is_sound = {(): has_plausible_sizes(search, chosen, frozenset([term])) and not _new_in_old(search, [term])}
    is_sound |= {
        at: has_plausible_sizes(search, key, key - chosen) and not _new_in_old(search, key - chosen)
        for at, key in best_sets.items()
    }
    shares = {(): own} | {at: kept[at] for at in best_sets}
    sine = bool(search.problem.session.in_one_sine)
    plain = {at for at in shares if sine and adds_up(search, best_sets.get(at, chosen))}
    if sum(shares[at] for at in plain) < rivalry.NEARLY_AS_LIKELY * max(shares.values()):
        plain = set()

    def rank(at: tuple[EffectJoint, ...]) -> tuple[bool, bool, float, int, bool]:
        # Of twins the one with fewer causes leads: free bodies come with a load.
        return is_sound[at], at in plain, shares[at], -len(best_sets.get(at, chosen)), at == ()

    first = max(shares, key=rank)
    outside, unit = _outside(search, chosen, term)
    ahead = max((kept[at] for at in best_sets if is_sound[at] >= is_sound[()]), default=0.0)
    gates = until_failed(
        (
            plausible_size(outside, unit, rival_is=any(is_sound[at] for at in best_sets)),
            likelier_than_rivals(own, ahead, leads=first not in best_sets),
        )
    )
    return best_sets.get(first), gates


def _outside(search: Search, chosen: Chosen, term: Term) -> tuple[float, str]:
    """Distance of an effect's size from its plausible range, and the unit; zero if all sizes are plausible."""
    fault = implausible(search.problem.session, term, *search.evaluate(chosen).size(term))
    if fault is None:
        return 0.0, ""
    parameter, value = fault
    low, high = parameter.plausible or (value, value)
    return max(low - value, value - high), parameter.unit


def _new_in_old(search: Search, theirs: Iterable[Term]) -> bool:
    """True if an effect is part of the robot's build and an earlier diagnosis of this robot has not found it.

    Loads, friction and controllers differ between recordings. So where one of these explains a new finding, it leads,
    and the effect that cannot be new remains a rival.
    """
    return bool(search.problem.session.known) and any(one.effect.built_in for one in theirs)


def _with_effects(search: Search, chosen: Chosen, term: Term, effects: tuple[EffectJoint, ...]) -> Chosen | None:
    """The set with given effects in place of a finding, each in its best shape; None if one of them is no rival."""
    others: Chosen = frozenset()
    for cause in effects:
        shapes = [one for one in search.terms if one.effect_joint == cause]
        if not shapes:
            return None
        others |= {min(shapes, key=lambda one: search.quick(replaced(chosen, term, frozenset([one]))))}
    return replaced(chosen, term, others)


def _same_in_data(search: Search, term: Term, chosen: Chosen, others: Chosen, swapped: Chosen) -> bool:
    """True if each of two causes can make the torque of the other in these recordings.

    Laws of which one contains the other by definition are excluded, see `compare_with_rivals`. Free inertial parameters
    of a link contain every effect that moves with it.
    """
    if any(contains(one, two) or contains(two, one) for one in others for two in [term]):
        return False
    if term.effect.inertial == "free" or any(other.effect.inertial == "free" for other in others):
        return False
    one, two = list(term.columns), sorted({column for other in others for column in other.columns})
    theta, swapped_theta = search.evaluate(chosen).theta[one], search.evaluate(swapped).theta[two]
    # A replacement of an effect that displaces the links has its columns at the positions as read.
    search = search.of(swapped)
    return spanned(search, one, theta, two, rules.SAME_CAUSE) and spanned(
        search, two, swapped_theta, one, rules.SAME_CAUSE
    )


def with_leading_rivals(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """``chosen`` with findings replaced by rivals that lead, see `RivalComparison`.

    The search compares sums over all blocks; a rival that leads in most bootstrap replicates is the more probable
    cause. After each replacement the other findings are compared again; no set is used twice.
    """
    seen = [chosen]
    for _ in range(_LOOKS):
        before = chosen
        for term in ordered(chosen):
            if not term.named or term not in chosen:
                continue
            comparison = compare_with_rivals(search, chosen, term)
            if comparison.leading_set is not None and comparison.leading_set not in seen:
                search.record.add_failed([term], *comparison.gates, replaced_by=comparison.leading_set - chosen)
                search.record.add_passed(comparison.leading_set - chosen)
                chosen = comparison.leading_set
                seen.append(chosen)
        if chosen == before:
            break
    return chosen


def _by_effects(
    keys: list[Chosen], effects: dict[Chosen, tuple[EffectJoint, ...]], shares: Float[Array, " m"]
) -> dict[tuple[EffectJoint, ...], float]:
    """Shares by set of effects and joints, summed over shapes; the finding itself under ``()``."""
    out: dict[tuple[EffectJoint, ...], float] = {}
    for key, share in zip(keys, shares, strict=True):
        causes = effects.get(key, ())
        out[causes] = out.get(causes, 0.0) + float(share)
    return out


def _hopeless(search: Search, chosen: frozenset[Term], swapped: frozenset[Term], *, priced: bool) -> bool:
    """True if the swap is so much worse over the blocks that it would lead in no bootstrap replicate.

    Without prices only losses and penalties are compared.
    """
    if search.quick(swapped) > search.quick(chosen) + rules.HOPELESS_LOSS:
        return True
    found, base = search.evaluate(swapped), search.evaluate(chosen)
    worse = found.loss - base.loss
    more = search.price_of(swapped) - search.price_of(chosen)
    loss = found.total - base.total + (more if priced else min(more, 0.0))
    return loss > rules.HOPELESS_ERRORS * float(np.sqrt(len(worse)) * worse.std()) + rules.HOPELESS_BEYOND


def _twins(search: Search, chosen: frozenset[Term], term: Term) -> list[tuple[frozenset[Term], frozenset[Term]]]:
    """Exact twins: an effect that is the sum of others in the set, and free bodies in place of a common torque scale.

    A torque scale of all joints is the same as a change of all inertias, loads and friction. Beside friction in the
    set, wrong bodies of all links make the same torque.
    """
    here = {other.effect.name for other in chosen if other.joint == term.joint}
    for rich in search.terms:
        if contains(rich, term) and has_parts(rich, here):
            return [(frozenset([rich]), replaced(chosen, term, frozenset([rich])))]
    for bodies in search.terms:
        if scales_all_bodies(term, bodies):
            swapped = replaced(chosen, term, frozenset([bodies]))
            by = sorted({column for other in (*swapped, *chosen - {term}) for column in other.columns})
            own = list(term.columns)
            if spanned(search, own, search.evaluate(chosen).theta[own], by, rules.SAME_CAUSE):
                return [(frozenset([bodies]), swapped)]
    return []
