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

    Laws of which one contains the other by definition are excluded, see `compare_with_rivals`. Free inertial parameters
    of a link contain every effect that moves with it.
    """
    if any(contains(one, term) or contains(term, one) or one.effect.inertial == "free" for one in others):
        return False
    if term.effect.inertial == "free":
        return False
    one, two = list(term.columns), sorted({column for other in others for column in other.columns})
    theta, swapped_theta = search.held_out_fit(chosen).theta[one], search.held_out_fit(swapped).theta[two]
    # A replacement of an effect that displaces the links has its columns at the positions as read.
    search = search.of(swapped)
    return can_make_torque(search, one, theta, two, rules.SAME_CAUSE) and can_make_torque(
        search, two, swapped_theta, one, rules.SAME_CAUSE
    )


def exact_twins(search: Search, chosen: Chosen, term: Term) -> dict[Chosen, Chosen]:
    """The set with an exact twin of a finding, with the effects that replace the finding; empty if there is none.

    It is an effect that is the sum of others in the set, or free bodies in place of a common torque scale.

    A torque scale of all joints is the same as a change of all inertias, loads and friction. Beside friction in the
    set, wrong bodies of all links make the same torque.
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
