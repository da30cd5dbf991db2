"""All files that go beside ``corrected.yaml``: models for simulators, ranges for training, laws for control."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from identification.diagnosis.model.known_geometry import of_torques
from identification.diagnosis.model.terms import KnownEffect
from identification.diagnosis.result import Diagnosis
from identification.export.corrected.corrected_files import (
    MJCF,
    URDF,
    ModelFile,
    model_files,
    problem_of_loops,
    rollout_note,
)
from identification.export.corrected.corrected_model import CorrectedModel, corrected_model
from identification.export.corrected.found_effects import (
    effect_of,
    lasting_findings,
    possible_within_tolerance,
    within_tolerance,
)
from identification.export.corrected.moved_joints import (
    joint_moves,
    moved_mjcf,
    moved_urdf,
    moves_of_files,
    not_in_files,
)
from identification.export.corrected.nearest_bodies import with_nearest_bodies
from identification.export.uses.feedforward import feedforward_code, feedforward_table
from identification.export.uses.randomisation import randomisation_of
from identification.export.uses.randomisation_file import randomisation_text
from identification.export.uses.residual_model import residual_code, residual_note, residual_of, residual_table
from identification.export.uses.simulator_files import ISAAC, SIMULATORS, isaac_lab_text, simulators_text
from identification.geometry.terms import ZERO
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

RANDOMISATION, FEEDFORWARD, TABLE = "randomisation.yaml", "feedforward.py", "feedforward.csv"
NAMES = (URDF, MJCF, RANDOMISATION, FEEDFORWARD, TABLE, ISAAC, SIMULATORS)
"""Files beside ``corrected.yaml``."""

RESIDUAL, RESIDUAL_TABLE = "residual.py", "residual.csv"
OPTIONAL = (RESIDUAL, RESIDUAL_TABLE)
"""Files that only some diagnoses have."""

_POSTURES = 3  # on which a model without findings is compared with its file
_COMPLETE = 2  # model files: URDF and MJCF


def not_written(out: Path, paths: Iterable[Path]) -> tuple[str, ...]:
    """Names of the files beside ``corrected.yaml`` that are not among those that were written into a folder.

    Args:
        out: The folder.
        paths: The files that were written.
    """
    there = set(paths)
    return tuple(name for name in NAMES if out / name not in there)


def not_held(notes: Iterable[str]) -> tuple[str, ...]:
    """Notes on files that were not written, and on findings that a model file does not hold.

    Args:
        notes: That `export_texts` added.
    """
    said = (" not written: ", "no place for", "given file is not in it", "No body can have")
    return tuple(note for note in notes if any(words in note for words in said))


def export_texts(
    diagnosis: Diagnosis,
    robot: Robot,
    *,
    folder: Path,
    known: tuple[KnownEffect, ...] = (),
    config: Path | None = None,
) -> tuple[dict[str, str], Diagnosis]:
    """Texts by file name, of those that can be written; and the diagnosis with notes on them.

    Args:
        diagnosis: What was found.
        robot: The robot as it was given.
        folder: Where the files will lie.
        known: Effects that belong to the given model already.
        config: The ``robot.yaml`` that was given, None for the one beside the robot's file.
    """
    if diagnosis.poses_alone:
        return _of_poses(diagnosis, robot, folder, config, known)
    notes = list(diagnosis.notes)
    effects = (*of_torques(known), *(effect_of(robot, finding) for finding in lasting_findings(diagnosis)))
    try:
        models, within_notes = _models(diagnosis, robot, effects, folder, config)
    except PhantomDynError as error:
        notes.append(f"{', '.join(NAMES)} were not written: {error}")
        return {}, replace(diagnosis, notes=tuple(notes))
    own = [finding.effect for finding in diagnosis.findings if finding.recording is not None]
    if own:
        notes.append(f"The corrected model lacks what acts in one recording only: {', '.join(own)}.")
    notes += (*models.notes, *within_notes)
    texts: dict[str, str] = {}
    for file in models.files:
        texts |= {file.name: file.text} if file.text else {}
        notes += file.notes
    texts, told = _with_moved_joints(texts, diagnosis, robot, config, known)
    notes += told
    corrected, evidence = models.corrected, diagnosis.evidence
    notes += rollout_note(corrected, texts.get(MJCF, ""), _recorded_motion(diagnosis), evidence.tau_measured)
    residual = residual_of(diagnosis)
    if residual is not None:
        notes.append(residual_note(residual))
    for name, make in _others(diagnosis, corrected, of_torques(known)).items():
        try:
            texts[name] = make()
        except PhantomDynError as error:
            notes.append(f"{name} was not written: {error}")
    moved = joint_moves(diagnosis.geometry, _zeros_by_torque(diagnosis), known)
    if moved and FEEDFORWARD in texts:
        notes.append(f"{FEEDFORWARD} has no place for what poses showed: it has {', '.join(moved)} where it was given.")
    return texts, replace(diagnosis, notes=tuple(notes))


def _zeros_by_torque(diagnosis: Diagnosis) -> set[str]:
    """Joints whose zeros the torques show, so that the corrected model has them already."""
    return {one.joint or "" for one in diagnosis.findings if one.effect == ZERO}


def _with_moved_joints(
    texts: dict[str, str], diagnosis: Diagnosis, robot: Robot, config: Path | None, known: tuple[KnownEffect, ...]
) -> tuple[dict[str, str], list[str]]:
    """Model files with their joints where measured poses put them, and what is not in them."""
    moves = moves_of_files(robot, joint_moves(diagnosis.geometry, _zeros_by_torque(diagnosis), known))
    notes = [*not_in_files(diagnosis.geometry, known), *moves.notes]
    out = dict(texts)
    if moves.urdf and URDF in out:
        moved, left = moved_urdf(out[URDF], moves.urdf)
        notes += [f"{URDF} has no place for what was found of the place of {', '.join(left)}."] if left else []
        if problem := problem_of_loops(moved, robot, config):
            notes.append(f"{URDF} has no place for what poses showed: with its joints moved, {problem}")
        else:
            out[URDF] = moved
    if moves.mjcf and MJCF in out:
        out[MJCF], left = moved_mjcf(out[MJCF], moves.mjcf)
        if left:
            notes.append(f"{MJCF}: what was found of the place of {', '.join(left)} in the given file is not in it.")
    return out, notes


def _of_poses(
    diagnosis: Diagnosis, robot: Robot, folder: Path, config: Path | None, known: tuple[KnownEffect, ...]
) -> tuple[dict[str, str], Diagnosis]:
    """The known model with its joints moved, where poses alone were judged; nothing without a finding."""
    if not joint_moves(diagnosis.geometry, (), known):
        return {}, replace(diagnosis, notes=(*diagnosis.notes, *not_in_files(diagnosis.geometry, known)))
    still = np.zeros((_POSTURES, robot.nv))
    motion = Motion(np.arange(float(_POSTURES)), still, still, still)
    notes = list(diagnosis.notes)
    try:
        files = model_files(corrected_model(robot, of_torques(known)), motion, folder=folder, config=config)
    except PhantomDynError as error:
        notes.append(f"{URDF} and {MJCF} were not written: {error}")
        return {}, replace(diagnosis, notes=tuple(notes))
    for file in files:
        notes += [] if file.text else file.notes
    made = {file.name: file.text for file in files if file.text}
    texts, told = _with_moved_joints(made, diagnosis, robot, config, known)
    return texts, replace(diagnosis, notes=(*notes, *told))


@dataclass(frozen=True)
class _Models:
    """A corrected model with its files, and a note where there are none."""

    corrected: CorrectedModel
    files: tuple[ModelFile, ...]
    notes: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of files that could be written."""
        return sum(bool(file.text) for file in self.files)


def _models(
    diagnosis: Diagnosis, robot: Robot, effects: tuple[KnownEffect, ...], folder: Path, config: Path | None
) -> tuple[_Models, tuple[str, ...]]:
    """The corrected model and its files, and a sentence on the moves within tolerance.

    The findings are added to the given model with these moves; where no body can be so, to possible bodies of the same
    torque; where that gives fewer files, to the given model without moves.

    Raises:
        PhantomDynError: If there is no corrected model at all.
    """
    motion = _recorded_motion(diagnosis)

    def models_on(base: Robot, *, nearest: bool = False) -> _Models:
        corrected = replace(corrected_model(base, effects), given=robot, base=base)
        told: tuple[str, ...] = ()
        if nearest:
            possible, told = with_nearest_bodies(corrected.robot, robot)
            corrected = replace(corrected, robot=possible)
        try:
            return _Models(corrected, model_files(corrected, motion, folder=folder, config=config), told)
        except PhantomDynError as error:
            return _Models(corrected, (), (f"{URDF} and {MJCF} were not written: {error}",))

    best: _Models | None = None
    for base_of in (within_tolerance, possible_within_tolerance):
        try:
            base = base_of(robot, diagnosis)
            found = models_on(base)
        except PhantomDynError:
            continue
        if base is robot:
            return (found if found.count == _COMPLETE else _better(found, lambda: models_on(robot, nearest=True))), ()
        if found.count > (0 if best is None else best.count):
            best = found
        if found.count == _COMPLETE:
            break
    count = len(diagnosis.adjusted)
    moved = (
        f"The {count} quantities that moved within tolerance are"
        if count > 1
        else ("The quantity that moved within tolerance is")
    )
    if best is not None and best.count == _COMPLETE:
        return best, (f"{moved} in the corrected files.",)
    plain = models_on(robot)
    if plain.count < _COMPLETE:
        plain = _better(plain, lambda: models_on(robot, nearest=True))
    if best is not None and best.count >= plain.count:
        return best, (f"{moved} in the corrected files.",)
    return plain, (f"{moved} not in the corrected files: no body can be so.",)


def _better(one: _Models, make: Callable[[], _Models]) -> _Models:
    """Models with more files where there are any, else those that are there."""
    try:
        other = make()
    except PhantomDynError:
        return one
    return other if other.count > one.count else one


def _recorded_motion(diagnosis: Diagnosis) -> Motion:
    """Motion at the samples of the diagnosis."""
    evidence = diagnosis.evidence
    return Motion(evidence.t, evidence.q, evidence.v, evidence.a)


def _others(
    diagnosis: Diagnosis, corrected: CorrectedModel, known: tuple[KnownEffect, ...]
) -> dict[str, Callable[[], str]]:
    @cache
    def code() -> str:
        return feedforward_code(corrected, diagnosis)

    residual = residual_of(diagnosis)
    offered: dict[str, Callable[[], str]] = {}
    if residual is not None:
        offered = {
            RESIDUAL: lambda: residual_code(residual),
            RESIDUAL_TABLE: lambda: residual_table(residual, diagnosis),
        }
    return offered | {
        RANDOMISATION: lambda: randomisation_text(randomisation_of(diagnosis, corrected.base), known),
        FEEDFORWARD: code,
        TABLE: lambda: feedforward_table(corrected, diagnosis, code()),
        ISAAC: lambda: isaac_lab_text(corrected, corrected.given.name),
        SIMULATORS: lambda: simulators_text(corrected, corrected.given.name),
    }
