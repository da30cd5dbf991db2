# pyright: reportAttributeAccessIssue=false
"""Builds ``corrected.urdf`` and ``corrected.xml``, loads them again, and notes findings that a format cannot express.

The MJCF is an edited copy of the given one. A new MJCF is built if the robot's file is a URDF, or if settings of the
given MJCF would change the meaning of the findings; a note states the reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
from identification.export.corrected.given_mjcf import edited_mjcf
from identification.export.corrected.reload_in_mujoco import edited_difference, rollout_errors, torque_difference
from identification.export.corrected.urdf_shapes import with_urdf_shapes
from identification.export.file_names import MJCF, URDF, YAML
from identification.export.headers import with_comment
from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.reload import (
    TOLERANCE,
    loaded_urdf,
    mujoco_problem,
    some_motion,
    urdf_difference,
    versions,
)
from identification.notes import Code, Note
from identification.words.note_words import sentences
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects import catalogue
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import EstimationError, PhantomDynError, RobotError
from phantom_dyn.model.from_mjcf.mjcf import drawn_configuration
from phantom_dyn.model.loading import CONFIG_NAME, read_model
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.motion import Motion


@dataclass(frozen=True)
class MadeMjcf:
    """Text of an MJCF with the result of its check.

    Attributes:
        text: Text of the file.
        difference: Largest difference between the torques in MuJoCo and those of the corrected model, divided by the
            largest torque; NaN if the file was not loaded.
        unchecked: Why the file was not loaded again, as the end of a sentence; empty if it was loaded.
        edited: True if the file is a copy of the given file with the findings.
        left_out: Notes on numbers that the actuators cannot express, and on why the file is not a copy of the given
            file.
    """

    text: str
    difference: float
    unchecked: str
    edited: bool
    left_out: tuple[Note, ...] = ()


def checked_mjcf(corrected: CorrectedModel, motion: Motion, *, file: Path, folder: Path) -> MadeMjcf:
    """The MJCF of a corrected model: a copy of the given MJCF with the findings, or a new file.

    Args:
        corrected: The model.
        motion: Motion for which torques are compared.
        file: The robot's file.
        folder: Folder into which the file will be written.

    Raises:
        ParameterError: If a body cannot exist, or MuJoCo does not accept it.
        RobotError: If MuJoCo refuses the text.
        EstimationError: If the torques of the file differ from those of the model.
    """
    if file.suffix == ".urdf":
        return _new_mjcf(corrected, motion, file, folder, ())
    try:
        return _edited_mjcf(corrected, motion, file, folder)
    except PhantomDynError as error:
        reason = Note(Code.GIVEN_FILE_NOT_IN_IT, None, {"problem": str(error)})
        return _new_mjcf(corrected, motion, file, None, (reason,))


def _new_mjcf(
    corrected: CorrectedModel, motion: Motion, file: Path, folder: Path | None, left_out: tuple[Note, ...]
) -> MadeMjcf:
    """An MJCF that is built from the model, with the shapes of the robot's URDF if ``folder`` is given."""
    text = corrected_mjcf(corrected)
    problem = mujoco_problem(text) or ""
    difference = torque_difference(text, corrected, motion)
    if folder is None:
        return MadeMjcf(text, difference, problem, False, left_out)
    try:
        # The text that is checked has absolute paths of meshes, because the folder may not exist yet.
        loaded, without = with_urdf_shapes(text, corrected.robot, file, None)
        difference = torque_difference(loaded, corrected, motion)
        if difference > TOLERANCE:
            raise EstimationError("with them, the torques in MuJoCo are different.")
        text = with_urdf_shapes(text, corrected.robot, file, folder)[0]
    except (PhantomDynError, ValueError) as error:
        without = (f"The shapes of the URDF are not in it: {error}",)
        difference = torque_difference(text, corrected, motion)
    remarks = (Note(Code.FILE_REMARK, None, {"sentence": sentence}) for sentence in without)
    return MadeMjcf(text, difference, problem, False, (*left_out, *remarks))


def _edited_mjcf(corrected: CorrectedModel, motion: Motion, file: Path, folder: Path) -> MadeMjcf:
    """The given MJCF with the findings, checked in MuJoCo."""
    text, left_out = edited_mjcf(corrected, file, folder)
    problem = mujoco_problem(text) or _problem_of_given_file(file)
    if problem:
        return MadeMjcf(text, float("nan"), problem, True, tuple(left_out.values()))
    # The text that is checked has absolute paths of meshes, because the folder may not exist yet.
    written = replace(corrected, offsets={name: x for name, x in corrected.offsets.items() if name not in left_out})
    difference = edited_difference(edited_mjcf(corrected, file, None)[0], written, motion, _fixed_positions(file))
    if difference > TOLERANCE:
        raise EstimationError(
            f"with the findings in it, the torques in MuJoCo differ from the corrected model's by {difference:.2g} of "
            "the largest, as it has parts that are not read into the model."
        )
    return MadeMjcf(text, difference, "", True, tuple(left_out.values()))


def _problem_of_given_file(file: Path) -> str:
    """Why MuJoCo refuses the given file (for example because meshes are missing); empty if MuJoCo accepts it."""
    import mujoco

    try:
        mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        return f"MuJoCo refuses the given file as well ({' '.join(str(error).split())})"
    return ""


def _fixed_positions(file: Path) -> dict[str, float]:
    """Positions of the file's joints that are not in the robot: joints that follow others, and joints for backlash."""
    try:
        facts, model = read_model(file)
    except RobotError:
        return {}
    drawn = drawn_configuration(model)
    play = {name: float(drawn[model.joints[model.getJointId(name)].idx_q]) for name in facts.play}
    return {name: law.offset for name, law in facts.followers.items()} | play


_HORIZON = 0.2  # length of a rollout [s]

_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class ModelFile:
    """One file of a corrected model.

    Attributes:
        name: Name of the file.
        text: Content of the file, empty if it cannot be written.
        notes: Notes on findings that the file does not contain, on its check, or on why it was not written.
    """

    name: str
    text: str
    notes: tuple[Note, ...]


def model_files(
    corrected: CorrectedModel, motion: Motion, *, folder: Path, config: Path | None = None
) -> tuple[ModelFile, ...]:
    """URDF and MJCF of a corrected model.

    Args:
        corrected: The model.
        motion: Motion for which torques are compared.
        folder: Folder into which the files will be written.
        config: The given ``robot.yaml``; None to use the one in the folder of the robot's file, if it exists.
    """
    file = find_robot(corrected.given.source)
    few_samples = some_motion(motion)
    urdf = _urdf_file(corrected, few_samples, file, folder, robot_config(corrected.given, config))
    return urdf, _mjcf_file(corrected, few_samples, file, folder)


def _urdf_file(corrected: CorrectedModel, motion: Motion, file: Path, folder: Path, config: Path | None) -> ModelFile:
    """The URDF of a corrected model with its notes; without text if it cannot be built."""
    try:
        text = corrected_urdf(corrected, file, folder)
        difference = urdf_difference(text, robot_of_urdf(corrected), motion, config)
    except PhantomDynError as error:
        return ModelFile(URDF, "", (not_written_note(error, URDF),))
    return _checked_file(URDF, text, difference, versions().get("urdf", ""), urdf_left_out(corrected, file))


def robot_config(given: Robot, config: Path | None) -> Path | None:
    """The ``robot.yaml`` of a robot: the given one, or the one in the folder of the robot's file; None if neither."""
    default_config = find_robot(given.source).with_name(CONFIG_NAME)
    own = default_config if default_config.is_file() else None
    return own if config is None else config


def problem_of_loops(text: str, robot: Robot, config: Path | None) -> str:
    """Why the loops of a ``robot.yaml`` do not close with a URDF, as the end of a sentence; empty if they close.

    Args:
        text: Text of the URDF.
        robot: The given model.
        config: The given ``robot.yaml``; None to use the one in the folder of the robot's file.
    """
    if robot.chain is None or not robot.chain.anchors:
        return ""
    try:
        loaded_urdf(text, robot_config(robot, config))
    except PhantomDynError as error:
        return str(error)
    return ""


def _mjcf_file(corrected: CorrectedModel, motion: Motion, file: Path, folder: Path) -> ModelFile:
    """The MJCF of a corrected model with its notes; without text if it cannot be built."""
    try:
        made = checked_mjcf(corrected, motion, file=file, folder=folder)
    except PhantomDynError as error:
        return ModelFile(MJCF, "", (not_written_note(error, MJCF),))
    left_out = (*mjcf_left_out(corrected, file, edited=made.edited), *made.left_out)
    loaded_with = versions().get("mjcf", "")
    return _checked_file(MJCF, made.text, made.difference, loaded_with, left_out, unchecked=made.unchecked)


def rollout_note(corrected: CorrectedModel, text: str, motion: Motion, tau: Float[Array, "N nv"]) -> tuple[Note, ...]:
    """A note on the difference between simulated (MuJoCo) and recorded motion, for the given and the corrected model.

    Args:
        corrected: The model.
        text: MJCF of the model, empty if there is none.
        motion: Motion of the recordings.
        tau: Logged torque at the same times [N m or N].

    Returns:
        The note; empty without MuJoCo, if the motion is too short, or for a floating base.
    """
    if not text or corrected.given.floating:
        return ()
    try:
        # A new MJCF with motors is used, because the written file may have servos.
        text = corrected_mjcf(corrected)
        if mujoco_problem(text) is not None:
            return ()
        before = rollout_errors(mjcf_text(corrected.given), corrected.given, motion, tau, horizon=_HORIZON)
        after = rollout_errors(text, corrected.given, motion, tau, horizon=_HORIZON)
    except PhantomDynError:
        return ()
    places = tuple(zip(corrected.given.joint_names, before, after, corrected.given.position_units, strict=True))
    return (Note(Code.ROLLED_OUT, None, {"files": (MJCF,), "seconds": _HORIZON, "places": places}),)


def _checked_file(
    name: str, text: str, difference: float, loaded_with: str, left_out: tuple[Note, ...], *, unchecked: str = ""
) -> ModelFile:
    """A model file with a note on its check; without text if its torques differ from those of the model."""
    if difference > TOLERANCE:
        numbers = {"files": (name,), "loaded_with": loaded_with, "difference": difference}
        return ModelFile(name, "", (Note(Code.WRITTEN_WRONG, None, numbers),))
    numbers = {"files": (name,), "loaded_with": loaded_with, "unchecked": unchecked}
    checked = Note(Code.CHECKED, None, {**numbers, "difference": None if np.isnan(difference) else difference})
    notes = (checked, *(note.with_numbers(files=(name,)) for note in left_out))
    return ModelFile(name, _with_comment(text, sentences(left_out)), notes)


def not_written_note(error: Exception, *files: str) -> Note:
    """A note on files that could not be written because of an error."""
    return Note(Code.NOT_WRITTEN, None, {"files": files, "problem": str(error)})


_IN_YAML = f" ({YAML} has all of it)"


def _with_comment(text: str, sentences: tuple[str, ...]) -> str:
    """The text with a comment after the start tag of its root element; unchanged without sentences."""
    if not sentences:
        return text
    return with_comment(text, [f"What this file cannot express of the corrected model{_IN_YAML}:", *sentences])


def without_yaml(text: str) -> str:
    """The text of a URDF or MJCF without the reference to ``corrected.yaml``, for runs that do not write it."""
    return text.replace(f"of the corrected model{_IN_YAML}:", "of the corrected model:", 1)


def urdf_left_out(corrected: CorrectedModel, file: Path) -> tuple[Note, ...]:
    """Notes on parts of the corrected model that the URDF cannot express.

    Args:
        corrected: The corrected model.
        file: The robot's file.
    """
    robot, given = corrected.robot, corrected.given
    places = zip(robot.joint_names, robot.rotor_inertia, given.rotor_inertia, strict=True)
    # A URDF that is built from another kind of file has no rotors at all.
    other = file.suffix != ".urdf"
    rotors = {name: float(new) for name, new, old in places if new != old or (other and new > 0)}
    missing = {
        "rotor_inertia": rotors,
        "stiffness": {name: stiffness for name, (stiffness, _) in corrected.springs.items()},
        "offset": corrected.offsets,
        "torque_constant": corrected.gains,
        "delay": corrected.delays,
        "reference_delay": corrected.reference_delays,
        "lag": corrected.lags,
        "play": corrected.plays,
        "transmission": corrected.compliances,
        "cogging": {name: max((w[1] for w in waves), default=0.0) for name, waves in corrected.cogging.items()},
        "coupling": {f"{c.first}+{c.second}": c.ratio for c in corrected.couplings},
    }
    out = [*_reduced_laws(corrected), *_lost_effects(corrected)]
    for quantity, values in missing.items():
        out += _missing(quantity, values)
    if given.chain is not None:
        out.append(Note(Code.NO_PLACE_FOR_LOOPS, None, {"kept": not other, "config": CONFIG_NAME}))
    if given.locked and not other:
        out.append(Note(Code.LOCKED_CAN_MOVE, None, {"names": tuple(given.locked), "config": CONFIG_NAME}))
    gravity = given.model.gravity.linear
    if not np.allclose(gravity, _GRAVITY):
        out.append(Note(Code.NO_PLACE_FOR_GRAVITY, None, {"gravity": tuple(gravity.tolist()), "config": CONFIG_NAME}))
    if other:
        out.append(Note(Code.NO_SHAPES))
    return tuple(out)


def mjcf_left_out(corrected: CorrectedModel, file: Path, *, edited: bool = False) -> tuple[Note, ...]:
    """Notes on parts of the corrected model that the MJCF cannot express.

    Args:
        corrected: The corrected model.
        file: The robot's file.
        edited: True if the MJCF is a copy of the given file with the findings.
    """
    out = [*_reduced_laws(corrected), *_lost_effects(corrected)]
    springs = {name: k for name, k in corrected.compliances.items() if name not in compliances_in_mjcf(corrected)}
    out += _missing("spring_behind_play", springs)
    rotors = dict(zip(corrected.robot.joint_names, corrected.robot.rotor_inertia, strict=True))
    without_rotor = [name for name in (*corrected.plays, *compliances_in_mjcf(corrected)) if not rotors[name]]
    if without_rotor:
        out.append(Note(Code.ROTOR_UNKNOWN, None, {"names": tuple(without_rotor), "config": CONFIG_NAME}))
    out += [] if edited else _missing("reference_delay", corrected.reference_delays)
    late = [delay for delay in corrected.delays.values() if delay > 0]
    if corrected.cogging or late:
        out.append(Note(Code.NEEDS_NEWER_MUJOCO))
    if late:
        out.append(Note(Code.DELAYS_CUT, None, {"shortest": SHORTEST_STEP}))
    if edited:
        return tuple(out)
    return (*out, Note(Code.ONLY_MOTORS, None, {"of_urdf": file.suffix == ".urdf", "config": CONFIG_NAME}))


def _reduced_laws(corrected: CorrectedModel) -> list[Note]:
    """Notes on effects of which a model file contains a part."""
    words = [(effect_named(effect.effect, corrected.given).words, effect.joint) for effect in corrected.others]
    return [Note(Code.REDUCED_LAW, joint, {"words": one}) for one, joint in words if one.kept]


def _lost_effects(corrected: CorrectedModel) -> list[Note]:
    """Notes on effects of which a model file contains nothing."""
    out = []
    for effect in catalogue.effects_of(corrected.given):
        lost = [other for other in corrected.others if other.effect == effect.name and not effect.words.kept]
        if lost:
            size = effect.parameters(corrected.given, lost[0].joint)[0].name
            values = {str(other.joint): other.theta[0] for other in lost}
            numbers = {"words": effect.words, "parameter": size, "values": values}
            out.append(Note(Code.NO_PLACE_FOR_EFFECT, None, numbers))
    if not zeros_in_file(corrected):
        out += _missing("zeros_in_chain", corrected.zeros)
    return out


def _missing(quantity: str, values: dict[str, float]) -> list[Note]:
    """A note on a quantity that the file cannot express, by joint; empty without values."""
    numbers = {"quantity": quantity, "values": values, "config": CONFIG_NAME}
    return [Note(Code.NO_PLACE, None, numbers)] if values else []
