"""Which effect is a special case of which other one, and which sets may hold both."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from functools import cache

from identification.diagnosis.columns.terms import Term

# Inertial parameters of one body.
BODY = 10


def joints_of(term: Term) -> tuple[str, ...]:
    """The joints that a term sits on; none of an effect of the whole robot."""
    return () if term.joint is None else tuple(term.joint.split("+"))


def contains(rich: Term, simple: Term) -> bool:
    """True if ``simple`` is a special case of ``rich``."""
    if rich is simple:
        return False
    if simple.column_set < rich.column_set:
        return True
    if simple.effect.name in rich.effect.contains:
        return simple.joint == rich.joint or simple.column_set == rich.column_set
    return False


def with_term(chosen: frozenset[Term], term: Term) -> frozenset[Term]:
    """``chosen`` and ``term``, without its special cases and without the same effect of another shape."""
    kept = (other for other in chosen if not contains(term, other) and not _exclude(term, other))
    return frozenset([*kept, term])


def _exclude(one: Term, other: Term) -> bool:
    """The same effect of another shape, or two rich friction laws on one joint, which collapse into the better.

    A joint has one torque constant, its own or one that several joints have in common. Beside bodies that are all free
    one for all joints says nothing but that the friction of the model is wrong, as friction says by itself.
    """
    if scales_all_bodies(one, other) or scales_all_bodies(other, one):
        return True
    if one.effect.scales_joint and other.effect.scales_joint and one is not other:
        return not set(joints_of(one)).isdisjoint(joints_of(other))
    if one.joint != other.joint:
        return False
    return one.effect.name == other.effect.name or not set(one.effect.contains).isdisjoint(other.effect.contains)


def scales_all_bodies(scale: Term, bodies: Term) -> bool:
    """True if a torque scale that all joints have in common is beside parameters of all their bodies."""
    if not scale.effect.shared or bodies.effect.inertial != "free" or bodies.joint is not None:
        return False
    return len(bodies.columns) <= BODY * len(joints_of(scale))


def possible(chosen: frozenset[Term], term: Term) -> bool:
    """False if ``term`` is there already, or a special case of what is."""
    return term not in chosen and not any(contains(other, term) for other in chosen)


def relations(terms: tuple[Term, ...]) -> tuple[Callable[[Term], frozenset[Term]], Callable[[Term], frozenset[Term]]]:
    """For one of these terms, those to which it gives way, itself among them, and those that contain it."""
    near: dict[object, list[Term]] = defaultdict(list)
    for term in terms:
        # Only terms on one joint or with common columns have anything to do with each other.
        for key in _keys(term):
            near[key].append(term)

    def related(term: Term) -> set[Term]:
        return {other for key in _keys(term) for other in near[key]}

    @cache
    def displacing(term: Term) -> frozenset[Term]:
        return frozenset(other for other in related(term) if contains(other, term) or _exclude(other, term))

    @cache
    def covering(term: Term) -> frozenset[Term]:
        return frozenset(other for other in related(term) if contains(other, term))

    return displacing, covering


def _keys(term: Term) -> tuple[object, ...]:
    """What two terms have in common if they have anything to do with each other: a joint, or a column."""
    shared = tuple(("joint", joint) for joint in joints_of(term)) if term.effect.shared else ()
    whole = ("whole",) if term.effect.shared or (term.effect.inertial == "free" and term.joint is None) else ()
    return ("joint", term.joint), *shared, *whole, *term.columns


def are_near_twins(one: Term, other: Term) -> bool:
    """True if two effects are near twins on the same joint, or one of them on all."""
    names = other.effect.name in one.effect.near_twins or one.effect.name in other.effect.near_twins
    return names and (one.joint == other.joint or None in (one.joint, other.joint))
