"""Table of relations between two effects: one is a special case of the other, or both can have the same torque.

`tests/phantom_dyn/effects/test_relations.py` compares the rows with the columns of both effects, so that it notices a
row that is missing or wrong.
"""

from __future__ import annotations

from functools import cache
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
    """One row of the table.

    Attributes:
        effect: Name of the first effect.
        kind: Relation of the first effect to the second:

            - ``contains``: the second is a special case of the first.
            - ``tends to``: on the same joint, the first comes arbitrarily close to the second.
            - ``resembles on each joint``: the first acts between two joints; the second, on each of both, may have
              nearly the same torque.
            - ``may be a sum with``: the sum of the second and of another effect with this relation to the first is a
              special case of the first, so that no data distinguish the two explanations.
            - ``resembles a sum of``: the sum of all effects with this relation may have nearly the torque of the first.
            - ``nearly same in closed loop``: both have nearly the same torque while a controller keeps the joint close
              to its reference.
            - ``same shapes as``: both are waves of the same orders over the position; a constant load does not
              separate them.
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
    # Special case: the displacement is zero.
    Relation("presliding_friction", "contains", "coulomb_friction"),
    Relation("position_dependent_friction", "contains", "coulomb_friction"),
    Relation("temperature_dependent_friction", "contains", "coulomb_friction"),
    Relation("temperature_dependent_friction", "contains", "viscous_friction"),
    Relation("joint_coupling", "resembles on each joint", "coulomb_friction"),
    Relation("joint_coupling", "resembles on each joint", "viscous_friction"),
    Relation("inertial_parameters", "contains", "payload"),
    # A link that is as heavy to turn about every axis is so for each joint before it, as rotors of these joints are.
    Relation("inertial_parameters", "resembles a sum of", "rotor_inertia"),
    # A torque constant scales the whole torque of a drive.
    Relation("torque_constant", "resembles a sum of", "coulomb_friction"),
    Relation("torque_constant", "resembles a sum of", "viscous_friction"),
    Relation("torque_constant", "resembles a sum of", "payload"),
    # A reference that is late by d lowers the torque by kp d v while the joint follows the reference.
    Relation("reference_delay", "nearly same in closed loop", "viscous_friction"),
    # A soft spring whose rest position is far away has a nearly constant torque.
    Relation("parasitic_spring", "tends to", "torque_offset"),
    Relation("cogging", "same shapes as", "torque_ripple"),
    Relation("torque_ripple", "same shapes as", "cogging"),
)


@cache
def related(effect: str, kind: Kind) -> tuple[str, ...]:
    """Names of the effects to which ``effect`` has this relation, in the order of the table."""
    return tuple(row.other for row in RELATIONS if (row.effect, row.kind) == (effect, kind))
