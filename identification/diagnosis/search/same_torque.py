"""Causes that make the same torque in a recording, which no comparison of residuals can separate."""

from __future__ import annotations

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.search.containment import contains, has_parts, scales_all_bodies
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.swaps import can_make_torque, with_replacement


def same_torque(search: Search, term: Term, chosen: Chosen, others: Chosen, swapped: Chosen) -> bool:
    """True if each of two causes can make the torque of the other in these recordings.

    It is false if one law contains the other by definition, as `compare_with_rivals` treats these separately. It is
    also false for free inertial parameters, which contain every effect that moves with the links.

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
    one, two = list(term.columns), sorted({column for other in others for column in other.columns})
    theta, swapped_theta = search.held_out_fit(chosen).theta[one], search.held_out_fit(swapped).theta[two]
    # If the finding displaces the links, its replacement has its columns at the positions that the encoders read.
    search = search.of(swapped)
    return can_make_torque(search, one, theta, two, rules.SAME_CAUSE) and can_make_torque(
        search, two, swapped_theta, one, rules.SAME_CAUSE
    )


def exact_twins(search: Search, chosen: Chosen, term: Term) -> dict[Chosen, Chosen]:
    """The set with an exact twin in place of a finding, mapped to the effects of the twin; empty without a twin.

    A twin is an effect that is the sum of the finding and others in the set on its joint. Free bodies are a twin of a
    torque scale common to all joints, if the set contains friction: the scale changes inertias, loads and friction all
    alike, so wrong bodies of all links and the friction make the same torque.
    """
    here = {other.effect.name for other in chosen if other.joint == term.joint}
    for rich in search.terms:
        if contains(rich, term) and has_parts(rich, here):
            return {with_replacement(chosen, term, search.alone[rich]): search.alone[rich]}
    for bodies in search.terms:
        if scales_all_bodies(term, bodies):
            swapped = with_replacement(chosen, term, search.alone[bodies])
            by = sorted({column for other in (*swapped, *chosen - {term}) for column in other.columns})
            own = list(term.columns)
            if can_make_torque(search, own, search.held_out_fit(chosen).theta[own], by, rules.SAME_CAUSE):
                return {swapped: search.alone[bodies]}
    return {}
