"""Rivals of a finding: other effects that may explain the recordings in its place, with their probabilities.

Finding and rivals are causes; one of them leads, and the diagnosis names it. It is the most probable cause with a
plausible size, or the most probable of all if no size is plausible.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.containment import contains, equals_sum_of, is_nested
from identification.diagnosis.search.fair_costs import (
    costs_of,
    does_not_cancel,
    rarities_of,
    weighted_by_rarity,
    without_method_errors,
)
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.plausible_sizes import implausible_size
from identification.diagnosis.search.record import Cause, EffectJoint
from identification.diagnosis.search.richer_laws import has_plausible_sizes, odds_of_richer, odds_of_richer_laws
from identification.diagnosis.search.rival_candidates import candidate_sets, exact_twins, same_torque
from identification.diagnosis.search.search import IMPOSSIBLE, Search
from identification.diagnosis.search.special_cases import simplest_effects
from identification.diagnosis.search.swaps import explained_loss, with_replacement
from identification.engine import contract_levels
from identification.engine.claims import GateResult, until_failed
from identification.engine.resampling import Costs, probabilities
from identification.gates import rivalry
from identification.gates.rivalry import likelier_than_rivals, plausible_size
from phantom_dyn.array_types import Array, Float

# Largest number of passes over all findings.
_MOST_PASSES = 3


@dataclass(frozen=True)
class RivalComparison:
    """Probabilities of a finding and of its rivals.

    Attributes:
        probability: Probability of the finding.
        rivals: The rivals with their probabilities, the most probable first.
        leading_set: The whole set of effects with the leading rival in place of the finding; None if the finding leads.
        gates: Results of the gates that compare the finding with its rivals.
        rival_sets: Whole sets of effects with a rival in place of the finding, each with its probability. Sets whose
            effects nearly cancel each other are left out.
    """

    probability: float
    rivals: tuple[Rival, ...]
    leading_set: frozenset[Term] | None = None
    gates: tuple[GateResult, ...] = ()
    rival_sets: tuple[tuple[frozenset[Term], float], ...] = ()


@dataclass(frozen=True)
class _ComparedSets:
    """The set with a finding, and all sets with a rival in its place.

    Attributes:
        losses: Held-out loss of each block, for each set; that of the finding first.
        replacements: Effects in place of the finding, for each set with a rival.
        twins: Sets with a rival that makes the same torque as the finding.
        exact: Sets with an exact twin of the finding (`exact_twins`). They are not fitted: they have the loss and the
            costs of the finding.
        partial_losses: For each set with a rival that is compared on a part of the data only, held-out loss of each
            block minus that of the set with the finding.
    """

    losses: dict[Chosen, Array]
    replacements: dict[Chosen, Chosen]
    twins: set[Chosen]
    exact: dict[Chosen, Chosen]
    partial_losses: Mapping[Chosen, Array]


def compare_with_rivals(
    search: Search,
    chosen: Chosen,
    term: Term,
    barred: frozenset[EffectJoint] = frozenset(),
    other_conditions: tuple[Search, ...] = (),
    partial_losses: Mapping[Chosen, Array] | None = None,
) -> RivalComparison:
    """Compare a finding with all effects and sets of effects that could replace it.

    The probability of a cause is the share of bootstrap replicates over blocks in which the set with this cause has the
    lowest cost (loss plus price). Sets with equal predictions share a replicate.

    A robot that was diagnosed before is known to be sound. There a new finding of an implausible size has the
    probability zero if other causes of plausible sizes explain most of the finding's part of the gap.

    An effect with more parameters that contains the finding is a rival only if these parameters lower the held-out
    loss. It wins a replicate only if they gain more there than their price and the errors of the method. It need not
    pass the threshold of chance over the whole catalogue, because there are few laws of one kind on one joint.

    Prices of parameters count as follows:

    - If finding and rival can each make the torque of the other, prices do not count.
    - If neither law contains the other, or the rival is a sum of parts of the finding, probabilities are means of
      comparisons with and without prices: on held-out blocks a law already loses by parameters that fit noise. If one
      of the laws has a shape, losses that differ by less than the errors of the method count as equal, unless the
      better set has fewer parameters.
    - A fitted law that does not differ from one of its special cases counts as that special case.

    Args:
        search: Candidates, fits and scores of sets.
        chosen: A set of effects.
        term: The finding, one of these effects.
        barred: Laws, with their joints, that do not differ from a simpler one. As parts of a sum they may be rivals.
        other_conditions: Searches over the same candidates under conditions that should not matter, such as another
            frequency band. If there are any, the comparison is repeated with each of them and on each half of the
            blocks, and probabilities are means over all repetitions.
        partial_losses: For each set with a rival that is compared on a part of the data only, held-out loss of each
            block minus that of ``chosen``, including the penalty. They replace the losses and costs of these sets in
            all searches.
    """
    compared, richer_laws = _compared_sets(search, chosen, term, barred, other_conditions, partial_losses or {})
    odds_of_richer_causes = odds_of_richer_laws(search, chosen, term, barred, richer_laws)
    if len(compared.losses) == 1 and not odds_of_richer_causes:
        return RivalComparison(1.0, (), gates=(likelier_than_rivals(1.0, 0.0, leads=True),))
    causes = {
        candidate: _cause(search, chosen, others, candidate, compared.exact)
        for candidate, others in compared.replacements.items()
    }
    share_of_set = _shares_of_sets(search, chosen, term, compared, other_conditions)
    shares: dict[Cause, float] = defaultdict(float)
    for candidate, share in zip(compared.losses, share_of_set, strict=True):
        shares[causes.get(candidate, ())] += float(share)
    for cause, odds in odds_of_richer_causes.items():
        shares[cause] = max(shares[cause], odds * shares[()])
    for swapped, others in compared.replacements.items():
        # The odds of the richer to the simpler law must not depend on which of them is the finding.
        if causes[swapped] and all(contains(term, other) for other in others):
            same_sum = equals_sum_of(term, {other.effect.name for other in others})
            odds = 1.0 if same_sum else min(odds_of_richer(search, swapped, chosen), 1.0)
            shares[()] = max(shares[()], odds * shares[causes[swapped]])
    probability_of = _listed_probabilities(shares)
    rivals = tuple(
        Rival(tuple(EffectAt(*effect) for effect in cause), share) for cause, share in probability_of.items() if cause
    )
    best_sets = _best_set_of_each(search, chosen, term, probability_of, causes)
    leader, gates = _leader(search, chosen, term, probability_of, best_sets)
    rival_sets = tuple(
        (best, probability_of[cause])
        for cause, best in best_sets.items()
        if best not in compared.exact and does_not_cancel(search, best)
    )
    return RivalComparison(probability_of[()], rivals, leader, gates, rival_sets)


def _compared_sets(
    search: Search,
    chosen: Chosen,
    term: Term,
    barred: frozenset[EffectJoint],
    other_conditions: tuple[Search, ...],
    partial_losses: Mapping[Chosen, Array],
) -> tuple[_ComparedSets, list[Chosen]]:
    """The sets that `compare_with_rivals` compares, and laws with more parameters that contain the finding."""
    base, diagnosed_before = search.held_out_fit(chosen), bool(search.problem.session.known)
    is_plausible = has_plausible_sizes(search, chosen, frozenset([term]))
    losses, replacements, richer_laws = candidate_sets(
        search, chosen, term, barred, other_conditions, must_fit_well=is_plausible or not diagnosed_before
    )
    losses |= {candidate: base.loss + loss for candidate, loss in partial_losses.items()}
    replacements |= {candidate: candidate - chosen for candidate in partial_losses}
    plausible = {candidate for candidate in replacements if has_plausible_sizes(search, candidate, candidate - chosen)}
    if plausible or is_plausible:
        # Rivals of implausible sizes are left out if the finding or another rival has a plausible size.
        replacements = {candidate: others for candidate, others in replacements.items() if candidate in plausible}
        losses = {
            candidate: loss for candidate, loss in losses.items() if candidate == chosen or candidate in replacements
        }
    if (
        diagnosed_before
        and not is_plausible
        and any(has_plausible_sizes(search, candidate, candidate) for candidate in plausible)
    ):
        # With this loss the finding wins no replicate.
        losses[chosen] = losses[chosen] + IMPOSSIBLE / len(base.loss)
    twins = {
        candidate for candidate, others in replacements.items() if same_torque(search, term, chosen, others, candidate)
    }
    exact = exact_twins(search, chosen, term)
    losses |= dict.fromkeys(exact, base.loss)
    return _ComparedSets(losses, replacements | exact, twins, exact, partial_losses), richer_laws


def _shares_of_sets(
    search: Search, chosen: Chosen, term: Term, compared: _ComparedSets, other_conditions: tuple[Search, ...]
) -> Float[Array, " m"]:
    """Share of the bootstrap replicates that each compared set wins, weighted by how rare its sizes are, ``(m,)``."""
    sets = list(compared.losses)
    fitted = [chosen if candidate in compared.exact else candidate for candidate in sets]
    # Partial losses include the costs, so these sets get the costs of the finding.
    priced = [chosen if candidate in compared.partial_losses else candidate for candidate in fitted]
    unnested = {candidate for candidate, others in compared.replacements.items() if not is_nested(term, others)}
    is_twin, is_unnested = ([candidate in some for candidate in sets] for some in (compared.twins, unnested))
    # Only laws with a shape have errors of linearisation.
    has_linearisation_errors = [
        candidate in unnested and any(law.shape for law in (term, *compared.replacements[candidate]))
        for candidate in sets
    ]
    counts = np.array([search.parameter_count(candidate) for candidate in fitted], dtype=float)
    # Losses that were added to those of the fits, such as the errors of the method for laws with more parameters.
    added = [
        compared.losses[candidate] - search.held_out_fit(fit).loss for candidate, fit in zip(sets, fitted, strict=True)
    ]

    def losses_and_costs(condition: Search) -> tuple[Float[Array, "B m"], Costs]:
        base = condition.held_out_fit(chosen).loss
        losses = [
            base + compared.partial_losses[candidate]
            if candidate in compared.partial_losses
            else condition.held_out_fit(candidate).loss + added_loss
            for candidate, added_loss in zip(fitted, added, strict=True)
        ]
        costs = (*costs_of(condition, priced, is_twin), *costs_of(condition, priced, is_twin, is_unnested))
        gain = explained_loss(condition, chosen, term)
        return without_method_errors(np.array(losses).T, counts - counts[0], has_linearisation_errors, gain), costs

    conditions = [losses_and_costs(other) for other in other_conditions]
    shares = probabilities(*losses_and_costs(search), conditions, by_halves=bool(conditions))
    return weighted_by_rarity(shares, rarities_of(search, fitted))


def _listed_probabilities(shares: Mapping[Cause, float]) -> dict[Cause, float]:
    """Probability of the finding and of each rival that is probable enough to be listed, the most probable rival first.

    With the odds of laws with more parameters the sum of the shares may be above one. So it is normalised, and rivals
    that are then too improbable are removed, the least probable first.
    """
    least = min(contract_levels.LISTED, max(shares.values()))
    listed = {cause: share for cause, share in shares.items() if share >= least and cause}
    while listed and min(listed.values()) < contract_levels.LISTED * (shares[()] + sum(listed.values())):
        del listed[min(listed, key=lambda cause: listed[cause])]
    total = shares[()] + sum(listed.values())
    ordered_shares = sorted(listed.items(), key=lambda item: -item[1])
    return {(): shares[()] / total} | {cause: share / total for cause, share in ordered_shares}


def _cause(search: Search, chosen: Chosen, others: Chosen, swapped: Chosen, exact: dict[Chosen, Chosen]) -> Cause:
    """The effects that replace a finding; a law that does not differ from a special case counts as that case.

    The result is empty if the sets with and without the replacement then have the same effects.
    """
    if swapped in exact:
        return tuple(other.effect_joint for other in ordered(others))
    robot, found = search.problem.session.robot, search.held_out_fit(swapped)
    effects = tuple(
        dict.fromkeys(effect for other in ordered(others) for effect in simplest_effects(robot, other, found) or ())
    )
    whole = {*effects, *(one.effect_joint for one in swapped - others)}
    return () if whole == {one.effect_joint for one in chosen} else effects


def _best_set_of_each(
    search: Search, chosen: Chosen, term: Term, listed: Mapping[Cause, float], causes: dict[Chosen, Cause]
) -> dict[Cause, Chosen]:
    """The whole set with the best score for each listed rival.

    Args:
        search: Fits and scores of sets.
        chosen: A set of effects with the finding ``term``.
        term: The finding.
        listed: Probability of the finding and of each listed rival.
        causes: The cause in each set with a rival.
    """
    best_sets: dict[Cause, Chosen] = {}
    for swapped in sorted(causes, key=search.score):
        cause = causes[swapped]
        if cause and cause in listed and cause not in best_sets:
            # If a law does not differ from a special case, the set with the special case leads in its place.
            is_cause = {one.effect_joint for one in swapped - chosen} <= set(cause)
            best = swapped if is_cause else _with_best_shapes(search, chosen, term, cause)
            best_sets |= {} if best is None else {cause: best}
    return best_sets


def _leader(
    search: Search, chosen: Chosen, term: Term, probability_of: Mapping[Cause, float], best_sets: dict[Cause, Chosen]
) -> tuple[Chosen | None, tuple[GateResult, ...]]:
    """The set with the rival that leads in place of the finding, None if the finding leads; and results of the gates.

    Args:
        search: Fits of sets.
        chosen: A set of effects with the finding ``term``.
        term: The finding.
        probability_of: Probability of the finding and of each listed rival.
        best_sets: The whole set with the best score for each listed rival.
    """
    if not best_sets:
        return None, (likelier_than_rivals(probability_of[()], 0.0, leads=True),)
    # The whole set and the new effects of each cause.
    sets = {(): (chosen, frozenset([term]))} | {cause: (one, one - chosen) for cause, one in best_sets.items()}
    # If an earlier diagnosis of this robot did not find an effect of its build, the robot hardly has that effect now.
    # Loads, friction and controllers differ between recordings. So if one of these explains a new finding, it leads.
    diagnosed_before = bool(search.problem.session.known)
    of_build = {
        cause for cause, (_, new) in sets.items() if diagnosed_before and any(one.effect.built_in for one in new)
    }
    is_plausible = {
        cause: has_plausible_sizes(search, one, new) and cause not in of_build for cause, (one, new) in sets.items()
    }
    in_one_sine = bool(search.problem.session.in_one_sine)
    # In a motion of one sine, causes whose torques do not cancel each other lead if together they are likely enough.
    preferred = {cause for cause, (one, _) in sets.items() if in_one_sine and does_not_cancel(search, one)}
    largest = max(probability_of[cause] for cause in sets)
    if sum(probability_of[cause] for cause in preferred) < rivalry.NEARLY_AS_LIKELY * largest:
        preferred = set()

    def rank(cause: Cause) -> tuple[bool, bool, float, int, bool]:
        # Of equally probable sets the one with fewer effects leads.
        return is_plausible[cause], cause in preferred, probability_of[cause], -len(sets[cause][0]), cause == ()

    leader = max(sets, key=rank)
    outside, unit = _excess_of_range(search, chosen, term)
    best_rival = max(
        (probability_of[cause] for cause in best_sets if is_plausible[cause] >= is_plausible[()]), default=0.0
    )
    gates = until_failed(
        (
            plausible_size(outside, unit, rival_is_plausible=any(is_plausible[cause] for cause in best_sets)),
            likelier_than_rivals(probability_of[()], best_rival, leads=leader not in best_sets),
        )
    )
    return best_sets.get(leader), gates


def _excess_of_range(search: Search, chosen: Chosen, term: Term) -> tuple[float, str]:
    """Distance of an effect's size from its plausible range, and its unit; zero if all sizes are plausible."""
    fault = implausible_size(search.problem.session, term, *search.held_out_fit(chosen).coefficients_of(term))
    if fault is None:
        return 0.0, ""
    parameter, value = fault
    low, high = parameter.plausible or (value, value)
    return max(low - value, value - high), parameter.unit


def _with_best_shapes(search: Search, chosen: Chosen, term: Term, cause: Cause) -> Chosen | None:
    """The set with a cause in place of a finding, each effect in its best shape; None if one is not in the search."""
    others: Chosen = frozenset()
    for effect in cause:
        shapes = [one for one in search.terms if one.effect_joint == effect]
        if not shapes:
            return None
        others |= {min(shapes, key=lambda one: search.in_sample_loss(with_replacement(chosen, term, frozenset([one]))))}
    return with_replacement(chosen, term, others)


def with_leading_rivals(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """``chosen`` with each finding replaced by its leading rival, if a rival leads (`RivalComparison.leading_set`).

    The stepwise search compares sums over all blocks. A rival that wins most bootstrap replicates over blocks is the
    more probable cause, even if its sum is larger. After each replacement the other findings are compared again. No set
    is used twice.
    """
    seen = [chosen]
    for _ in range(_MOST_PASSES):
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
