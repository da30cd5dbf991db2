"""Sets of effects that are compared as rivals of a finding: candidates, and causes that make the same torque."""

from __future__ import annotations

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.search.containment import are_parts, contains, equals_sum_of, is_nested, scales_all_bodies
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.special_cases import simplest_effects
from identification.diagnosis.search.swaps import (
    can_make_torque,
    explained_loss,
    relevant_alternatives,
    with_replacement,
)
from identification.gates import fair_part
from phantom_dyn.array_types import Array

# A plausible cause replaces a finding of implausible size if its gain is at least this share of the finding's gain.
_SHARE_OF_GAIN = 0.5


def candidate_sets(
    search: Search,
    chosen: Chosen,
    term: Term,
    barred: frozenset[EffectJoint],
    other_conditions: tuple[Search, ...],
    *,
    must_fit_well: bool,
) -> tuple[dict[Chosen, Array], dict[Chosen, Chosen], list[Chosen]]:
    """The set with a finding, and all sets with a rival in its place that are not far worse.

    A set is left out if it is far worse in all frequency bands. One band is not enough: where noise is white,
    frequencies above the judged band (where findings are tested) have the same weight as others, and a small error of
    the model there could exclude the true cause. The search with wider tolerances is not used for this, because wide
    tolerances may explain the whole gap by themselves, and then no set is far worse.

    Args:
        search: Candidates, fits and scores of sets.
        chosen: A set of effects.
        term: The finding, one of these effects.
        barred: Laws, with their joints, that do not differ from a simpler one.
        other_conditions: Searches over the same candidates under other conditions.
        must_fit_well: True to leave out sets that fit far worse. False to leave out only causes that gain less than
            half as much as the finding, because the finding has an implausible size.

    Returns:
        The held-out loss of each block for each set, including the errors of the method for laws with more parameters;
        for each set with a rival, the effects in place of the finding; and laws with more parameters that contain the
        finding.
    """
    base, accuracy = search.held_out_fit(chosen), fair_part.ACCURACY * explained_loss(search, chosen, term)
    losses, replacements, richer_laws = {chosen: base.loss}, dict[Chosen, Chosen](), list[Chosen]()
    searches = (search, *(one for one in other_conditions if one.problem.white is not search.problem.white))
    # Largest difference of the in-sample losses, for each search.
    slack = [
        rules.HOPELESS_LOSS if must_fit_well else _SHARE_OF_GAIN * explained_loss(one, chosen, term) for one in searches
    ]
    alternatives = dict.fromkeys(
        others
        for one, most in zip(searches, slack, strict=True)
        for others in relevant_alternatives(one, chosen, term, most)
    )
    for others in alternatives:
        is_sum = len(others) > 1 and are_parts(others, term)
        allowed = is_sum or barred.isdisjoint(other.effect_joint for other in others)
        if not allowed or not all(other.named for other in others):
            continue
        swapped = with_replacement(chosen, term, others)
        if swapped in losses or not others <= swapped:
            continue
        if must_fit_well:
            nested = is_nested(term, others)
            far_worse = all(is_far_worse(one, chosen, swapped, priced=nested) for one in searches)
        else:
            far_worse = all(
                one.in_sample_loss(swapped) > one.in_sample_loss(chosen) + most
                for one, most in zip(searches, slack, strict=True)
            )
        if far_worse:
            continue
        found = search.held_out_fit(swapped)
        if any(simplest_effects(search.problem.session.robot, other, found) is None for other in others):
            continue
        is_richer = (
            any(contains(other, term) for other in others) and search.parameter_count(others) > search.counts[term]
        )
        if is_richer:
            richer_laws.append(others)
        if is_richer and found.total >= base.total:
            continue
        losses[swapped] = found.loss + (accuracy / len(found.loss) if is_richer else 0.0)
        replacements[swapped] = others
    return losses, replacements, richer_laws


def is_far_worse(search: Search, chosen: Chosen, swapped: Chosen, *, priced: bool) -> bool:
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


def same_torque(search: Search, term: Term, chosen: Chosen, others: Chosen, swapped: Chosen) -> bool:
    """True if each of two causes can make the torque of the other in these recordings.

    The result is False if one law contains the other by definition, because `compare_with_rivals` treats these pairs
    separately. It is also False for free inertial parameters, which contain every effect of the links' motion.

    Args:
        search: Fits of sets.
        term: A finding.
        chosen: The set with the finding.
        others: The effects that replace the finding.
        swapped: The set with these effects.
    """
    if any(contains(one, term) or contains(term, one) or one.effect.inertial == "free" for one in others):
        return False
    if term.effect.inertial == "free":
        return False
    own, theirs = list(term.columns), sorted({column for other in others for column in other.columns})
    own_theta, their_theta = search.held_out_fit(chosen).theta[own], search.held_out_fit(swapped).theta[theirs]
    # If the finding displaces the links, columns of its replacement are computed at the positions that the encoders
    # read.
    search = search.of(swapped)
    return can_make_torque(search, own, own_theta, theirs, rules.SAME_CAUSE) and can_make_torque(
        search, theirs, their_theta, own, rules.SAME_CAUSE
    )


def exact_twins(search: Search, chosen: Chosen, term: Term) -> dict[Chosen, Chosen]:
    """The set with an exact twin in place of a finding, mapped to the effects of the twin; empty without a twin.

    An exact twin is a law that equals the sum of the finding and other effects of the set on the same joint. Free
    bodies are an exact twin of a torque scale common to all joints, if the set contains friction: the scale changes
    inertias, loads and friction all alike, so wrong bodies of all links and the friction make the same torque.
    """
    names_on_joint = {other.effect.name for other in chosen if other.joint == term.joint}
    for rich in search.terms:
        if contains(rich, term) and equals_sum_of(rich, names_on_joint):
            return {with_replacement(chosen, term, search.alone[rich]): search.alone[rich]}
    for bodies in search.terms:
        if scales_all_bodies(term, bodies):
            swapped = with_replacement(chosen, term, search.alone[bodies])
            by = sorted({column for other in (*swapped, *chosen - {term}) for column in other.columns})
            own = list(term.columns)
            if can_make_torque(search, own, search.held_out_fit(chosen).theta[own], by, rules.SAME_CAUSE):
                return {swapped: search.alone[bodies]}
    return {}
