# pyright: reportAttributeAccessIssue=false
"""Builds the identified model (given robot with identified inertias, friction and rotors) and its URDF and MJCF files.

Each file is loaded again and compared with the model before it is written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from identification.estimators.consistent.consistent import full_parameters
from identification.estimators.fit import Fit
from identification.export.corrected.corrected_urdf import with_rotors_of
from identification.export.file_names import MJCF, URDF
from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.reload import (
    TOLERANCE,
    mujoco_difference,
    mujoco_problem,
    some_motion,
    urdf_difference,
    versions,
)
from identification.export.model_files.tree import with_tree_friction
from identification.export.model_files.urdf_file import edited_urdf, new_urdf
from identification.identify.identification import Export
from identification.regression.regressor import EffectOnJoint
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.dynamics.tree_motion import tree_friction
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import EstimationError, ParameterError, PhantomDynError, UsageError, known_names
from phantom_dyn.model.loading import CONFIG_NAME
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.motion import Motion

TERMS = {
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
    "offset": "torque_offset",
    "direction_dependent": "direction_dependent_friction",
}
"""Name of the effect for the short name of each friction term."""

DEFAULT_TERMS = ("viscous", "coulomb", "offset")
"""Friction terms that are estimated by default."""

# Changes of a body's parameter below this share of the largest parameter of the same kind are rounding errors.
_SAME = 1e-12


@dataclass(frozen=True)
class JointTerms:
    """Unknowns of every joint in addition to the inertial parameters.

    Attributes:
        friction: Friction terms, which are keys of `TERMS`.
        rotors: True to estimate rotor inertias as well.
    """

    friction: tuple[str, ...] = DEFAULT_TERMS
    rotors: bool = False


def friction_terms(words: Sequence[str]) -> tuple[str, ...]:
    """Friction terms from the words of a user; the word ``none`` alone means no term.

    Args:
        words: Short names, or names of the effects.

    Raises:
        UsageError: If a term is unknown, given twice, or contained in another one.
    """
    if list(words) == ["none"]:
        return ()
    terms = {effect: term for term, effect in TERMS.items()}
    found = tuple(terms.get(word, word) for word in words)
    for word in found:
        if word not in TERMS:
            known = known_names(word, [*TERMS, "none"], "terms")
            raise UsageError(f"--friction names the unknown term {word!r}, {known}")
        if found.count(word) > 1:
            raise UsageError(f"--friction names {word} twice; name it once")
    if "direction_dependent" in found and len(found) > 1:
        others = ", ".join(word for word in found if word != "direction_dependent")
        raise UsageError(
            f"--friction names {others} beside direction_dependent, which includes viscous, coulomb and offset; "
            "leave one of the two out"
        )
    return found


def effects_of_terms(robot: Robot, terms: JointTerms) -> tuple[EffectOnJoint, ...]:
    """All terms as effects on every joint of a robot, joint by joint."""
    effects = [effect_named(TERMS[term]) for term in terms.friction]
    if terms.rotors:
        effects.append(effect_named("rotor_inertia"))
    return tuple((effect, joint) for joint in robot.joint_names for effect in effects)


def without_estimated(robot: Robot, terms: JointTerms) -> Robot:
    """The robot without the friction and rotors that are estimated, so that the estimates are their full values."""
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
        robot: The robot with the identified inertias, friction and rotors.
        offset: Constant torque on each joint [N m or N], shape ``(nv,)``, which is not part of ``robot``.
        asymmetry: Joints whose friction differs by direction; ``robot`` has the mean of both directions.
        words: Sentence on how the inertias were chosen, or why they are the given ones.
        possible: False if no possible inertias were found; ``robot`` then has the given ones.
        moved: Largest change of a base parameter that made the bodies physically possible, in standard deviations.
    """

    robot: Robot
    offset: Float[Array, " nv"]
    asymmetry: tuple[str, ...]
    words: str
    possible: bool
    moved: float


def full_model(given: Robot, fitted: Robot, fit: Fit) -> FullModel:
    """The given robot with all parameters of a fit.

    Args:
        given: The given model; the inertias deviate from it as little as possible.
        fitted: The robot that was fitted, without the friction and rotors that were estimated.
        fit: Fit of rigid bodies and effects.
    """
    model = fitted.model.copy()
    try:
        full = full_parameters(fitted, fit)
    except (ParameterError, EstimationError) as error:
        values = dict(zip((fit.base.names[k] for k in fit.base.independent), fit.theta.tolist(), strict=True))
        words, possible, moved = f"The inertias are those of the given model: {error}", False, float("nan")
    else:
        values = dict(zip(full.names, full.pi.tolist(), strict=True))
        moved = float(np.max(np.abs(full.shift), initial=0.0))
        possible = True
        words = (
            "Of all possible bodies with the identified base parameters, these are nearest to the given ones."
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
    """Drive torque of the full model for a motion, with offsets, shape ``(N, nv)`` [N m or N]."""
    return inverse_dynamics(full.robot, motion) - full.offset


def _set_inertias(model: pin.Model, given: Robot, pi: Float[Array, " p"]) -> None:
    """Set the inertias of the bodies in ``model`` that differ from the given ones."""
    before = standard_parameters(given).reshape(-1, 10)
    after = pi.reshape(-1, 10)
    scale = np.maximum(np.abs(before).max(axis=0), np.abs(after).max(axis=0))
    for j, (old, new) in enumerate(zip(before, after, strict=True), start=1):
        if (np.abs(new - old) > _SAME * scale).any():
            model.inertias[j] = pin.Inertia.FromDynamicParameters(new)


def robots_in_files(full: FullModel, given: Robot) -> dict[str, Robot]:
    """The robot that each file describes, by the file's name.

    Args:
        full: The identified model.
        given: The robot as its file states it. A URDF cannot express rotor inertias: its robot has the given ones.
    """
    writable, _ = _without_negative_friction(full.robot)
    return {URDF: with_rotors_of(writable, given), MJCF: writable}


def exports(full: FullModel, given: Robot, motion: Motion, *, folder: Path, config: Path | None) -> tuple[Export, ...]:
    """URDF and MJCF of the identified model.

    Args:
        full: The identified model.
        given: The robot as its file states it.
        motion: Motion for which torques are compared.
        folder: Folder into which the files will be written.
        config: The given ``robot.yaml``; None for the one in the folder of the robot's file.

    Raises:
        EstimationError: If a written file gives other torques than the model.
    """
    file = find_robot(given.source)
    beside = file.with_name(CONFIG_NAME)
    if config is None and beside.is_file():
        config = beside
    few_samples = some_motion(motion)
    writable, cut = _without_negative_friction(full.robot)
    as_urdf = with_rotors_of(writable, given)

    def urdf() -> tuple[str, float]:
        text = edited_urdf(as_urdf, given, file, folder) if file.suffix == ".urdf" else new_urdf(as_urdf)
        return text, urdf_difference(text, as_urdf, few_samples, config)

    def mjcf() -> tuple[str, float]:
        text = mjcf_text(writable)
        return text, mujoco_difference(text, writable, few_samples)

    return (
        _checked_export(URDF, urdf, versions().get("urdf", ""), (*cut, *_urdf_left_out(full, given, file))),
        _checked_export(MJCF, mjcf, versions().get("mjcf", ""), (*cut, *_mjcf_left_out(full))),
    )


def _checked_export(
    name: str, make: Callable[[], tuple[str, float]], loaded_with: str, left_out: tuple[str, ...]
) -> Export:
    """A model file with the result of its check."""
    try:
        text, difference = make()
    except PhantomDynError as error:
        return Export(name, "", "", float("nan"), TOLERANCE, (f"Not written: {error}",))
    if np.isnan(difference):
        return Export(name, text, "", difference, TOLERANCE, (*left_out, f"Not loaded again: {mujoco_problem(text)}."))
    if difference > TOLERANCE:
        raise EstimationError(
            f"{name}, loaded again with {loaded_with}, needs torques that differ by {difference:.2g} of the largest "
            f"from the identified model's, more than {TOLERANCE:g}: this is an error of phantom-dyn, so nothing is "
            "written."
        )
    return Export(name, text, loaded_with, difference, TOLERANCE, left_out)


def _without_negative_friction(robot: Robot) -> tuple[Robot, tuple[str, ...]]:
    """The robot with zero in place of negative friction and rotor inertias (no format allows these), and sentences."""
    viscous, coulomb = tree_friction(robot)
    names = list(robot.model.names)[1:]
    kinds = (("viscous friction", viscous), ("Coulomb friction", coulomb), ("rotor inertia", robot.model.armature))
    cut = tuple(
        f"The {kind} of {name} came out as {value:.3g}, below zero: the file has zero."
        for kind, values in kinds
        for name, value in zip(names, values, strict=True)
        if value < 0
    )
    if not cut:
        return robot, ()
    model = robot.model.copy()
    model.armature = np.maximum(model.armature, 0.0)
    moved = with_tree_friction(robot, np.maximum(viscous, 0.0), np.maximum(coulomb, 0.0))
    return replace(moved, model=model), cut


def _urdf_left_out(full: FullModel, given: Robot, file: Path) -> tuple[str, ...]:
    """Sentences on identified parameters that the URDF does not contain."""
    rotors = [
        f"{name} {value:.4g}"
        for name, value, old in zip(full.robot.joint_names, full.robot.rotor_inertia, given.rotor_inertia, strict=True)
        if value != old
    ]
    sentences = _left_out(full, "It has no place for constant torques, positive along the joint [N m or N]")
    if rotors:
        sentences.append(
            f"URDF has no place for rotor inertias: put them into {CONFIG_NAME} (rotor_inertia [kg m^2 or kg]: "
            f"{', '.join(rotors)})."
        )
    elif full.robot.rotor_inertia.any():
        sentences.append(f"URDF has no place for rotor inertias: keep {CONFIG_NAME} beside it.")
    if given.chain is not None:
        sentences.append(f"URDF has no place for closed loops: keep {CONFIG_NAME} beside it.")
    if file.suffix != ".urdf":
        sentences.append("The given file is no URDF, so this one has bodies, joints and frames, and no shapes.")
    return tuple(sentences)


def _mjcf_left_out(full: FullModel) -> tuple[str, ...]:
    """Sentences on identified parameters and elements of the given file that the MJCF does not contain."""
    sentences = _left_out(full, "Constant torques are not in it: set qfrc_applied [N m or N]")
    chain = full.robot.chain
    if chain is not None and set(chain.passive) - set(chain.unknowns):
        sentences.append("Joints that follow others by a formula move freely in this file.")
    return (*sentences, "It lacks shapes and sensors of the given file.")


def _left_out(full: FullModel, constant: str) -> list[str]:
    """Sentences on parameters that neither format contains; ``constant`` begins the sentence on constant torques."""
    names = full.robot.joint_names
    offsets = [f"{name} {value:.4g}" for name, value in zip(names, full.offset, strict=True) if value]
    out = []
    if offsets:
        out.append(f"{constant}: {', '.join(offsets)}.")
    if full.asymmetry:
        out.append(f"Friction that depends on direction is the mean of both in it: {', '.join(full.asymmetry)}.")
    return out
