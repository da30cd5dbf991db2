"""Which friction terms are unknowns, and the robot without those that its file states already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identification.regressor import EffectOnJoint
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import UsageError
from phantom_dyn.naming import known_names
from phantom_dyn.robot import Robot

TERMS = {
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
    "offset": "torque_offset",
    "direction_dependent": "direction_dependent_friction",
}
"""Short name of a term and the effect that it is."""

DEFAULT_TERMS = ("viscous", "coulomb", "offset")


def friction_terms(words: Sequence[str]) -> tuple[str, ...]:
    """The terms that a user names; ``none`` alone is no term.

    Args:
        words: Short names, or those of the effects.

    Raises:
        UsageError: If a term is unknown, given twice, or contained in another one.
    """
    if list(words) == ["none"]:
        return ()
    short = {effect: term for term, effect in TERMS.items()}
    found = tuple(short.get(word, word) for word in words)
    for word in found:
        if word not in TERMS:
            known = known_names(word, [*TERMS, "none"], "terms")
            raise UsageError(f"--friction names the unknown term {word!r}, {known}")
        if found.count(word) > 1:
            raise UsageError(f"--friction names {word} twice; name it once")
    if "direction_dependent" in found and len(found) > 1:
        others = ", ".join(word for word in found if word != "direction_dependent")
        raise UsageError(
            f"--friction names {others} beside direction_dependent, which holds viscous, coulomb and offset already; "
            "leave one of the two out"
        )
    return found


def effects_of(robot: Robot, terms: Sequence[str], *, rotors: bool = False) -> tuple[EffectOnJoint, ...]:
    """The terms on every joint of a robot, joint by joint.

    Args:
        robot: Gives the joints.
        terms: Keys of `TERMS`.
        rotors: True if the rotor inertias are unknowns too.
    """
    effects = [effect_named(TERMS[term]) for term in terms] + ([effect_named("rotor_inertia")] if rotors else [])
    return tuple((effect, joint) for joint in robot.joint_names for effect in effects)


def without_estimated(robot: Robot, terms: Sequence[str], *, rotors: bool = False) -> Robot:
    """The robot without the friction and rotors that are unknowns, so that their estimates are whole values.

    Args:
        robot: As its file states it.
        terms: Keys of `TERMS`.
        rotors: True if the rotor inertias are unknowns too.
    """
    zero = np.zeros(robot.nv)
    both = "direction_dependent" in terms
    if rotors:
        model = robot.model.copy()
        armature = np.array(model.armature)
        armature[list(robot.tree_rows)] = 0.0
        model.armature = armature
        robot = replace(robot, model=model)
    return replace(
        robot,
        viscous_friction=zero if both or "viscous" in terms else robot.viscous_friction,
        coulomb_friction=zero if both or "coulomb" in terms else robot.coulomb_friction,
    )
