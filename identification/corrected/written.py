"""All files that go beside ``corrected.yaml``: models for simulators, ranges for training, laws for control."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from identification.corrected.files import MJCF, URDF, model_files, rollout_note
from identification.corrected.found import effect_of, lasting_findings
from identification.corrected.parts import Parts, parts_of
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.terms import KnownEffect
from identification.uses.feedforward import feedforward_code, feedforward_table
from identification.uses.randomisation import randomisation_of
from identification.uses.randomisation_file import randomisation_text
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

RANDOMISATION, FEEDFORWARD, TABLE = "randomisation.yaml", "feedforward.py", "feedforward.csv"
NAMES = (URDF, MJCF, RANDOMISATION, FEEDFORWARD, TABLE)


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
    try:
        parts = parts_of(robot, (*known, *(effect_of(robot, finding) for finding in lasting_findings(diagnosis))))
    except PhantomDynError as error:
        notes.append(f"{', '.join(NAMES)} were not written: {error}")
        return {}, replace(diagnosis, notes=tuple(notes))
    motion = Motion(evidence.t, evidence.q, evidence.v, evidence.a)
    texts: dict[str, str] = {}
    own = [finding.effect for finding in diagnosis.findings if finding.recording is not None]
    if own:
        notes.append(f"The corrected model lacks what acts in one recording only: {', '.join(own)}.")
    try:
        files = model_files(parts, motion, folder=folder, config=config)
    except PhantomDynError as error:
        files = ()
        notes.append(f"{URDF} and {MJCF} were not written: {error}")
    for file in files:
        texts |= {file.name: file.text} if file.text else {}
        notes += file.notes
    notes += rollout_note(parts, texts.get(MJCF, ""), motion, evidence.tau_measured)
    for name, make in _others(diagnosis, robot, parts, known).items():
        try:
            texts[name] = make()
        except PhantomDynError as error:
            notes.append(f"{name} was not written: {error}")
    return texts, replace(diagnosis, notes=tuple(notes))


def _others(
    diagnosis: Diagnosis, robot: Robot, parts: Parts, known: tuple[KnownEffect, ...]
) -> dict[str, Callable[[], str]]:
    return {
        RANDOMISATION: lambda: randomisation_text(randomisation_of(diagnosis, robot), known),
        FEEDFORWARD: lambda: feedforward_code(parts, diagnosis),
        TABLE: lambda: feedforward_table(parts, diagnosis),
    }
