# pyright: reportAttributeAccessIssue=false
"""Which friction terms are unknowns, and the given robot with the identified inertias, friction and rotors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from identification.estimators.consistent.full_parameters import full_parameters
from identification.estimators.fit import Fit
from identification.regression.regressor import EffectOnJoint
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import EstimationError, ParameterError, UsageError, known_names
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

TERMS = {
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
    "offset": "torque_offset",
    "direction_dependent": "direction_dependent_friction",
}
"""Short name of a term and the effect that it is."""

DEFAULT_TERMS = ("viscous", "coulomb", "offset")
"""Friction terms that are unknowns by default."""

# A body has changed if its parameters differ by more than this share of the largest of their kind: less is rounding.
_SAME = 1e-12


@dataclass(frozen=True)
class JointTerms:
    """Unknowns of every joint beside its rigid body.

    Attributes:
        friction: Keys of `TERMS`.
        rotors: True if the rotor inertias are unknowns too.
    """

    friction: tuple[str, ...] = DEFAULT_TERMS
    rotors: bool = False


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


def effects_of(robot: Robot, terms: JointTerms) -> tuple[EffectOnJoint, ...]:
    """The terms on every joint of a robot, joint by joint.

    Args:
        robot: Gives the joints.
        terms: What is unknown of each.
    """
    effects = [effect_named(TERMS[term]) for term in terms.friction]
    if terms.rotors:
        effects.append(effect_named("rotor_inertia"))
    return tuple((effect, joint) for joint in robot.joint_names for effect in effects)


def without_estimated(robot: Robot, terms: JointTerms) -> Robot:
    """The robot without the friction and rotors that are unknowns, so that their estimates are whole values.

    Args:
        robot: The given model.
        terms: What is unknown of each joint.
    """
    zero = np.zeros(robot.nv)
    both = "direction_dependent" in terms.friction
    if terms.rotors:
        model = robot.model.copy()
        armature = np.array(model.armature)
        armature[list(robot.tree_rows)] = 0.0
        model.armature = armature
        robot = replace(robot, model=model)
    return replace(
        robot,
        viscous_friction=zero if both or "viscous" in terms.friction else robot.viscous_friction,
        coulomb_friction=zero if both or "coulomb" in terms.friction else robot.coulomb_friction,
    )


@dataclass(frozen=True)
class FullModel:
    """The identified model as a robot.

    Attributes:
        robot: With the identified inertias, friction and rotors.
        offset: Constant torque on each joint, positive along it [N m or N], shape ``(nv,)``: no part of the robot.
        asymmetry: Joints whose friction differs by direction; the robot has the mean of both.
        words: How the inertias were chosen, or why they are the given ones.
        possible: False if no possible inertias were found, so that the robot has the given ones.
        moved: Largest move of a base parameter, in standard deviations, that makes bodies possible.
    """

    robot: Robot
    offset: Float[Array, " nv"]
    asymmetry: tuple[str, ...]
    words: str
    possible: bool
    moved: float


def full_model(given: Robot, fitted: Robot, fit: Fit) -> FullModel:
    """The given robot with all parameters of a fit put in.

    Args:
        given: The given model, the reference of the inertias.
        fitted: The robot that was fitted, without what was an unknown.
        fit: Of rigid body and effects.
    """
    model = fitted.model.copy()
    try:
        full = full_parameters(fitted, fit)
    except (ParameterError, EstimationError) as error:
        values = dict(zip((fit.base.names[k] for k in fit.base.independent), fit.theta.tolist(), strict=True))
        words, possible, moved = f"The inertias are those of the given model: {error}", False, float("nan")
    else:
        values = dict(zip(full.names, full.pi.tolist(), strict=True))
        moved = float(np.max(np.abs(full.moved), initial=0.0))
        possible = True
        words = (
            "Of all physically possible bodies with the identified base parameters these are nearest to the given ones."
            if moved < 0.01
            else "No possible bodies have exactly the identified base parameters: these are the nearest, with base "
            f"parameters moved by up to {moved:.2g} standard deviations."
        )
        _set_inertias(model, given, full.pi[: fit.first_effect])
    robot = replace(fitted, model=model)
    offset, asymmetry = np.zeros(robot.nv), []
    viscous, coulomb = np.array(robot.viscous_friction), np.array(robot.coulomb_friction)
    armature = np.array(model.armature)
    for term in fit.effects:
        if term.joint not in robot.joint_names:
            continue
        j = robot.joint_names.index(term.joint)
        names = [parameter.name for parameter in term.effect.parameters(robot, term.joint)]
        theta = np.array([values.get(f"{term.label}.{name}", 0.0) for name in names])
        numbers = term.effect.model_numbers(robot, term.joint, theta)
        viscous[j] += numbers.viscous
        coulomb[j] += numbers.coulomb
        offset[j] += numbers.offset or 0.0
        armature[robot.tree_rows[j]] += numbers.rotor_inertia
        if not numbers.whole:
            asymmetry.append(term.joint)
    model.armature = armature
    robot = replace(robot, model=model, viscous_friction=viscous, coulomb_friction=coulomb)
    return FullModel(robot, offset, tuple(asymmetry), words, possible, moved)


def model_torque(full: FullModel, motion: Motion) -> Float[Array, "N nv"]:
    """Drive torque that the full model needs for a motion, offsets included, shape ``(N, nv)`` [N m or N]."""
    return inverse_dynamics(full.robot, motion) - full.offset


def _set_inertias(model: pin.Model, given: Robot, pi: Float[Array, " p"]) -> None:
    before = standard_parameters(given).reshape(-1, 10)
    after = pi.reshape(-1, 10)
    scale = np.maximum(np.abs(before).max(axis=0), np.abs(after).max(axis=0))
    for j, (old, new) in enumerate(zip(before, after, strict=True), start=1):
        if (np.abs(new - old) > _SAME * scale).any():
            model.inertias[j] = pin.Inertia.FromDynamicParameters(new)
