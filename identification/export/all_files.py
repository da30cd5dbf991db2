"""All files that go beside ``corrected.yaml``: models for simulators, ranges for training, laws for control."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from identification.diagnosis.model.terms import KnownEffect
from identification.diagnosis.result import Diagnosis
from identification.export.corrected.corrected_files import MJCF, URDF, ModelFile, model_files, rollout_note
from identification.export.corrected.found_effects import (
    effect_of,
    lasting_findings,
    possible_within_tolerance,
    within_tolerance,
)
from identification.export.corrected.parts import Parts, parts_of
from identification.export.uses.feedforward import feedforward_code, feedforward_table
from identification.export.uses.randomisation import randomisation_of
from identification.export.uses.randomisation_file import randomisation_text
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

RANDOMISATION, FEEDFORWARD, TABLE = "randomisation.yaml", "feedforward.py", "feedforward.csv"
NAMES = (URDF, MJCF, RANDOMISATION, FEEDFORWARD, TABLE)
_ARE = ("is", "are")


def not_written(out: Path, paths: Iterable[Path]) -> tuple[str, ...]:
    """Names of the files beside ``corrected.yaml`` that are not among those that were written into a folder.

    Args:
        out: The folder.
        paths: The files that were written.
    """
    there = set(paths)
    return tuple(name for name in NAMES if out / name not in there)


def written(
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
    evidence, notes = diagnosis.evidence, list(diagnosis.notes)
    effects = (*known, *(effect_of(robot, finding) for finding in lasting_findings(diagnosis)))
    motion = Motion(evidence.t, evidence.q, evidence.v, evidence.a)
    try:
        parts, files, said = _models(diagnosis, robot, effects, motion, folder, config)
    except PhantomDynError as error:
        notes.append(f"{', '.join(NAMES)} were not written: {error}")
        return {}, replace(diagnosis, notes=tuple(notes))
    texts: dict[str, str] = {}
    own = [finding.effect for finding in diagnosis.findings if finding.recording is not None]
    if own:
        notes.append(f"The corrected model lacks what acts in one recording only: {', '.join(own)}.")
    notes += said
    for file in files:
        texts |= {file.name: file.text} if file.text else {}
        notes += file.notes
    notes += rollout_note(parts, texts.get(MJCF, ""), motion, evidence.tau_measured)
    for name, make in _others(diagnosis, parts, known).items():
        try:
            texts[name] = make()
        except PhantomDynError as error:
            notes.append(f"{name} was not written: {error}")
    return texts, replace(diagnosis, notes=tuple(notes))


def _models(
    diagnosis: Diagnosis,
    robot: Robot,
    effects: tuple[KnownEffect, ...],
    motion: Motion,
    folder: Path,
    config: Path | None,
) -> tuple[Parts, tuple[ModelFile, ...], tuple[str, ...]]:
    """The corrected model and its files, with the moves within tolerance as far as bodies can make them.

    Raises:
        PhantomDynError: If there is no corrected model at all.
    """
    count = len(diagnosis.adjusted)
    quantities = f"The {count} quantities" if count > 1 else "The quantity"
    best: tuple[Parts, tuple[ModelFile, ...], tuple[str, ...]] | None = None
    for base_of in (within_tolerance, possible_within_tolerance):
        try:
            base = base_of(robot, diagnosis)
            found = _made(robot, base, effects, motion, folder, config)
        except PhantomDynError:
            continue
        if base is robot:
            return found
        if _complete(found) > (0 if best is None else _complete(best)):
            said = f"{quantities} that moved within tolerance {_ARE[count > 1]} in the corrected files."
            best = found[0], found[1], (*found[2], said)
        if _complete(found) == 2:
            break
    if best is not None and _complete(best) == 2:
        return best
    plain = _made(robot, robot, effects, motion, folder, config)
    if best is not None and _complete(best) >= _complete(plain):
        return best
    why = f"{quantities} that moved within tolerance {_ARE[count > 1]} not in the corrected files: no body can be so."
    return plain[0], plain[1], (*plain[2], why)


def _made(
    robot: Robot, base: Robot, effects: tuple[KnownEffect, ...], motion: Motion, folder: Path, config: Path | None
) -> tuple[Parts, tuple[ModelFile, ...], tuple[str, ...]]:
    """The findings on a given model or a moved one, its files, and why there are none."""
    parts = replace(parts_of(base, effects), given=robot, base=base)
    try:
        return parts, model_files(parts, motion, folder=folder, config=config), ()
    except PhantomDynError as error:
        return parts, (), (f"{URDF} and {MJCF} were not written: {error}",)


def _complete(made: tuple[Parts, tuple[ModelFile, ...], tuple[str, ...]]) -> int:
    return sum(bool(file.text) for file in made[1])


def _others(diagnosis: Diagnosis, parts: Parts, known: tuple[KnownEffect, ...]) -> dict[str, Callable[[], str]]:
    return {
        RANDOMISATION: lambda: randomisation_text(randomisation_of(diagnosis, parts.base), known),
        FEEDFORWARD: lambda: feedforward_code(parts, diagnosis),
        TABLE: lambda: feedforward_table(parts, diagnosis),
    }
