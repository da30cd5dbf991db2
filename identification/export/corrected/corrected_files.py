"""``corrected.urdf`` and ``corrected.xml``, each loaded again and compared, with notes on what the format lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identification.export.corrected.corrected_mjcf import (
    SHORTEST_STEP,
    compliances_in_mjcf,
    corrected_mjcf,
    zeros_in_file,
)
from identification.export.corrected.corrected_model import CorrectedModel
from identification.export.corrected.corrected_urdf import corrected_urdf, robot_of_urdf
from identification.export.corrected.made_mjcf import made_mjcf
from identification.export.corrected.reload_in_mujoco import rollout_errors
from identification.export.headers import with_comment
from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.mujoco_library import mujoco_problem
from identification.export.model_files.reload import TOLERANCE, some_motion, urdf_difference, versions
from phantom_dyn.array_types import Float
from phantom_dyn.effects import catalogue
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.model.loading import CONFIG_NAME, load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.model.unnamed_file import unnamed_file
from phantom_dyn.motion import Motion

Array = np.ndarray

URDF, MJCF = "corrected.urdf", "corrected.xml"
_HORIZON = 0.2  # length of a rollout [s]

_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class ModelFile:
    """One file of a corrected model.

    Attributes:
        name: Of the file.
        text: Its content, empty if it cannot be written.
        notes: What it leaves out, how it was checked, or why it was not written.
    """

    name: str
    text: str
    notes: tuple[str, ...]


def model_files(
    corrected: CorrectedModel, motion: Motion, *, folder: Path, config: Path | None = None
) -> tuple[ModelFile, ...]:
    """URDF and MJCF of a corrected model.

    Args:
        corrected: The model.
        motion: On which torques are compared.
        folder: Where the files will lie.
        config: The ``robot.yaml`` that was given, None for the one beside the robot's file.

    """
    file = find_robot(corrected.given.source)
    stated, few = robot_config(corrected.given, config), some_motion(motion)

    def urdf() -> tuple[str, float]:
        text = corrected_urdf(corrected, file, folder)
        return text, urdf_difference(text, robot_of_urdf(corrected), few, stated)

    return (
        _checked_file(URDF, urdf, versions().get("urdf", ""), urdf_left_out(corrected, file)),
        _mjcf_file(corrected, few, file, folder),
    )


def robot_config(given: Robot, config: Path | None) -> Path | None:
    """The ``robot.yaml`` of a robot, given or beside its file; None where there is none."""
    beside = find_robot(given.source).with_name(CONFIG_NAME)
    return config if config is not None else beside if beside.is_file() else None


def problem_of_loops(text: str, robot: Robot, config: Path | None) -> str:
    """Why the loops of a ``robot.yaml`` do not close with a URDF, as the end of a sentence; empty where they do.

    Args:
        text: Of the URDF.
        robot: As it was given.
        config: The ``robot.yaml`` that was given, None for the one beside the robot's file.
    """
    if robot.chain is None or not robot.chain.anchors:
        return ""
    with unnamed_file(text.encode(), suffix=".urdf") as path:
        try:
            load_robot(path, config=robot_config(robot, config))
        except PhantomDynError as error:
            return str(error)
    return ""


def _mjcf_file(corrected: CorrectedModel, motion: Motion, file: Path, folder: Path) -> ModelFile:
    try:
        made = made_mjcf(corrected, motion, file=file, folder=folder)
    except PhantomDynError as error:
        return ModelFile(MJCF, "", (f"{MJCF} was not written: {error}",))
    left_out = (*mjcf_left_out(corrected, file, edited=made.edited), *made.left_out)
    return _checked_file(
        MJCF, lambda: (made.text, made.difference), versions().get("mjcf", ""), left_out, unchecked=made.unchecked
    )


def rollout_note(corrected: CorrectedModel, text: str, motion: Motion, tau: Float[Array, "N nv"]) -> tuple[str, ...]:
    """A sentence on how far MuJoCo leaves the recorded motion with the given and with the corrected model.

    Args:
        corrected: The model.
        text: Its MJCF, empty if there is none.
        motion: Of the recordings.
        tau: Logged torque at the same times.

    Returns:
        The sentence; nothing without MuJoCo, or where the motion is too short.
    """
    if not text:
        return ()
    try:
        # The file that is written may hold servos: here the logged torque drives the joints.
        text = corrected_mjcf(corrected)
        if mujoco_problem(text) is not None:
            return ()
        before = rollout_errors(mjcf_text(corrected.given), corrected.given, motion, tau, horizon=_HORIZON)
        after = rollout_errors(text, corrected.given, motion, tau, horizon=_HORIZON)
    except PhantomDynError:
        return ()
    places = zip(corrected.given.joint_names, before, after, corrected.given.position_units, strict=True)
    changes = ", ".join(f"{joint} {one:.3g} {unit} before and {two:.3g} after" for joint, one, two, unit in places)
    return (
        f"{MJCF}: rolled out in MuJoCo for {_HORIZON:g} s under the logged torque, it is this far from the recorded "
        f"motion (root mean square): {changes}.",
    )


def _checked_file(
    name: str,
    make: Callable[[], tuple[str, float]],
    loaded_with: str,
    left_out: tuple[str, ...],
    *,
    unchecked: str = "",
) -> ModelFile:
    try:
        text, difference = make()
    except PhantomDynError as error:
        return ModelFile(name, "", (f"{name} was not written: {error}",))
    if difference > TOLERANCE:
        reason = (
            f"{name} was not written: loaded again with {loaded_with}, it needs torques that differ by "
            f"{difference:.2g} of the largest from the corrected model's, which is an error of phantom-dyn."
        )
        return ModelFile(name, "", (reason,))
    checked = (
        f"not loaded again, as {unchecked}"
        if np.isnan(difference)
        else f"loaded again with {loaded_with}, it needs the same torques"
    )
    if difference > 0:
        checked += f": they differ by at most {difference:.1g} of the largest"
    notes = (f"{name}: {checked}.", *(f"{name}: {sentence[:1].lower()}{sentence[1:]}" for sentence in left_out))
    return ModelFile(name, _with_comment(text, left_out), notes)


def _with_comment(text: str, sentences: tuple[str, ...]) -> str:
    """The text with a comment behind the start of its root element; without sentences as it is."""
    if not sentences:
        return text
    lines = ["What this file cannot say of the corrected model (corrected.yaml has all of it):", *sentences]
    return with_comment(text, lines)


def urdf_left_out(corrected: CorrectedModel, file: Path) -> tuple[str, ...]:
    """Sentences on what a URDF lacks.

    Args:
        corrected: The corrected model.
        file: The robot's file.
    """
    robot, given = corrected.robot, corrected.given
    places = zip(robot.joint_names, robot.rotor_inertia, given.rotor_inertia, strict=True)
    # A URDF that is made of another file has no rotors at all.
    other = file.suffix != ".urdf"
    moved = {name: float(new) for name, new, old in places if new != old or (other and new > 0)}
    out = [*_reduced_laws(corrected), *_lost_effects(corrected)]
    out += _missing("rotor inertias: put them into " + CONFIG_NAME + " (rotor_inertia [kg m^2 or kg])", moved)
    out += _missing("springs (stiffness)", {name: k for name, (k, _) in corrected.springs.items()})
    out += _missing("constant torques [N m or N]", corrected.offsets)
    out += _missing("torque constants (true over logged torque)", corrected.gains)
    out += _missing("delays [s]", corrected.delays)
    out += _missing("lags [s]", corrected.lags)
    out += _missing("play (gap [rad or m])", corrected.plays)
    out += _missing("springs of transmissions (stiffness)", corrected.compliances)
    out += _missing("cogging (largest amplitude)", _largest(corrected))
    out += _missing("couplings (ratio)", {f"{c.first}+{c.second}": c.ratio for c in corrected.couplings})
    if given.chain is not None:
        what = f"state them under loops in a {CONFIG_NAME}" if other else f"keep {CONFIG_NAME} beside it"
        out.append(f"It has no place for closed loops: {what}.")
    if given.locked and not other:
        out.append(
            f"{', '.join(given.locked)} can move in it: name what is fixed under lock in a {CONFIG_NAME} beside it."
        )
    gravity = given.model.gravity.linear
    if not np.allclose(gravity, _GRAVITY):
        numbers = ", ".join(f"{x:g}" for x in gravity)
        out.append(f"It has no place for gravity: state gravity: [{numbers}] in a {CONFIG_NAME} beside it.")
    if other:
        out.append("The given file is no URDF, so this one has bodies, joints and frames, and no shapes.")
    return tuple(out)


def mjcf_left_out(corrected: CorrectedModel, file: Path, *, edited: bool = False) -> tuple[str, ...]:
    """Sentences on what the MJCF file lacks.

    Args:
        corrected: The corrected model.
        file: The robot's file.
        edited: True if it is the given file with the findings.
    """
    out = [*_reduced_laws(corrected), *_lost_effects(corrected)]
    behind = {name: k for name, k in corrected.compliances.items() if name not in compliances_in_mjcf(corrected)}
    out += _missing("a spring behind a play (stiffness)", behind)
    loose = [name for name in (*corrected.plays, *compliances_in_mjcf(corrected)) if not _rotor(corrected, name)]
    if loose:
        out.append(
            f"The rotor inertia of {', '.join(loose)} is not known, so it is a hundredth of what the joint moves: "
            f"state rotor_inertia in {CONFIG_NAME}."
        )
    late = [delay for delay in corrected.delays.values() if delay > 0]
    if corrected.cogging or late:
        out.append("Delays and cogging (dcmotor) need MuJoCo 4.0 or newer; cogging takes no command: leave ctrl at 0.")
    if late:
        out.append(f"Its delays are cut short where the timestep is below {SHORTEST_STEP:g} s: raise nsample there.")
    if edited:
        return tuple(out)
    urdf = file.suffix == ".urdf"
    drives = "limits of torque and speed" if urdf else "actuators"
    but = f", but for limits that {CONFIG_NAME} states" if urdf else ""
    return (*out, f"It lacks shapes, sensors and {drives} of the given file{but}; a motor drives each joint.")


def _rotor(corrected: CorrectedModel, joint: str) -> float:
    return float(corrected.robot.rotor_inertia[corrected.robot.joint_names.index(joint)])


def _reduced_laws(corrected: CorrectedModel) -> list[str]:
    words = [(effect_named(effect.effect, corrected.given).words, effect.joint) for effect in corrected.others]
    return [f"It has, {effect_words.kept}: {joint}." for effect_words, joint in words if effect_words.kept]


def _lost_effects(corrected: CorrectedModel) -> list[str]:
    out = []
    for effect in catalogue.effects_of(corrected.given):
        lost = [other for other in corrected.others if other.effect == effect.name and not effect.words.kept]
        if lost:
            size = effect.parameters(corrected.given, lost[0].joint)[0].name.replace("_", " ")
            what = f"{effect.words.lost or effect.words.name} ({size})"
            out += _missing(what, {str(other.joint): other.theta[0] for other in lost})
    if not zeros_in_file(corrected):
        out += _missing("the zeros of encoders in a closed chain [rad or m]", corrected.zeros)
    return out


def _largest(corrected: CorrectedModel) -> dict[str, float]:
    return {name: max((wave[1] for wave in waves), default=0.0) for name, waves in corrected.cogging.items()}


def _missing(what: str, values: dict[str, float]) -> list[str]:
    if not values:
        return []
    return [f"It has no place for {what}: {', '.join(f'{name} {value:.4g}' for name, value in values.items())}."]
