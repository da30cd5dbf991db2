"""Runs the diagnosis of `phantom_dyn.diagnose`, with or without a file that states differences between recordings."""

from __future__ import annotations

from pathlib import Path

from identification.api.diagnosis import Diagnosis
from identification.api.inputs import RecordingsLike, as_tuple, described, expanded, recordings_of
from identification.data.recording import Recording
from identification.diagnosis.columns.terms import KnownEffect
from identification.pipeline import diagnose
from identification.scenarios.recordings_file import read_changed, read_changes
from identification.stages import Progress
from phantom_dyn.errors import UsageError
from phantom_dyn.model.robot import Robot


def diagnosis_of_recordings(
    robot: Robot,
    recordings: RecordingsLike,
    hold_out: RecordingsLike,
    known: tuple[KnownEffect, ...],
    columns: str | Path | None,
    progress: Progress,
    *,
    motion_only: bool,
) -> Diagnosis:
    """The diagnosis from recorded torques; without torques, from the controllers' torques or from positions at rest.

    Args:
        robot: The model.
        recordings: Recordings for the fits.
        hold_out: Recordings that no fit sees; may be empty.
        known: Effects that the model already contains.
        columns: Column map for recordings that are given as paths.
        progress: Called at the start of each stage.
        motion_only: True if recorded torques must not be used.

    Raises:
        UsageError: If an argument cannot be used for recordings at rest.
        LogError: If a recording cannot be used.
    """
    # A dataset contains several recordings: it is expanded before the held-out recordings are counted.
    held_out = expanded(hold_out)

    def read(torque_needed: bool) -> tuple[Recording, ...]:
        fitted = recordings_of(recordings, robot, columns=columns, torque_needed=torque_needed)
        return (
            *fitted,
            *(recordings_of(held_out, robot, columns=columns, torque_needed=torque_needed) if held_out else ()),
        )

    found = diagnose(robot, read, held_out=len(held_out), known=known, motion_only=motion_only, progress=progress)
    return Diagnosis(found, found.driven or robot, known)


def diagnosis_of_changes(
    robot: Robot,
    recordings: object,
    hold_out: object,
    known: tuple[KnownEffect, ...],
    changes: str | Path,
    columns: str | Path | None,
    progress: Progress,
) -> Diagnosis:
    """The diagnosis of recordings with a ``recordings.yaml`` that states how they differ.

    Args:
        robot: The model.
        recordings: Paths of recordings for the fits.
        hold_out: Paths of recordings that no fit sees; may be empty.
        known: Effects that the model already contains.
        changes: Path of the ``recordings.yaml``.
        columns: Column map.
        progress: Called at the start of each stage.

    Raises:
        UsageError: If a recording is not given as a path.
        LogError: If a recording cannot be used.
    """
    held_out = paths_of(hold_out, "hold_out")
    paths = (*paths_of(recordings, "recordings"), *held_out)
    stated = read_changes(changes, paths, robot.joint_names)
    read = tuple(read_changed(path, robot, change, columns=columns) for path, change in zip(paths, stated, strict=True))
    found = diagnose(robot, read, held_out=len(held_out), known=known, changes=stated, progress=progress)
    return Diagnosis(found, robot, known)


def paths_of(given: object, name: str) -> tuple[str | Path, ...]:
    """The paths in an argument.

    Args:
        given: Value of the argument: one path or several.
        name: Name of the argument, for the message.

    Raises:
        UsageError: If an element is not a path.
    """
    out = []
    for one in as_tuple(given):
        if not isinstance(one, str | Path):
            raise UsageError(f"{described(one)} was given in {name}, wanted the path of a file.")
        out.append(one)
    return tuple(out)
