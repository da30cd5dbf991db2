"""Relations between effects: special cases of each other, sums, near twins, and effects that exclude each other.

One law contains another, its special case, if it reduces to the other for some values of its parameters.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import cache

from identification.diagnosis.columns.terms import Term

# Number of inertial parameters of one body.
BODY = 10


def joints_of(term: Term) -> tuple[str, ...]:
    """Names of the joints of a term; empty for an effect of the whole robot."""
    return () if term.joint is None else tuple(term.joint.split("+"))


def contains(rich: Term, simple: Term) -> bool:
    """True if ``simple`` is a special case of ``rich``."""
    if rich is simple:
        return False
    same_place = simple.joint == rich.joint or simple.column_set == rich.column_set
    return simple.column_set < rich.column_set or (same_place and simple.effect.name in rich.effect.contains)


def with_term(chosen: frozenset[Term], term: Term) -> frozenset[Term]:
    """``chosen`` with ``term``, and without its special cases and the effects that it excludes."""
    compatible = (other for other in chosen if not contains(term, other) and not _exclude(term, other))
    return frozenset([*compatible, term])


def _exclude(one: Term, other: Term) -> bool:
    """True if a set may not contain both effects.

    - They are two shapes of one effect on one joint, or two laws on one joint that contain the same effect.
    - They are two torque constants with a joint in common: a joint has one torque constant.
    - One is a torque constant common to several joints, the other free parameters of a body. Together they can imitate
      wrong friction on all these joints, because the body cancels the change of all other torques. A load does not
      exclude the torque constant: its mass and centre do not scale the torque of the links before it.
    """
    for scale, bodies in ((one, other), (other, one)):
        if (is_of_many_joints(scale) and bodies.effect.inertial == "free") or scales_all_bodies(scale, bodies):
            return True
    if one.effect.scales_joint and other.effect.scales_joint and one is not other:
        return not set(joints_of(one)).isdisjoint(joints_of(other))
    if one.joint != other.joint:
        return False
    return one.effect.name == other.effect.name or not set(one.effect.contains).isdisjoint(other.effect.contains)


def is_of_many_joints(term: Term) -> bool:
    """True for an effect with one parameter for several joints, such as one torque constant for all."""
    return term.effect.shared and len(joints_of(term)) > 1


def scales_all_bodies(scale: Term, bodies: Term) -> bool:
    """True if ``scale`` is one torque constant of all joints and ``bodies`` has the parameters of all their bodies."""
    are_all = bodies.effect.inertial == "free" and bodies.joint is None
    return scale.effect.shared and are_all and len(bodies.columns) <= BODY * len(joints_of(scale))


def can_join(chosen: frozenset[Term], term: Term) -> bool:
    """True unless ``term`` is in the set already, or is a special case of one of its effects."""
    return term not in chosen and not any(contains(other, term) for other in chosen)


def has_parts_in(chosen: frozenset[Term], term: Term) -> bool:
    """True for an effect with one parameter for several joints, if the set contains effects that may be parts of it."""
    parts = (other for other in chosen if are_parts([other], term) and other.joint in joints_of(term))
    return is_of_many_joints(term) and any(parts)


def are_parts(parts: Iterable[Term], whole: Term) -> bool:
    """True if a sum of some effects may make nearly the same torque as ``whole``."""
    return all(part.effect.name in whole.effect.sum_parts for part in parts)


def relations(terms: tuple[Term, ...]) -> tuple[Callable[[Term], frozenset[Term]], Callable[[Term], frozenset[Term]]]:
    """Two cached functions of a term, `Search.removed_by` and `Search.contained_in`.

    The first gives the terms that remove the given term from a set when they are added; the given term itself is
    included. The second gives the terms of which the given term is a special case.
    """
    with_key: dict[object, list[Term]] = defaultdict(list)
    for term in terms:
        # Only terms on a common joint or with common columns are related.
        for key in _keys(term):
            with_key[key].append(term)

    @cache
    def contained_in(term: Term) -> frozenset[Term]:
        return frozenset(other for key in _keys(term) for other in with_key[key] if contains(other, term))

    @cache
    def removed_by(term: Term) -> frozenset[Term]:
        excluding = (other for key in _keys(term) for other in with_key[key] if _exclude(other, term))
        return contained_in(term).union(excluding)

    return removed_by, contained_in


def _keys(term: Term) -> tuple[object, ...]:
    """Keys of a term, such as its joints and columns; related terms have a key in common.

    Terms with a common parameter for several joints and terms of inertial parameters may exclude each other on any
    joints, so all of them have the key ``whole``.
    """
    shared = tuple(("joint", joint) for joint in joints_of(term)) if term.effect.shared else ()
    whole = ("whole",) if term.effect.shared or term.effect.inertial is not None else ()
    return ("joint", term.joint), *shared, *whole, *term.columns


def are_near_twins(one: Term, other: Term) -> bool:
    """True if two effects make nearly the same torque: near twins on one joint, or one of them on the whole robot."""
    are_twins = other.effect.name in one.effect.near_twins or one.effect.name in other.effect.near_twins
    return are_twins and (one.joint == other.joint or None in (one.joint, other.joint))


def is_nested(term: Term, others: frozenset[Term]) -> bool:
    """True if one of a finding and its replacements contains the other, or tends to it as a limit.

    It is also true if several effects that are not parts of the finding replace it.
    """
    if len(others) > 1 and not are_parts(others, term):
        return True
    return any(
        contains(rich, simple) or (rich.joint == simple.joint and simple.effect.name in rich.effect.tends_to)
        for one in others
        for rich, simple in ((one, term), (term, one))
    )


def equals_sum_of(rich: Term, names: set[str]) -> bool:
    """True if effects with some of these names add up to a special case of a law."""
    return bool(rich.effect.same_as_sum) and names.issuperset(rich.effect.same_as_sum)
