"""Builds the texts of all model and law files of a diagnosis, and checks each of them against the recordings.

The files are ``corrected.yaml``, models for simulators, ranges for training and laws for control.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np

from identification.diagnosis.columns.known_geometry import effects_on_torques
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Diagnosis, FittedNumbers
from identification.diagnosis.written import WrittenFile
from identification.export.check.checked_files import FileCheck, RecordedTorques, passed_files
from identification.export.corrected.corrected_files import (
    ModelFile,
    model_files,
    not_written_note,
    problem_of_loops,
    robot_config,
    rollout_note,
    without_yaml,
)
from identification.export.corrected.corrected_model import CorrectedModel, corrected_model
from identification.export.corrected.corrected_urdf import (
    corrections_in_files,
    joint_corrections,
    mjcf_with_corrected_joints,
    not_in_files,
    urdf_with_corrected_joints,
)
from identification.export.corrected.corrected_yaml import write_corrected
from identification.export.corrected.found_effects import effect_of, findings_in_all_recordings, robot_within_tolerances
from identification.export.corrected.possible_bodies import with_possible_bodies
from identification.export.file_names import (
    FEEDFORWARD,
    ISAAC,
    MJCF,
    NAMES,
    RANDOMISATION,
    RESIDUAL,
    RESIDUAL_TABLE,
    SIMULATORS,
    TABLE,
    URDF,
    YAML,
)
from identification.export.uses.feedforward import feedforward_code, feedforward_table
from identification.export.uses.randomisation import randomisation_of
from identification.export.uses.randomisation_file import randomisation_text
from identification.export.uses.residual_model import residual_code, residual_note, residual_of, residual_table
from identification.export.uses.simulator_files import isaac_lab_text, simulators_text
from identification.geometry.terms import ZERO
from identification.notes import INCOMPLETE_FILES, Code, Note, Remark
from identification.regression.triangular import one_blas_thread
from phantom_dyn.errors import EstimationError, PhantomDynError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

_POSTURES = 3  # number of samples at which a model is compared with its file if no motion was recorded
_COMPLETE = 2  # number of model files: URDF and MJCF


def not_written(out: Path, paths: Iterable[Path]) -> tuple[str, ...]:
    """Names of the usual files of a diagnosis that are missing among the written ``paths`` of a folder."""
    written = set(paths)
    return tuple(name for name in NAMES if out / name not in written)


def incomplete_file_notes(notes: Iterable[Remark]) -> tuple[Note, ...]:
    """The notes of `export_texts` on files that were not written, and on findings that a file does not contain."""
    return tuple(note for note in notes if isinstance(note, Note) and note.code in INCOMPLETE_FILES)


# With more threads the order of sums, and so the last digits, would depend on the machine.
@one_blas_thread()
def export_texts(
    diagnosis: Diagnosis,
    robot: Robot,
    *,
    folder: Path,
    known: tuple[KnownEffect, ...] = (),
    config: Path | None = None,
) -> tuple[dict[str, str], Diagnosis]:
    """Texts of all files that can be written, by name, and the diagnosis with notes on the files.

    Args:
        diagnosis: The diagnosis.
        robot: The given model.
        folder: Folder into which the files will be written.
        known: Effects that the given model already contains.
        config: The given ``robot.yaml``; None to use the one in the folder of the robot's file, if it exists.
    """
    if diagnosis.poses_alone:
        texts, diagnosis = _texts_of_poses(diagnosis, robot, folder, config, known)
        return {YAML: write_corrected(diagnosis, robot.source, robot.sha256), **texts}, diagnosis
    if any(isinstance(remark, Note) and remark.code is Code.MODEL_IN_COMMON for remark in diagnosis.notes):
        # The findings are relative to a fitted model, not to the given model whose files would be changed.
        return {}, diagnosis
    best, other_numbers = _built_files(diagnosis, robot, folder, known, config), None
    # Other fits of the same findings are tried until no file is refused.
    for numbers in diagnosis.numbers:
        if not best.refused:
            break
        built = _built_files(_with_numbers(diagnosis, numbers), robot, folder, known, config)
        if len(built.refused) < len(best.refused):
            best, other_numbers = built, numbers
    notes = best.notes
    if other_numbers is not None:
        stated = {one.quantity for one in diagnosis.adjusted}
        unstated = sum(one.quantity not in stated for one in other_numbers.adjusted) if YAML in best.texts else 0
        notes = (*notes, Note(Code.OTHER_NUMBERS, None, {"unstated": unstated}))
    return best.texts, replace(diagnosis, notes=(*diagnosis.notes, *notes), files=best.files)


def _with_numbers(diagnosis: Diagnosis, numbers: FittedNumbers) -> Diagnosis:
    """The diagnosis with other fitted sizes and changes within tolerance."""
    findings = tuple(
        replace(one, parameters=numbers.sizes.get((one.effect, one.joint), one.parameters))
        for one in diagnosis.findings
    )
    return replace(diagnosis, findings=findings, adjusted=numbers.adjusted, numbers=(numbers,))


@dataclass(frozen=True)
class _BuiltFiles:
    """The files that were built with one set of fitted numbers.

    Attributes:
        texts: Texts of the files that passed their check, by name.
        files: Records of the checks.
        notes: Notes on the files.
        refused: Names of the files that did not pass their check, or could not be built.
    """

    texts: dict[str, str]
    files: tuple[WrittenFile, ...]
    notes: tuple[Note, ...]
    refused: tuple[str, ...]


def _built_files(
    diagnosis: Diagnosis, robot: Robot, folder: Path, known: tuple[KnownEffect, ...], config: Path | None
) -> _BuiltFiles:
    """The files of a diagnosis, built with the numbers that the diagnosis states, and checked.

    Raises:
        ParameterError: If the value of a parameter is not finite.
    """
    texts, notes = {YAML: write_corrected(diagnosis, robot.source, robot.sha256)}, list[Note]()
    known_torques = effects_on_torques(known)
    found = tuple(effect_of(robot, finding) for finding in findings_in_all_recordings(diagnosis))
    stated = robot_config(robot, config)

    fitted = diagnosis.numbers[0] if diagnosis.numbers else FittedNumbers((), {})
    measured = None if diagnosis.replay is None else RecordedTorques(diagnosis.replay, robot, known_torques, fitted)

    def check_of(corrected: CorrectedModel) -> FileCheck | None:
        return None if measured is None else FileCheck(diagnosis, measured, corrected, found, stated)

    try:
        models, tolerance_notes = _models(diagnosis, robot, (*known_torques, *found), folder, config, check_of)
    except PhantomDynError as error:
        # corrected.yaml is written in any case, because its laws do not need possible bodies.
        texts, files, refused = passed_files(texts, check_of(corrected_model(robot, known_torques)))
        missing = tuple(name for name in NAMES if name not in texts)
        return _BuiltFiles(texts, files, (not_written_note(error, *NAMES[1:]), *refused), missing)
    in_one_recording = tuple(finding.effect for finding in diagnosis.findings if finding.recording is not None)
    if in_one_recording:
        notes.append(Note(Code.ONE_RECORDING_ONLY, None, {"effects": in_one_recording}))
    notes += (*models.notes, *tolerance_notes)
    for file in models.files:
        texts |= {file.name: file.text} if file.text else {}
        notes += file.notes
    mjcf_before_moves = texts.get(MJCF)
    texts, move_notes = _with_moved_joints(texts, diagnosis, robot, config, known)
    notes += move_notes
    corrected, evidence = models.corrected, diagnosis.evidence
    check = check_of(corrected)
    texts, files, refused = passed_files(texts, check, mjcf_has_moved_joints=texts.get(MJCF) != mjcf_before_moves)
    notes += refused
    if YAML not in texts:
        texts = {name: without_yaml(text) for name, text in texts.items()}
    further = dict[str, str]()
    for name, make in _further_builders(diagnosis, corrected, known_torques, {URDF, MJCF} & set(texts)).items():
        try:
            further[name] = make()
        except PhantomDynError as error:
            notes.append(not_written_note(error, name))
    further, further_files, refused = passed_files(further, check)
    texts, files = texts | further, (*files, *further_files)
    notes += refused
    residual = residual_of(diagnosis)
    notes += rollout_note(corrected, texts.get(MJCF, ""), _recorded_motion(diagnosis), evidence.tau_measured)
    if residual is not None and RESIDUAL in texts:
        notes.append(residual_note(residual))
    corrections = joint_corrections(diagnosis.geometry, _zeros_by_torque(diagnosis), known)
    if corrections and FEEDFORWARD in texts:
        notes.append(Note(Code.AS_IT_WAS_GIVEN, None, {"files": (FEEDFORWARD,), "names": tuple(corrections)}))
    wanted = NAMES
    if robot.floating:
        problem = "the torque of another motion depends on the motion of the base, which is not known in advance."
        notes.append(Note(Code.NOT_WRITTEN, None, {"files": (FEEDFORWARD, TABLE), "problem": problem}))
        wanted = tuple(name for name in NAMES if name not in (FEEDFORWARD, TABLE))
    return _BuiltFiles(texts, files, tuple(notes), tuple(name for name in wanted if name not in texts))


def _zeros_by_torque(diagnosis: Diagnosis) -> set[str]:
    """Joints whose encoder zeros were found from the torques: the corrected model already contains these zeros."""
    return {one.joint or "" for one in diagnosis.findings if one.effect == ZERO}


def _places_not_in(file: str, names: Iterable[str], *, given: bool) -> Note:
    """A note on joints whose corrected placements a file does not contain."""
    return Note(Code.PLACES_NOT_IN_IT, None, {"files": (file,), "names": tuple(names), "given": given})


def _with_moved_joints(
    texts: dict[str, str], diagnosis: Diagnosis, robot: Robot, config: Path | None, known: tuple[KnownEffect, ...]
) -> tuple[dict[str, str], list[Note]]:
    """Model files with joint placements corrected by measured poses, and notes on corrections that they lack."""
    corrections = corrections_in_files(robot, joint_corrections(diagnosis.geometry, _zeros_by_torque(diagnosis), known))
    notes = [*not_in_files(diagnosis.geometry, known), *corrections.notes]
    out = dict(texts)
    if corrections.urdf and URDF in out:
        corrected_text, missing = urdf_with_corrected_joints(out[URDF], corrections.urdf)
        notes += [_places_not_in(URDF, missing, given=False)] if missing else []
        if problem := problem_of_loops(corrected_text, robot, config):
            notes.append(Note(Code.LOOPS_STAY_OPEN, None, {"files": (URDF,), "problem": problem}))
        else:
            out[URDF] = corrected_text
    if corrections.mjcf and MJCF in out:
        out[MJCF], missing = mjcf_with_corrected_joints(out[MJCF], corrections.mjcf)
        if missing:
            notes.append(_places_not_in(MJCF, missing, given=True))
    return out, notes


def _texts_of_poses(
    diagnosis: Diagnosis, robot: Robot, folder: Path, config: Path | None, known: tuple[KnownEffect, ...]
) -> tuple[dict[str, str], Diagnosis]:
    """Files of a diagnosis of poses alone: the known model with corrected joint placements; none without findings."""
    if not joint_corrections(diagnosis.geometry, (), known):
        return {}, replace(diagnosis, notes=(*diagnosis.notes, *not_in_files(diagnosis.geometry, known)))
    still = np.zeros((_POSTURES, robot.nv))
    motion = Motion(np.arange(float(_POSTURES)), still, still, still)
    notes = list(diagnosis.notes)
    try:
        files = model_files(corrected_model(robot, effects_on_torques(known)), motion, folder=folder, config=config)
    except PhantomDynError as error:
        notes.append(not_written_note(error, URDF, MJCF))
        return {}, replace(diagnosis, notes=tuple(notes))
    for file in files:
        notes += [] if file.text else file.notes
    made = {file.name: file.text for file in files if file.text}
    texts, move_notes = _with_moved_joints(made, diagnosis, robot, config, known)
    return texts, replace(diagnosis, notes=(*notes, *move_notes))


@dataclass(frozen=True)
class _Models:
    """A corrected model with its files, and notes on its bodies or on why there are no files."""

    corrected: CorrectedModel
    files: tuple[ModelFile, ...]
    notes: tuple[Note, ...] = ()
    count: int = 0  # number of files that passed their check


def _models(
    diagnosis: Diagnosis,
    robot: Robot,
    effects: tuple[KnownEffect, ...],
    folder: Path,
    config: Path | None,
    check_of: Callable[[CorrectedModel], FileCheck | None],
) -> tuple[_Models, tuple[Note, ...]]:
    """The corrected model and its files, and a note on the changes within tolerance.

    Four versions are tried until both files pass their check: first with the changes of the given model within its
    tolerances, then without them; each first with the bodies as found, then with the nearest possible bodies. If no
    version is complete, the one with the most files is returned.

    Raises:
        PhantomDynError: If none of the versions can be built.
    """
    motion = _recorded_motion(diagnosis)
    along = motion if diagnosis.replay is None else replace(motion, base=diagnosis.replay.base)

    def models_on(base: Robot, *, possible: bool) -> _Models:
        corrected = replace(corrected_model(base, effects), given=robot, base=base)
        body_notes: tuple[Note, ...] = ()
        if possible:
            bodies, body_notes = with_possible_bodies(corrected.robot, robot, along)
            corrected = replace(corrected, robot=bodies)
        try:
            files = model_files(corrected, motion, folder=folder, config=config)
        except PhantomDynError as error:
            return _Models(corrected, (), (not_written_note(error, URDF, MJCF),))
        passed, _, _ = passed_files({file.name: file.text for file in files if file.text}, check_of(corrected))
        return _Models(corrected, files, body_notes, len(passed))

    best: _Models | None = None
    failure: PhantomDynError | None = None
    for adjusted, possible in product((diagnosis.adjusted, ()), (False, True)):
        try:
            found = models_on(robot_within_tolerances(robot, adjusted), possible=possible)
        except PhantomDynError as error:
            failure = error
            continue
        best = found if best is None or found.count > best.count else best
        if best.count == _COMPLETE:
            break
    if best is None:
        assert failure is not None
        raise failure
    if not diagnosis.adjusted:
        return best, ()
    included = best.corrected.base is not robot
    return best, (Note(Code.WITHIN_TOLERANCE, None, {"count": len(diagnosis.adjusted), "held": included}),)


def _recorded_motion(diagnosis: Diagnosis) -> Motion:
    """The motion at the samples of the diagnosis."""
    evidence = diagnosis.evidence
    return Motion(evidence.t, evidence.q, evidence.v, evidence.a)


def _further_builders(
    diagnosis: Diagnosis, corrected: CorrectedModel, known: tuple[KnownEffect, ...], models: set[str]
) -> dict[str, Callable[[], str]]:
    """Functions that build the texts of all other files, by file name; each may raise a `PhantomDynError`."""

    def with_links(make: Callable[[CorrectedModel, str], str]) -> str:
        if not models:
            raise EstimationError(f"neither {URDF} nor {MJCF}, whose links it goes with, was written.")
        return make(corrected, corrected.given.name)

    @cache
    def code() -> str:
        return feedforward_code(corrected, diagnosis)

    residual = residual_of(diagnosis)
    builders: dict[str, Callable[[], str]] = {}
    if residual is not None:
        builders = {
            RESIDUAL: lambda: residual_code(residual),
            RESIDUAL_TABLE: lambda: residual_table(residual, diagnosis),
        }
    builders[RANDOMISATION] = lambda: randomisation_text(
        randomisation_of(diagnosis, corrected.base),
        known,
        adjusted=diagnosis.adjusted,
        with_mjcf=MJCF in models,
    )
    if not corrected.given.floating:
        builders |= {FEEDFORWARD: code, TABLE: lambda: feedforward_table(corrected, diagnosis, code())}
    return builders | {
        ISAAC: lambda: with_links(isaac_lab_text),
        SIMULATORS: lambda: with_links(simulators_text),
    }
