"""Relations between effects: special cases of each other, and effects that exclude each other from a set."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import cache

from identification.diagnosis.columns.terms import Term

# Inertial parameters of one body.
BODY = 10


def joints_of(term: Term) -> tuple[str, ...]:
    """The joints that a term is on; none for an effect of the whole robot."""
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
    """True for two shapes of one effect, two friction laws with many parameters on one joint, and the like.

    A joint has one torque constant, its own or one that several joints share. Beside a load or free parameters of a
    body, a common torque constant can express wrong friction of all these joints, as the body takes what it does to the
    rest of the torque. Friction expresses that by itself, and so does a torque constant for each joint.
    """
    if any(hides(one, other) or hides(other, one) for hides in (_hides_friction, scales_all_bodies)):
        return True
    if one.effect.scales_joint and other.effect.scales_joint and one is not other:
        return not set(joints_of(one)).isdisjoint(joints_of(other))
    if one.joint != other.joint:
        return False
    return one.effect.name == other.effect.name or not set(one.effect.contains).isdisjoint(other.effect.contains)


def is_of_many_joints(term: Term) -> bool:
    """True for one number of several joints, such as one torque constant for all."""
    return term.effect.shared and len(joints_of(term)) > 1


def _hides_friction(scale: Term, bodies: Term) -> bool:
    """True for a torque constant that several joints share, together with a load or free parameters of bodies."""
    return is_of_many_joints(scale) and bodies.effect.inertial is not None


def scales_all_bodies(scale: Term, bodies: Term) -> bool:
    """True for a common torque scale of all joints together with the parameters of all their bodies."""
    if not scale.effect.shared or bodies.effect.inertial != "free" or bodies.joint is not None:
        return False
    return len(bodies.columns) <= BODY * len(joints_of(scale))


def can_join(chosen: frozenset[Term], term: Term) -> bool:
    """False if ``term`` is in the set already, or is a special case of one of its effects."""
    return term not in chosen and not any(contains(other, term) for other in chosen)


def is_beside_parts(chosen: frozenset[Term], term: Term) -> bool:
    """True for one number of several joints and a set with effects on them that may be parts of it."""
    if not is_of_many_joints(term):
        return False
    joints = joints_of(term)
    return any(are_parts([other], term) and other.joint in joints for other in chosen)


def are_parts(parts: Iterable[Term], whole: Term) -> bool:
    """True for effects of which a sum may make much the same torque as another one."""
    return all(part.effect.name in whole.effect.sum_parts for part in parts)


def relations(terms: tuple[Term, ...]) -> tuple[Callable[[Term], frozenset[Term]], Callable[[Term], frozenset[Term]]]:
    """Two functions: for a term those that remove it when they are added (itself too), and those that contain it."""
    near: dict[object, list[Term]] = defaultdict(list)
    for term in terms:
        # Only terms on a common joint or with common columns are related.
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
    """Joints and columns of a term: related terms have one of these in common."""
    shared = tuple(("joint", joint) for joint in joints_of(term)) if term.effect.shared else ()
    whole = ("whole",) if term.effect.shared or term.effect.inertial is not None else ()
    return ("joint", term.joint), *shared, *whole, *term.columns


def are_near_twins(one: Term, other: Term) -> bool:
    """True if two effects are near twins on the same joint, or one of them on all."""
    names = other.effect.name in one.effect.near_twins or one.effect.name in other.effect.near_twins
    return names and (one.joint == other.joint or None in (one.joint, other.joint))


def is_nested(term: Term, others: frozenset[Term]) -> bool:
    """True if a finding and its replacement contain one another, or if several effects replace it that are no parts."""

    def more(rich: Term, simple: Term) -> bool:
        return contains(rich, simple) or (rich.joint == simple.joint and simple.effect.name in rich.effect.tends_to)

    several = len(others) > 1 and not are_parts(others, term)
    return several or any(more(one, term) or more(term, one) for one in others)


def has_parts(rich: Term, names: set[str]) -> bool:
    """True if effects with these names, or some of them, add up to a special case of a law, under another name."""
    return bool(rich.effect.same_as_sum) and names.issuperset(rich.effect.same_as_sum)
