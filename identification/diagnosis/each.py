"""Many recordings, each diagnosed by itself: one verdict a recording, in several processes or on a cluster."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from identification.columns import read_column_map
from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.each_folders import check_folders, folder_names, require_logs
from identification.diagnosis.json_output import Json, to_json
from identification.diagnosis.outputs import write_outputs
from identification.diagnosis.terms import KnownEffect
from identification.diagnosis.words import effect_at_finding
from identification.recordings import read_recording
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.large_work import WorkerLostError, spread
from phantom_dyn.robot import Robot
from phantom_dyn.robot_files import find_robot

REFUSED = "refused"
# The style of matplotlib's figures is that of the whole process: threads write their reports in turn.
_WRITING = threading.Lock()


@dataclass(frozen=True)
class DiagnosedRecording:
    """What became of one recording.

    Attributes:
        log: The file as it was given.
        folder: Name of the folder for its files, after the log.
        verdict: That of ``diagnosis.json``, or ``refused``.
        causes: Findings in words, first the one that closes most of the gap.
        document: Content of ``diagnosis.json``; None if it was refused.
        refusal: Why it was refused, in a sentence; None if it was not.
    """

    log: str
    folder: str
    verdict: str
    causes: tuple[str, ...] = ()
    document: dict[str, Json] | None = None
    refusal: str | None = None


@dataclass(frozen=True)
class DiagnosedRecordings:
    """Recordings of one robot, each diagnosed by itself, in the order they were given.

    Attributes:
        robot: Name of the robot.
        joint_names: Of the robot.
        rows: One a recording.
    """

    robot: str
    joint_names: tuple[str, ...]
    rows: tuple[DiagnosedRecording, ...]

    @property
    def refused(self) -> tuple[DiagnosedRecording, ...]:
        """The recordings that were refused."""
        return tuple(row for row in self.rows if row.verdict == REFUSED)


@dataclass(frozen=True)
class _Reading:
    columns: Path | None
    topic: str | None
    excluded: tuple[tuple[float, float], ...]


def diagnose_each(
    robot: Robot,
    logs: Sequence[str | Path],
    *,
    known: tuple[KnownEffect, ...] = (),
    columns: str | Path | None = None,
    topic: str | None = None,
    excluded: Sequence[tuple[float, float]] = (),
    out: str | Path | None = None,
    jobs: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> DiagnosedRecordings:
    """Diagnose every recording by itself; one that is refused does not stop the others.

    Recordings are spread over processes, or over Dask or Ray with `joblib.parallel_config`, see
    `phantom_dyn.large_work`. A worker reads one recording at a time and writes its files itself, so that memory does
    not grow with their number; workers on other machines need the same file system.

    Args:
        robot: The model that is judged.
        logs: Files, each a recording of that robot.
        known: Effects that belong to the given model already.
        columns: Column map (YAML) of all of them, see `identification.recordings.read_recording`.
        topic: Topic of sensor_msgs/JointState in bags that have several.
        excluded: Stretches of time [s] to leave out of every recording.
        out: Folder that gets a folder with the files of a diagnosis for each recording, named after its log. None:
            nothing is written.
        jobs: Recordings at once, see `phantom_dyn.large_work.worker_count`.
        progress: Told in words what is done.

    Returns:
        One row a recording. The same whatever does the work, but for the ``seconds`` in the documents.

    Raises:
        LogError: If a log is not there or given twice, there is none, or the column map cannot be used.
        UsageError: If a folder cannot be written.
        ParameterError: If ``jobs`` is below one.
    """
    paths = require_logs(logs)
    names = folder_names(paths)
    folders: list[Path | None] = [None] * len(paths)
    if out is not None:
        folders = [Path(out).absolute() / name for name in names]
        check_folders(Path(out), names)
    if columns is not None:
        read_column_map(columns)
    reading = _Reading(None if columns is None else Path(columns).absolute(), topic, tuple(excluded))
    given = _at_home(robot)
    rows = [
        DiagnosedRecording(str(log), name, REFUSED, refusal=_LOST.format(Path(log).name))
        for log, name in zip(logs, names, strict=True)
    ]
    pieces = [
        (given, known, reading, path, folder, row) for path, folder, row in zip(paths, folders, rows, strict=True)
    ]
    done = 0
    progress(f"diagnosing {len(rows)} recordings")
    try:
        for place, row in spread(_diagnosed, pieces, jobs=jobs):
            rows[place], done = row, done + 1
            progress(f"diagnosed {done} of {len(rows)}, last {Path(row.log).name}")
    except WorkerLostError:
        pass  # what was not finished says so in its row
    return DiagnosedRecordings(robot.name, robot.joint_names, tuple(rows))


_LOST = (
    "{}: the process that diagnosed it ended again and again, perhaps because memory ran out: diagnose it alone, or "
    "with fewer --jobs."
)
_FAULT = "{}: the diagnosis itself failed ({}: {}): please report this with the recording."


def _at_home(robot: Robot) -> Robot:
    """The robot with its file named in full: a worker may have another working folder, and draws its shape."""
    file = Path(robot.source)
    return replace(robot, source=str(file.absolute())) if file.is_file() and find_robot(robot.source) == file else robot


def _diagnosed(
    robot: Robot,
    known: tuple[KnownEffect, ...],
    reading: _Reading,
    log: Path,
    folder: Path | None,
    row: DiagnosedRecording,
) -> DiagnosedRecording:
    """One recording read, diagnosed and written."""
    # Its own copy: a closed chain remembers what it solved last, and nothing may depend on the recordings before.
    robot = copy.deepcopy(robot)
    try:
        found = read_recording(log, robot, columns=reading.columns, topic=reading.topic, excluded=reading.excluded)
        diagnosis = diagnose(robot, (found,), known=known)
        if folder is not None:
            with _WRITING:
                write_outputs(diagnosis, robot, out=folder, json_file=None, known=known)
    except PhantomDynError as refusal:
        return replace(row, refusal=str(refusal))
    # Days of work on other recordings must not end here; the row says what happened.
    except Exception as fault:
        reason = " ".join(str(fault).split())[:160]
        return replace(row, refusal=_FAULT.format(log.name, type(fault).__name__, reason))
    causes = tuple(effect_at_finding(finding) for finding in diagnosis.findings)
    return replace(row, verdict=diagnosis.verdict, causes=causes, document=to_json(diagnosis), refusal=None)
