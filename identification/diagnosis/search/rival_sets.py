"""Rivals of a finding: other effects that may explain the recordings in its place, with their probabilities.

The cause that leads, finding or rival, is the one that the diagnosis names: the most probable of those with a plausible
size, or of all if no size is plausible.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.containment import are_parts, contains, has_parts, is_nested
from identification.diagnosis.search.fair_costs import (
    costs_of,
    does_not_cancel,
    rarities_of,
    weighted_by_rarity,
    without_method_errors,
)
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.plausible_sizes import implausible_size
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.richer_laws import has_plausible_sizes, odds_of_richer, odds_of_richer_laws
from identification.diagnosis.search.same_torque import exact_twins, same_torque
from identification.diagnosis.search.search import IMPOSSIBLE, Search
from identification.diagnosis.search.special_cases import simplest_effects
from identification.diagnosis.search.swaps import explained_loss, relevant_alternatives, with_replacement
from identification.engine import contract_levels
from identification.engine.claims import GateResult, until_failed
from identification.engine.resampling import Costs, probabilities
from identification.gates import fair_part, rivalry
from identification.gates.rivalry import likelier_than_rivals, plausible_size
from phantom_dyn.array_types import Array, Float

# A plausible cause replaces a finding of implausible size if its gain is at least this share of the finding's gain.
_MOSTLY = 0.5
# Largest number of passes over all findings.
_PASSES = 3


@dataclass(frozen=True)
class RivalComparison:
    """Probabilities of a finding and of its rivals.

    Attributes:
        probability: Probability of the finding.
        rivals: The rivals with their probabilities, the most probable first.
        leading_set: The whole set of effects with the leading rival in place of the finding; None if the finding leads.
            The most probable cause of a plausible size leads, or the most probable of all if no size is plausible.
        gates: Results for the finding of the gates that compare it with its rivals.
        rival_sets: Whole sets of effects with a rival in place of the finding, each with its probability. Sets whose
            effects nearly cancel each other are left out.
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
    barred: frozenset[EffectJoint] = frozenset(),
    other_conditions: tuple[Search, ...] = (),
    losses_beyond: Mapping[Chosen, Array] | None = None,
) -> RivalComparison:
    """Compare a finding with all effects and sets of effects that could replace it.

    The probability of a cause is the share of bootstrap replicates over blocks in which the set with this cause has the
    lowest cost (loss plus price). Sets with equal predictions share a replicate.

    A robot that was diagnosed before is known to be sound. There a new finding of an implausible size has the
    probability zero, if other causes of plausible sizes explain most of the finding's part of the gap.

    An effect with more parameters that contains the finding is a rival only if these parameters lower the held-out
    loss. It wins a replicate only if they gain more there than their price and the errors of the method. It need not
    pass the threshold of chance over the whole catalogue, because there are few laws of one kind on one joint.

    Prices of parameters count as follows:

    - Finding and rival can each make the torque of the other: no prices.
    - Neither law contains the other, or the rival is a sum of parts of the finding: probabilities are means of
      comparisons with and without prices, because on held-out blocks a law already loses by parameters that fit noise.
      If one of the laws has a shape, losses that differ by less than the errors of the method count as equal, unless
      the better set has fewer parameters.
    - A fitted law that does not differ from one of its special cases counts as that special case.

    Args:
        search: Candidates, fits and scores of sets.
        chosen: A set of effects.
        term: The finding, one of these effects.
        barred: Laws, with their joints, that do not differ from a simpler one. As parts of a sum they may be rivals.
        other_conditions: Searches over the same candidates under conditions that should not matter, such as another
            frequency band. If there are any, the comparison is repeated with each of them and on each half of the
            blocks, and probabilities are means over all repetitions.
        losses_beyond: For sets with a rival that is compared on a part of the data only: held-out loss of each block
            minus that of ``chosen``, penalty included. They replace losses and costs of these sets in all searches.
    """
    base, diagnosed = search.held_out_fit(chosen), bool(search.problem.session.known)
    sound = has_plausible_sizes(search, chosen, frozenset([term]))
    losses_of, replacing, richer_laws = _candidate_sets(
        search, chosen, term, barred, other_conditions, sound=sound or not diagnosed
    )
    # Add rivals that were compared on a part of the data only.
    beyond = losses_beyond or {}
    losses_of |= {key: base.loss + loss for key, loss in beyond.items()}
    replacing |= {key: key - chosen for key in beyond}
    plausible = {key for key in replacing if has_plausible_sizes(search, key, key - chosen)}
    if plausible or sound:
        # Rivals of implausible sizes are left out if the finding or another rival has a plausible size.
        replacing = {key: others for key, others in replacing.items() if key in plausible}
        losses_of = {key: loss for key, loss in losses_of.items() if key == chosen or key in replacing}
    if diagnosed and not sound and any(has_plausible_sizes(search, key, key) for key in plausible):
        losses_of[chosen] = losses_of[chosen] + IMPOSSIBLE / len(base.loss)
    twins = {key for key, others in replacing.items() if same_torque(search, term, chosen, others, key)}
    # Exact twins are not fitted: they have the loss and the costs of the finding.
    exact = exact_twins(search, chosen, term)
    losses_of |= dict.fromkeys(exact, base.loss)
    replacing |= exact
    richer = odds_of_richer_laws(search, chosen, term, barred, richer_laws)
    if len(losses_of) == 1 and not richer:
        return RivalComparison(1.0, (), gates=(likelier_than_rivals(1.0, 0.0, leads=True),))
    keys = list(losses_of)
    unnested = {key for key, others in replacing.items() if not is_nested(term, others)}
    fitted = [chosen if key in exact else key for key in keys]
    # Losses of the sets in ``beyond`` include their costs already, so these sets get the costs of the finding.
    priced = [chosen if key in beyond else key for key in fitted]
    is_twin, is_unnested = ([key in some for key in keys] for some in (twins, unnested))
    effects = {key: _replacing_effects(search, chosen, others, key, exact) for key, others in replacing.items()}
    # Only laws with a shape have errors of linearisation.
    within_errors = [key in unnested and any(one.shape for one in (term, *replacing[key])) for key in keys]
    more = np.array([search.sizes_of(one) - search.sizes_of(chosen) for one in fitted], dtype=float)
    # Losses that were added to those of the fits, such as the errors of the method for laws with more parameters.
    added = [losses_of[key] - search.held_out_fit(one).loss for key, one in zip(keys, fitted, strict=True)]

    def losses_and_costs(fits: Search) -> tuple[Float[Array, "B m"], Costs]:
        own = fits.held_out_fit(chosen).loss
        held_out = [
            own + beyond[one] if one in beyond else fits.held_out_fit(one).loss + more_loss
            for one, more_loss in zip(fitted, added, strict=True)
        ]
        costs = (*costs_of(fits, priced, is_twin), *costs_of(fits, priced, is_twin, is_unnested))
        gain = explained_loss(fits, chosen, term)
        return without_method_errors(np.array(held_out).T, more, within_errors, gain), costs

    conditions = [losses_and_costs(other) for other in other_conditions]
    by_set = probabilities(*losses_and_costs(search), conditions, by_halves=bool(conditions))
    by_set = weighted_by_rarity(by_set, rarities_of(search, fitted))
    # Sum over the sets with the same effects; the key of the finding is ().
    shares: dict[tuple[EffectJoint, ...], float] = defaultdict(float)
    for key, share in zip(keys, by_set, strict=True):
        shares[effects.get(key, ())] += float(share)
    for causes, odds in richer.items():
        shares[causes] = max(shares[causes], odds * shares[()])
    for swapped, others in replacing.items():
        # The odds of the richer to the simpler law must not depend on which of them is the finding.
        if effects[swapped] and all(contains(term, other) for other in others):
            same_sum = has_parts(term, {other.effect.name for other in others})
            odds = 1.0 if same_sum else min(odds_of_richer(search, swapped, chosen), 1.0)
            shares[()] = max(shares[()], odds * shares[effects[swapped]])
    own = shares[()]
    listed = min(contract_levels.LISTED, max(shares.values()))
    kept = {causes: share for causes, share in shares.items() if share >= listed and causes}
    # With the odds of laws with more parameters the sum of the shares may be above one. So it is normalised, and rivals
    # that are then too improbable to be listed are removed, the least probable first.
    while kept and min(kept.values()) < contract_levels.LISTED * (own + sum(kept.values())):
        del kept[min(kept, key=lambda causes: kept[causes])]
    total = own + sum(kept.values())
    rivals = tuple(
        Rival(tuple(EffectAt(*cause) for cause in causes), share / total)
        for causes, share in sorted(kept.items(), key=lambda item: -item[1])
    )
    likely = {at: share / total for at, share in kept.items()}
    best_sets = _best_set_of_each(search, chosen, term, likely, effects)
    leader, gates = _leader(search, chosen, term, own / total, likely, best_sets)
    rival_sets = tuple(
        (key, likely[at]) for at, key in best_sets.items() if key not in exact and does_not_cancel(search, key)
    )
    return RivalComparison(own / total, rivals, leader, gates, rival_sets)


def _candidate_sets(
    search: Search,
    chosen: Chosen,
    term: Term,
    barred: frozenset[EffectJoint],
    other_conditions: tuple[Search, ...],
    *,
    sound: bool,
) -> tuple[dict[Chosen, Array], dict[Chosen, Chosen], list[Chosen]]:
    """Held-out losses, by block, of the set and of all sets with another cause in place of a finding.

    A set is left out if it is far worse in all frequency bands. One band is not enough: where noise is white,
    frequencies above the judged band (where findings are tested) have the same weight as others, and a small error of
    the model there could exclude the true cause.
    The search with wider tolerances is not used for this, because wide tolerances may explain the whole gap by
    themselves, and then no set is far worse.

    Args:
        search: Candidates, fits and scores of sets.
        chosen: A set of effects.
        term: The finding, one of these effects.
        barred: Laws, with their joints, that do not differ from a simpler one.
        other_conditions: Searches over the same candidates under other conditions.
        sound: False if any cause with at least half of the finding's gain may replace a finding of implausible size.

    Returns:
        Losses by set; for each set the effects in place of the finding; and laws with more parameters.
    """
    base, accuracy = search.held_out_fit(chosen), fair_part.ACCURACY * explained_loss(search, chosen, term)
    losses_of, replacing, richer_laws = {chosen: base.loss}, dict[Chosen, Chosen](), list[Chosen]()
    searches = (search, *(one for one in other_conditions if one.problem.white is not search.problem.white))
    slack = [rules.HOPELESS_LOSS if sound else _MOSTLY * explained_loss(one, chosen, term) for one in searches]
    alternatives = dict.fromkeys(
        others
        for one, own in zip(searches, slack, strict=True)
        for others in relevant_alternatives(one, chosen, term, own)
    )
    for others in alternatives:
        is_sum = len(others) > 1 and are_parts(others, term)
        allowed = is_sum or barred.isdisjoint(other.effect_joint for other in others)
        if not allowed or not all(other.named for other in others):
            continue
        swapped = with_replacement(chosen, term, others)
        if swapped in losses_of or not others <= swapped:
            continue
        if sound:
            nested = is_nested(term, others)
            far_worse = all(is_far_worse(one, chosen, swapped, priced=nested) for one in searches)
        else:
            both = zip(searches, slack, strict=True)
            far_worse = all(one.in_sample_loss(swapped) > one.in_sample_loss(chosen) + own for one, own in both)
        if far_worse:
            continue
        found = search.held_out_fit(swapped)
        if any(simplest_effects(search.problem.session.robot, other, found) is None for other in others):
            continue
        richer = any(contains(other, term) for other in others) and search.sizes_of(others) > search.sizes[term]
        if richer:
            richer_laws.append(others)
        if richer and found.total >= base.total:
            continue
        losses_of[swapped] = found.loss + (accuracy / len(found.loss) if richer else 0.0)
        replacing[swapped] = others
    return losses_of, replacing, richer_laws


def _replacing_effects(
    search: Search, chosen: Chosen, others: Chosen, swapped: Chosen, exact: dict[Chosen, Chosen]
) -> tuple[EffectJoint, ...]:
    """Effects and joints that replace a finding; a law that does not differ from a special case counts as that case.

    The result is empty if the sets with and without the replacement then have the same effects.
    """
    if swapped in exact:
        return tuple(other.effect_joint for other in ordered(others))
    robot, found = search.problem.session.robot, search.held_out_fit(swapped)
    effects = tuple(
        dict.fromkeys(cause for other in ordered(others) for cause in simplest_effects(robot, other, found) or ())
    )
    whole = {*effects, *(one.effect_joint for one in swapped - others)}
    return () if whole == {one.effect_joint for one in chosen} else effects


def _best_set_of_each(
    search: Search,
    chosen: Chosen,
    term: Term,
    kept: dict[tuple[EffectJoint, ...], float],
    effects: dict[Chosen, tuple[EffectJoint, ...]],
) -> dict[tuple[EffectJoint, ...], Chosen]:
    """The whole set with the best score for each rival, by the effects that replace the finding."""
    best_sets: dict[tuple[EffectJoint, ...], Chosen] = {}
    for key in sorted(effects, key=search.score):
        # If a law does not differ from a special case, the set with the special case leads in its place.
        known = {one.effect_joint for one in key - chosen} <= set(effects[key])
        if effects[key] in kept and effects[key] not in best_sets:
            leading = key if known else _with_best_shapes(search, chosen, term, effects[key])
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
    """The set with the rival that leads in place of the finding, None if the finding leads; and results of the gates.

    Args:
        search: Fits of sets.
        chosen: A set of effects with the finding ``term``.
        term: The finding.
        own: Probability of the finding.
        kept: Probability of each listed rival.
        best_sets: The whole set with the best score for each listed rival.
    """
    if not best_sets:
        return None, (likelier_than_rivals(own, 0.0, leads=True),)
    # Whole set and new effects of each cause, by the effects and joints of the cause, which are () for the finding.
    sets = {(): (chosen, frozenset([term]))} | {at: (key, key - chosen) for at, key in best_sets.items()}
    # If an earlier diagnosis of this robot did not find an effect of its build, the robot hardly has that effect now.
    # Loads, friction and controllers differ between recordings. So if one of these explains a new finding, it leads.
    known = bool(search.problem.session.known)
    built = {at for at, (_, new) in sets.items() if known and any(one.effect.built_in for one in new)}
    is_sound = {at: has_plausible_sizes(search, key, new) and at not in built for at, (key, new) in sets.items()}
    shares = {(): own} | {at: kept[at] for at in best_sets}
    sine = bool(search.problem.session.in_one_sine)
    # In a motion of one sine, causes whose torques do not cancel each other lead if together they are likely enough.
    preferred = {at for at in shares if sine and does_not_cancel(search, best_sets.get(at, chosen))}
    if sum(shares[at] for at in preferred) < rivalry.NEARLY_AS_LIKELY * max(shares.values()):
        preferred = set()

    def rank(at: tuple[EffectJoint, ...]) -> tuple[bool, bool, float, int, bool]:
        # Of equally probable sets the one with fewer effects leads.
        return is_sound[at], at in preferred, shares[at], -len(best_sets.get(at, chosen)), at == ()

    first = max(shares, key=rank)
    outside, unit = _excess_of_range(search, chosen, term)
    ahead = max((kept[at] for at in best_sets if is_sound[at] >= is_sound[()]), default=0.0)
    gates = until_failed(
        (
            plausible_size(outside, unit, rival_is_plausible=any(is_sound[at] for at in best_sets)),
            likelier_than_rivals(own, ahead, leads=first not in best_sets),
        )
    )
    return best_sets.get(first), gates


def _excess_of_range(search: Search, chosen: Chosen, term: Term) -> tuple[float, str]:
    """Distance of an effect's size from its plausible range, and the unit; zero if all sizes are plausible."""
    fault = implausible_size(search.problem.session, term, *search.held_out_fit(chosen).coefficients_of(term))
    if fault is None:
        return 0.0, ""
    parameter, value = fault
    low, high = parameter.plausible or (value, value)
    return max(low - value, value - high), parameter.unit


def _with_best_shapes(search: Search, chosen: Chosen, term: Term, effects: tuple[EffectJoint, ...]) -> Chosen | None:
    """The set with given effects in place of a finding, each in its best shape; None if one is not in the search."""
    others: Chosen = frozenset()
    for cause in effects:
        shapes = [one for one in search.terms if one.effect_joint == cause]
        if not shapes:
            return None
        others |= {min(shapes, key=lambda one: search.in_sample_loss(with_replacement(chosen, term, frozenset([one]))))}
    return with_replacement(chosen, term, others)


def with_leading_rivals(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """``chosen`` with each finding replaced by its rival if the rival leads, see `RivalComparison`.

    The stepwise search compares sums over all blocks. A rival that leads in most bootstrap replicates over blocks is
    the more probable cause, even if its sum is larger. After each replacement the other findings are compared again; no
    set is used twice.
    """
    seen = [chosen]
    for _ in range(_PASSES):
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


def is_far_worse(search: Search, chosen: frozenset[Term], swapped: frozenset[Term], *, priced: bool) -> bool:
    """True if the set ``swapped`` is so much worse than ``chosen`` that it would lead in no bootstrap replicate.

    If not ``priced``, a higher price is no disadvantage.
    """
    if search.in_sample_loss(swapped) > search.in_sample_loss(chosen) + rules.HOPELESS_LOSS:
        return True
    found, base = search.held_out_fit(swapped), search.held_out_fit(chosen)
    worse = found.loss - base.loss
    more = search.price_of(swapped) - search.price_of(chosen)
    loss = found.total - base.total + (more if priced else min(more, 0.0))
    return loss > rules.HOPELESS_ERRORS * float(np.sqrt(len(worse)) * worse.std()) + rules.HOPELESS_BEYOND
