"""The two ways to a diagnosis from Python: recordings of one robot, or recordings whose differences are stated."""

from __future__ import annotations

from pathlib import Path

from identification.api.diagnosis import Diagnosis
from identification.api.inputs import RecordingsLike, described, expanded, listed, recordings_of
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
    """The diagnosis by torque; without one by that of the controllers, or in positions at rest.

    Args:
        robot: The model.
        recordings: What fits may see.
        hold_out: What no fit sees; may be empty.
        known: Effects that belong to the model already.
        columns: Column map of recordings that are paths.
        progress: Takes the stages.
        motion_only: True if a torque that was recorded is not to be used.

    Raises:
        UsageError: If something is given that does not go with recordings at rest.
        LogError: If a recording cannot be used.
    """
    # A dataset is several recordings: counted before it is read, none of those held out is fitted.
    held = expanded(hold_out)

    def read(torque_needed: bool) -> tuple[Recording, ...]:
        fitted = recordings_of(recordings, robot, columns=columns, torque_needed=torque_needed)
        return (*fitted, *(recordings_of(held, robot, columns=columns, torque_needed=torque_needed) if held else ()))

    found = diagnose(robot, read, held_out=len(held), known=known, motion_only=motion_only, progress=progress)
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
    """The diagnosis of recordings whose differences a ``recordings.yaml`` states; they are paths then.

    Args:
        robot: The model.
        recordings: Paths that fits may see.
        hold_out: Paths that no fit sees; may be empty.
        known: Effects that belong to the model already.
        changes: The ``recordings.yaml``.
        columns: Column map.
        progress: Takes the stages.

    Raises:
        UsageError: If a recording is no path.
        LogError: If a recording cannot be used.
    """
    fitted, judged = paths_of(recordings, "recordings"), paths_of(hold_out, "hold_out")
    paths = (*fitted, *judged)
    stated = read_changes(changes, paths, robot.joint_names)
    read = tuple(read_changed(path, robot, change, columns=columns) for path, change in zip(paths, stated, strict=True))
    found = diagnose(robot, read, held_out=len(judged), known=known, changes=stated, progress=progress)
    return Diagnosis(found, robot, known)


def paths_of(given: object, name: str) -> tuple[str | Path, ...]:
    """Paths where nothing else will do.

    Raises:
        UsageError: If one is something else; the sentence names the argument.
    """
    out = []
    for one in listed(given):
        if not isinstance(one, str | Path):
            raise UsageError(f"{described(one)} was given in {name}, wanted the path of a file.")
        out.append(one)
    return tuple(out)
