"""Diagnoses many recordings separately, in several processes or on a cluster.

`logs_in` finds the recordings in a folder, `folder_names` chooses the name of each recording's output folder.
"""

from __future__ import annotations

import copy
import json
import os
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from identification.data.readers.presets import usable_columns
from identification.data.reading import ReadOptions, read_recording
from identification.data.recording import Recording
from identification.diagnosis.columns.terms import KnownEffect
from identification.files import disk_full_words, is_disk_full, require_existing, require_own
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import INDEX, Json, check_targets, to_json, write_outputs
from identification.stages import Announcement, Progress, Stage
from identification.words.diagnosis_words import placed_finding
from identification.words.geometry_words import all_findings, verdict_sentences
from phantom_dyn.errors import LogError, PhantomDynError, UsageError
from phantom_dyn.large_work import WorkerLostError, spread
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot

TABLES = ("diagnoses.json", "diagnoses.csv", "fleet.html")
"""Names of the summary files on all recordings in the output folder."""
ENDINGS = (".csv", ".npz", ".parquet", ".bag", ".db3", ".mcap")
"""Endings by which recordings are recognised in a folder; a file that the user names may have any ending."""
REFUSED = "refused"
"""Verdict of a recording that could not be diagnosed."""

_BAG = "metadata.yaml"  # file in the folder of a ROS 2 bag

# Threads write their reports one after the other, because matplotlib's style applies to the whole process.
_WRITE_LOCK = threading.Lock()
# Refusals of a recording whose process died, and of one whose diagnosis raised an unexpected error.
_LOST = (
    "{}: the process that diagnosed it ended again and again, perhaps because memory ran out: diagnose it alone, or "
    "with fewer --jobs."
)
_FAULT = "{}: the diagnosis itself failed ({}: {}): please report this with the recording."


def logs_in(path: str) -> list[str]:
    """Recordings in a folder, sorted by name; the path itself if it is a file or a ROS 2 bag.

    If the folder contains no recording, the recordings in its subfolders are returned (a fleet with one folder per
    robot).

    Raises:
        LogError: If neither the folder nor its subfolders contain a recording.
    """
    folder = Path(path)
    if not folder.is_dir() or (folder / _BAG).exists():
        return [path]
    found = [entry for entry in sorted(folder.iterdir()) if _is_log(entry)]
    if not found:
        robots = [entry for entry in sorted(folder.iterdir()) if entry.is_dir() and not entry.name.startswith(".")]
        found = [entry for robot in robots for entry in sorted(robot.iterdir()) if _is_log(entry)]
    if not found:
        raise LogError(
            f"{path} holds no recording: wanted files that end in {', '.join(ENDINGS)}, or ROS 2 bags; name another "
            "folder, or the files themselves."
        )
    return [str(entry) for entry in found]


def _is_log(entry: Path) -> bool:
    """True for a ROS 2 bag, or a file with the ending of a recording."""
    if entry.is_dir():
        return (entry / _BAG).exists()
    return entry.suffix.lower() in ENDINGS and entry.name not in TABLES and not entry.name.startswith(".")


def require_logs(logs: Sequence[str | Path]) -> tuple[Path, ...]:
    """Full paths of recordings, after a check that they exist.

    Raises:
        LogError: If no recording is given, or if a recording does not exist or is given twice.
    """
    if isinstance(logs, str | Path) or not logs:
        raise LogError(f"{logs!r} was given, wanted a list of at least one recording: give the paths of files.")
    seen: dict[Path, None] = {}
    for log in logs:
        require_existing(log)
        # Links or dots can make two different paths name the same file.
        if Path(log).resolve() in seen:
            raise LogError(f"{log} is given twice: give every recording once.")
        seen[Path(log).resolve()] = None
    return tuple(Path(os.path.abspath(log)) for log in logs)  # noqa: PTH100  pathlib keeps the dots of a/../b


def folder_names(paths: Sequence[Path]) -> tuple[str, ...]:
    """Name of each recording's output folder: the shortest form of its path that differs from the others.

    The forms are ``run``, ``run.csv``, ``monday_run.csv`` and so on. If paths do not differ in any form, a number is
    added. Names also differ on systems that ignore case.

    Args:
        paths: Full paths, all different.
    """
    lengths = [0] * len(paths)
    longest = max(len(path.parts) for path in paths)
    while True:
        names = [_name(path, length) for path, length in zip(paths, lengths, strict=True)]
        count = Counter([*(name.lower() for name in names), *TABLES])
        twice = [place for place, name in enumerate(names) if count[name.lower()] > 1]
        if not twice:
            return tuple(names)
        if max(lengths[place] for place in twice) > longest:
            return tuple(f"{name}_{place + 1}" if place in twice else name for place, name in enumerate(names))
        for place in twice:
            lengths[place] += 1


def _name(path: Path, length: int) -> str:
    """The last ``length`` parts of a path, joined.

    For a ``length`` of zero, the name of a file without its ending, or the name of a folder (a ROS 2 bag).
    """
    if length == 0 and not path.is_dir():
        return path.stem
    parts = path.parts[1:]
    return "_".join(parts[-max(length, 1) :])


def check_folders(out: Path, names: Sequence[str]) -> None:
    """Check before the diagnoses that all output files can be written.

    Raises:
        UsageError: If an output file is a folder or a file of the user, or its folder cannot be written to.
    """
    check_targets(out, None)
    for name in names:
        check_targets(out / name, None)
    for table in TABLES:
        if (out / table).is_dir():
            raise UsageError(f"--out: {out / table} is a folder, wanted a file; remove it or name another place")
    require_own(out, TABLES, index=TABLES[0], unmarked=TABLES[2:])


@dataclass(frozen=True)
class DiagnosedRecording:
    """Result for one recording: its diagnosis, or the reason why it was refused.

    Attributes:
        log: Path of the recording as the user gave it.
        folder: Name of the output folder for the recording.
        verdict: Verdict in ``diagnosis.json``, or ``refused``.
        causes: Findings in words; the finding that closes most of the gap is first.
        document: Content of ``diagnosis.json``; None if the recording was refused.
        refusal: Reason for the refusal in a sentence; None without a refusal.
        sentence: The verdict in words; empty if the recording was refused.
    """

    log: str
    folder: str
    verdict: str
    causes: tuple[str, ...] = ()
    document: dict[str, Json] | None = None
    refusal: str | None = None
    sentence: str = ""


@dataclass(frozen=True)
class DiagnosedRecordings:
    """Separate diagnoses of several recordings of one robot model, in the given order.

    Attributes:
        robot: Name of the robot.
        joint_names: Names of the robot's joints.
        rows: Result for each recording.
    """

    robot: str
    joint_names: tuple[str, ...]
    rows: tuple[DiagnosedRecording, ...]

    @property
    def refused(self) -> tuple[DiagnosedRecording, ...]:
        """The recordings that were refused."""
        return tuple(row for row in self.rows if row.verdict == REFUSED)


def diagnose_each(
    robot: Robot,
    logs: Sequence[str | Path],
    *,
    known: tuple[KnownEffect, ...] = (),
    reading: ReadOptions | None = None,
    out: str | Path | None = None,
    jobs: int | None = None,
    progress: Progress = lambda _: None,
) -> DiagnosedRecordings:
    """Diagnose every recording separately; a refused recording does not stop the others.

    Recordings are distributed over processes, or over Dask or Ray with `joblib.parallel_config` (see
    `phantom_dyn.large_work`). Each worker reads one recording at a time and writes its files, so the memory does not
    grow with the number of recordings. Workers on other machines need the same file system.

    Args:
        robot: The given model.
        logs: Files, each with one recording of the robot.
        known: Effects that the given model already contains.
        reading: Options for reading all files; by default whole files without a column map.
        out: Output folder, which gets one folder per recording with the files of its diagnosis. None to write nothing.
        jobs: Number of recordings that are diagnosed at the same time; None for the default of
            `phantom_dyn.large_work.worker_count`.
        progress: Called after each recording.

    Returns:
        One row per recording. Rows do not depend on the number of workers, except for ``seconds`` in the documents.

    Raises:
        LogError: If a log does not exist or is given twice, no log is given, or the column map cannot be used.
        UsageError: If a folder cannot be written.
        ParameterError: If ``jobs`` is below one.
    """
    paths = require_logs(logs)
    names = folder_names(paths)
    folders: list[Path | None] = [None] * len(paths)
    if out is not None:
        folders = [Path(out).absolute() / name for name in names]
        check_folders(Path(out), names)
    reading = ReadOptions() if reading is None else reading
    if reading.columns is not None:
        reading = replace(reading, columns=usable_columns(reading.columns))
    given = _with_absolute_source(robot)
    rows = [
        DiagnosedRecording(str(log), name, REFUSED, refusal=_LOST.format(Path(log).name))
        for log, name in zip(logs, names, strict=True)
    ]
    pieces = [
        (given, known, reading, path, folder, row) for path, folder, row in zip(paths, folders, rows, strict=True)
    ]
    done = 0
    progress(Announcement(Stage.BATCH, 0, len(rows)))
    try:
        for place, row in spread(_diagnosed, pieces, jobs=jobs):
            rows[place], done = row, done + 1
            progress(Announcement(Stage.BATCH, done, len(rows), {"file": Path(row.log).name}))
    except WorkerLostError:
        pass  # rows of recordings that were not finished keep the refusal `_LOST`
    return DiagnosedRecordings(robot.name, robot.joint_names, tuple(rows))


def _with_absolute_source(robot: Robot) -> Robot:
    """The robot with the absolute path of its file, because a worker may have another working folder."""
    file = Path(robot.source)
    return replace(robot, source=str(file.absolute())) if file.is_file() and find_robot(robot.source) == file else robot


def _diagnosed(
    robot: Robot,
    known: tuple[KnownEffect, ...],
    reading: ReadOptions,
    log: Path,
    folder: Path | None,
    row: DiagnosedRecording,
) -> DiagnosedRecording:
    """Read and diagnose one recording and write its files; returns the row with the result."""
    # A closed chain stores its last solution as the next initial value. A copy makes results independent of earlier
    # recordings.
    robot = copy.deepcopy(robot)

    def read(torque_needed: bool) -> tuple[Recording, ...]:
        return (read_recording(log, robot, **vars(reading), torque_needed=torque_needed),)

    try:
        diagnosis = diagnose(robot, read, known=known)
        if folder is not None:
            with _WRITE_LOCK:
                write_outputs(diagnosis, robot, out=folder, json_file=None, known=known)
    except PhantomDynError as refusal:
        return replace(row, refusal=str(refusal))
    # An unexpected error must not stop the other recordings, so the row reports the error.
    except Exception as fault:
        if isinstance(fault, OSError) and is_disk_full(fault):
            return replace(row, refusal=f"{log.name}: {disk_full_words(fault)}.")
        reason = " ".join(str(fault).split())[:160]
        return replace(row, refusal=_FAULT.format(log.name, type(fault).__name__, reason))
    causes = tuple(placed_finding(finding) for finding in all_findings(diagnosis))
    return replace(
        row,
        verdict=diagnosis.verdict,
        causes=causes,
        sentence=verdict_sentences(diagnosis),
        document=to_json(diagnosis) if folder is None else json.loads((folder / INDEX).read_text(encoding="utf-8")),
        refusal=None,
    )
