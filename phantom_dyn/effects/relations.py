"""The one table of what two effects are to each other, where their laws do not say it by themselves.

Of most effects there is nothing to say. A row is for a law of which another one is a special case, or that leaves the
same torque as others do; `tests/phantom_dyn/effects/test_relations.py` compares the rows with the columns of both, so
that a row which is missing or wrong is noticed.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Literal, NamedTuple

Kind = Literal[
    "contains",
    "tends to",
    "resembles on each joint",
    "may be a sum with",
    "resembles a sum of",
    "nearly same in closed loop",
    "same shapes as",
]


class Relation(NamedTuple):
    """One row.

    Attributes:
        effect: Name of the first effect.
        kind: What the first is to the second. It ``contains`` what is a special case of it. It ``tends to`` what it
            comes arbitrarily near to on the same joint without being it. An effect between two joints ``resembles on
            each joint`` what, on both of them, may leave much the same. It ``may be a sum with`` several others, the
            sum of which is a special case of it, so that no data distinguish the two. It ``resembles a sum of`` several
            others that, all together, may leave much the same where one of them does not. It is ``nearly same in closed
            loop`` as what leaves nearly the same while a controller keeps a joint close to its reference. It has the
            ``same shapes as`` a law of the same orders over the position, from which a constant load does not separate
            it.
        other: Name of the second effect.
    """

    effect: str
    kind: Kind
    other: str


RELATIONS: tuple[Relation, ...] = (
    Relation("direction_dependent_friction", "contains", "coulomb_friction"),
    Relation("direction_dependent_friction", "contains", "viscous_friction"),
    Relation("direction_dependent_friction", "contains", "torque_offset"),
    Relation("direction_dependent_friction", "may be a sum with", "coulomb_friction"),
    Relation("direction_dependent_friction", "may be a sum with", "torque_offset"),
    Relation("stribeck_friction", "contains", "coulomb_friction"),
    # Without a displacement.
    Relation("presliding_friction", "contains", "coulomb_friction"),
    Relation("position_dependent_friction", "contains", "coulomb_friction"),
    Relation("temperature_dependent_friction", "contains", "coulomb_friction"),
    Relation("temperature_dependent_friction", "contains", "viscous_friction"),
    Relation("joint_coupling", "resembles on each joint", "coulomb_friction"),
    Relation("joint_coupling", "resembles on each joint", "viscous_friction"),
    Relation("inertial_parameters", "contains", "payload"),
    # It scales all that a drive works against.
    Relation("torque_constant", "resembles a sum of", "coulomb_friction"),
    Relation("torque_constant", "resembles a sum of", "viscous_friction"),
    Relation("torque_constant", "resembles a sum of", "payload"),
    # A reference that is late by d lacks kp d v while the joint follows it.
    Relation("reference_delay", "nearly same in closed loop", "viscous_friction"),
    # A soft spring that is at rest far away.
    Relation("parasitic_spring", "tends to", "torque_offset"),
    Relation("cogging", "same shapes as", "torque_ripple"),
    Relation("torque_ripple", "same shapes as", "cogging"),
)


def related(effect: str, kind: Kind) -> tuple[str, ...]:
    """Names of the effects to which one has a relation, in the order of the table."""
    return _BY_EFFECT.get((effect, kind), ())


def _by_effect() -> dict[tuple[str, str], tuple[str, ...]]:
    out: dict[tuple[str, str], list[str]] = defaultdict(list)
    for row in RELATIONS:
        out[row.effect, row.kind].append(row.other)
    return {key: tuple(names) for key, names in out.items()}


_BY_EFFECT = _by_effect()
