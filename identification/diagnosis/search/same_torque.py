"""Tests whether two causes make the same torque in the recordings, so that residuals cannot separate them."""

from __future__ import annotations

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.search.containment import contains, has_parts, scales_all_bodies
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.swaps import can_make_torque, with_replacement


def same_torque(search: Search, term: Term, chosen: Chosen, others: Chosen, swapped: Chosen) -> bool:
    """True if each of two causes can make the torque of the other in these recordings.

    The result is False if one law contains the other by definition, as `compare_with_rivals` treats these pairs
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
        if contains(rich, term) and has_parts(rich, names_on_joint):
            return {with_replacement(chosen, term, search.alone[rich]): search.alone[rich]}
    for bodies in search.terms:
        if scales_all_bodies(term, bodies):
            swapped = with_replacement(chosen, term, search.alone[bodies])
            by = sorted({column for other in (*swapped, *chosen - {term}) for column in other.columns})
            own = list(term.columns)
            if can_make_torque(search, own, search.held_out_fit(chosen).theta[own], by, rules.SAME_CAUSE):
                return {swapped: search.alone[bodies]}
    return {}
