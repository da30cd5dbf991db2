"""The identified model as URDF and MJCF, each loaded again and compared before it is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.mujoco_library import mujoco_problem
from identification.export.model_files.reload import (
    TOLERANCE,
    mujoco_difference,
    some_motion,
    urdf_difference,
    versions,
)
from identification.export.model_files.tree import with_tree_friction
from identification.export.model_files.urdf_file import edited_urdf, new_urdf
from identification.identify.identification import Export
from identification.identify.identified_model import FullModel
from phantom_dyn.dynamics.tree_motion import tree_friction
from phantom_dyn.errors import EstimationError, PhantomDynError
from phantom_dyn.model.loading import CONFIG_NAME
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.motion import Motion

URDF, MJCF = "corrected.urdf", "corrected.xml"


def robots_in_files(full: FullModel, given: Robot) -> dict[str, Robot]:
    """What each file holds of the identified model, by its name.

    Args:
        full: The model.
        given: The robot as its file states it; a URDF has its rotors.
    """
    writable, _ = _without_negative_friction(full.robot)
    return {URDF: _with_armature(writable, given), MJCF: writable}


def exports(full: FullModel, given: Robot, motion: Motion, *, folder: Path, config: Path | None) -> tuple[Export, ...]:
    """URDF and MJCF of the identified model.

    Args:
        full: The model.
        given: The robot as its file states it.
        motion: On which torques are compared.
        folder: Where the files will lie.
        config: The ``robot.yaml`` that was given, None for the one beside the robot's file.

    Raises:
        EstimationError: If a file that was written says something else than the model.
    """
    file = find_robot(given.source)
    beside = file.with_name(CONFIG_NAME)
    stated = config if config is not None else beside if beside.is_file() else None
    few = some_motion(motion)
    writable, cut = _without_negative_friction(full.robot)
    as_urdf = _with_armature(writable, given)

    def urdf() -> tuple[str, float]:
        text = edited_urdf(as_urdf, given, file, folder) if file.suffix == ".urdf" else new_urdf(as_urdf)
        return text, urdf_difference(text, as_urdf, few, stated)

    def mjcf() -> tuple[str, float]:
        text = mjcf_text(writable)
        return text, mujoco_difference(text, writable, few)

    return (
        _checked_export(URDF, urdf, versions().get("urdf", ""), (*cut, *_urdf_left_out(full, given, file))),
        _checked_export(MJCF, mjcf, versions().get("mjcf", ""), (*cut, *_mjcf_left_out(full))),
    )


def _checked_export(
    name: str, make: Callable[[], tuple[str, float]], loaded_with: str, left_out: tuple[str, ...]
) -> Export:
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
    """The robot without negative friction and rotors, which no format takes, and sentences on what was cut."""
    viscous, coulomb = tree_friction(robot)
    names = list(robot.model.names)[1:]
    kinds = (("viscous friction", viscous), ("Coulomb friction", coulomb), ("rotor inertia", robot.model.armature))
    cut = tuple(
        f"The {kind} of {name} came out as {value:.3g}, below zero: the file says zero."
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


def _with_armature(robot: Robot, given: Robot) -> Robot:
    """The robot with the given rotors: a URDF says none, ``robot.yaml`` does."""
    model = robot.model.copy()
    model.armature = given.model.armature
    return replace(robot, model=model)


def _urdf_left_out(full: FullModel, given: Robot, file: Path) -> tuple[str, ...]:
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
    sentences = _left_out(full, "Constant torques are not in it: set qfrc_applied [N m or N]")
    chain = full.robot.chain
    if chain is not None and set(chain.passive) - set(chain.unknowns):
        sentences.append("Joints that follow others by a formula move freely in this file.")
    return (*sentences, "It lacks shapes and sensors of the given file.")


def _left_out(full: FullModel, constant: str) -> list[str]:
    """Sentences on what both formats lack; ``constant`` starts the one on constant torques."""
    names = full.robot.joint_names
    offsets = [f"{name} {value:.4g}" for name, value in zip(names, full.offset, strict=True) if value]
    out = []
    if offsets:
        out.append(f"{constant}: {', '.join(offsets)}.")
    if full.asymmetry:
        out.append(f"Friction that depends on direction is the mean of both in it: {', '.join(full.asymmetry)}.")
    return out
