"""The command ``phantom-dyn diagnose``: finds effects that the model of a robot lacks, from recordings."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from identification.cli.arguments import (
    BAD_INPUT,
    DONE,
    Parser,
    add_effects,
    add_list,
    add_logs,
    add_robot,
    excluded_stretches,
    expand_episodes,
    given_files,
    one_blas_thread,
    require_files,
    robot_with_effects,
    with_reading_options,
)
from identification.cli.terminal.printed import say
from identification.cli.terminal.progress import AFTER_DIAGNOSIS, BATCH, DIAGNOSIS, Progress
from identification.cli.terminal.stage_times import StageTimes
from identification.data.change_kinds import KINDS
from identification.stages import Announcement, Stage
from phantom_dyn.errors import UsageError

if TYPE_CHECKING:
    from identification.data.recording import Recording
    from identification.diagnosis.columns.terms import KnownEffect
    from identification.diagnosis.result import Diagnosis
    from identification.pipeline import DiagnosisWithoutPlan
    from phantom_dyn.model.robot import Robot


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn diagnose",
        description="Say where the gap between a robot and its model lies, which unmodelled effect causes it, and how "
        "far the gap shrinks on data that no fit has seen once the effect is added.",
        examples=(
            "diagnose robot.urdf log.csv --out report/",
            "diagnose example:ur10 empty.csv loaded.csv --recordings recordings.yaml --columns columns.yaml",
        ),
    )
    add_robot(out)
    add_logs(out)
    out.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="write diagnosis.json, report.html, corrected.yaml, .urdf and .xml, randomisation.yaml, feedforward.py "
        "and .csv, isaac_lab.py and simulators.yaml there, and residual.py and .csv where a residual is predicted",
    )
    out.add_argument("--json", metavar="FILE", type=Path, help="write the diagnosis as JSON to this file")
    add_list(out, "--hold-out", metavar="LOG", help="recordings that no fit may use; all figures are theirs")
    add_list(out, "--with", dest="known", metavar="FILE", help="corrected.yaml of an earlier diagnosis")
    add_effects(out)
    out.add_argument("--recordings", metavar="FILE", type=Path, help="recordings.yaml: what changed between the LOGs")
    out.add_argument(
        "--changed",
        metavar="NAME[,NAME]",
        help="what differs between the first LOG and the others, by an unknown amount "
        f"({', '.join(KINDS)}); all else is in common. With payload links and friction are fitted to the first LOG",
    )
    out.add_argument(
        "--quick",
        action="store_true",
        help="stop at verdict and findings: --out gets diagnosis.json alone, and no next experiment is planned",
    )
    out.add_argument(
        "--motion-only",
        action="store_true",
        help="ignore recorded torques, and take what the controllers ask for at the q_ref. columns; the default "
        "for a LOG without torque",
    )
    out.add_argument(
        "--profile",
        action="store_true",
        help="print at the end the clock and processor time of each stage, and the peak memory",
    )
    out.add_argument(
        "--each",
        action="store_true",
        help="diagnose every LOG by itself; a LOG may be a folder of them. --out gets a folder for each and the table "
        "of verdicts, diagnoses.csv and diagnoses.json; exit code 2 if a LOG was refused, the others are diagnosed",
    )
    out.add_argument(
        "--jobs",
        metavar="N",
        type=int,
        help="with --each, recordings at once (default: one per core); a single diagnosis needs one process",
    )
    return out


def run(arguments: argparse.Namespace) -> int:
    """Diagnose, print a summary, and write the files that the options name."""
    one_blas_thread()
    excluded_stretches(arguments)  # raises an error for wrong times before any slow work
    _refuse_contradictions(arguments)
    expand_episodes(arguments)
    if arguments.each:
        arguments.logs = _logs_of_folders(arguments.logs)
    require_files(arguments)
    return _diagnose_each(arguments) if arguments.each else _diagnose_together(arguments)


def _refuse_contradictions(arguments: argparse.Namespace) -> None:
    """Raise an error for options that exclude each other, with a message that names the option to leave out."""
    each, changed, recordings = arguments.each, arguments.changed is not None, arguments.recordings is not None
    contradictions = (
        (
            arguments.jobs is not None and arguments.jobs < 1,
            f"--jobs {arguments.jobs} was given, wanted a number of processes from 1 on; leave it out",
        ),
        (
            arguments.quick and each,
            "--quick was given with --each, which writes all files of every recording: leave out one",
        ),
        (
            arguments.profile and each,
            "--profile was given with --each, whose recordings are diagnosed by several processes: profile one of them",
        ),
        (
            arguments.motion_only and (each or recordings),
            "--motion-only does not go with --each or --recordings; diagnose the recordings one by one",
        ),
        (
            changed and recordings,
            "--changed was given with --recordings, which says what changed as well: leave out one of the two",
        ),
        (
            changed and (each or arguments.motion_only),
            "--changed does not go with --each or --motion-only: give two or more LOGs with torques",
        ),
        (
            each and arguments.hold_out,
            "--hold-out was given with --each, which diagnoses every recording by itself, so that there is nothing to "
            "judge on others: leave out one of the two",
        ),
        (
            each and recordings,
            "--recordings was given with --each, which diagnoses every recording by itself, so that nothing can have "
            "changed between them: leave out one of the two",
        ),
    )
    for contradiction, message in contradictions:
        if contradiction:
            raise UsageError(message)


def _diagnose_together(arguments: argparse.Namespace) -> int:
    """Make one diagnosis of all recordings, print its summary and write its files."""
    from identification.export.all_files import not_written
    from identification.export.known_model import known_model
    from identification.pipeline import planned, with_proposal
    from identification.reporting.diagnosis_summary import next_experiment_lines, note_lines, summary, written_lines
    from identification.reporting.stored.diagnosis_files import check_targets, write_diagnosis_alone, write_outputs
    from identification.second_process import started

    check_targets(arguments.out, arguments.json, given_files(arguments))
    times = StageTimes() if arguments.profile else None
    with Progress(Stage.READING, sys.stderr, stages=DIAGNOSIS, times=times) as progress:
        known, robot = known_model(tuple(Path(path) for path in arguments.known), robot_with_effects(arguments))
        if arguments.recordings is None and arguments.changed is None:
            without_plan = _diagnosis_of_logs(arguments, robot, known, progress)
        else:
            without_plan = _diagnosis_of_changes(arguments, robot, known, progress)
    diagnosis = without_plan.diagnosis
    say(summary(diagnosis), flush=True)
    if arguments.quick:
        written = write_diagnosis_alone(
            replace(diagnosis, command=arguments.command), out=arguments.out, json_file=arguments.json
        )
        if times is not None:
            say(times.table(), file=sys.stderr)
        say("\n".join(written_lines(written, arguments.out)))
        return DONE
    printed_notes, remarks = len(diagnosis.notes), list[str]()
    # A second process plans the next experiment while this one writes the models. With --profile, one process does
    # both in turn, so that the times of the stages can be measured.
    plan = partial(planned, without_plan)
    proposal = started(plan) if times is None else cache(plan)

    def completed(found: Diagnosis) -> Diagnosis:
        return with_proposal(found, proposal(), without_plan.started)

    with Progress(Stage.WRITING, sys.stderr, stages=AFTER_DIAGNOSIS, times=times) as progress:
        if times is not None:
            progress.show(Announcement(Stage.NEXT_EXPERIMENT))
            proposal()
        progress.show(Announcement(Stage.WRITING))
        diagnosis = replace(diagnosis, command=arguments.command)
        written = write_outputs(
            diagnosis,
            robot,
            out=arguments.out,
            json_file=arguments.json,
            known=known,
            config=arguments.robot_config,
            on_missing=remarks.append,
            completed=completed,
        )
        diagnosis = completed(diagnosis)
    if times is not None:
        say(times.table(), file=sys.stderr)
    proposed = next_experiment_lines(diagnosis)
    if proposed:
        say("\n".join(["", *proposed, *note_lines(diagnosis.notes[printed_notes:])]))
    say("\n".join(written_lines(written, arguments.out)))
    for sentence in remarks:
        say(sentence)
    if arguments.out is not None and not diagnosis.poses_alone and (missing := not_written(arguments.out, written)):
        say(f"not written: {', '.join(missing)}; see {arguments.out / 'report.html'}")
    return DONE


def _diagnosis_of_changes(
    arguments: argparse.Namespace, robot: Robot, known: tuple[KnownEffect, ...], progress: Progress
) -> DiagnosisWithoutPlan:
    """Diagnose recordings between which something changed; ``--recordings`` or ``--changed`` states what."""
    from identification.data.changes import Change
    from identification.pipeline import diagnose_without_plan
    from identification.scenarios.recordings_file import changed_from_first, read_changed, read_changes

    paths = (*arguments.logs, *arguments.hold_out)
    if arguments.changed is None:
        changes = read_changes(arguments.recordings, paths, robot.joint_names)
    else:
        changes = changed_from_first(arguments.changed, paths)
    read_with_options = with_reading_options(read_changed, arguments)

    def read(path: str, change: Change) -> Recording:
        progress.show(Announcement(Stage.READING, detail={"file": Path(path).name}))
        return read_with_options(path, robot, change)

    recordings = tuple(read(path, change) for path, change in zip(paths, changes, strict=True))
    held_out = len(arguments.hold_out)
    return diagnose_without_plan(
        robot, recordings, held_out=held_out, known=known, changes=changes, progress=progress.show
    )


def _diagnosis_of_logs(
    arguments: argparse.Namespace, robot: Robot, known: tuple[KnownEffect, ...], progress: Progress
) -> DiagnosisWithoutPlan:
    """Diagnose recorded torques. Without them, diagnose the controllers' torques or positions at rest."""
    from identification.data.reading import read_recording
    from identification.pipeline import diagnose_without_plan

    read_with_options = with_reading_options(read_recording, arguments)

    def read(path: str, torque_needed: bool) -> Recording:
        progress.show(Announcement(Stage.READING, detail={"file": Path(path).name}))
        return read_with_options(path, robot, torque_needed=torque_needed)

    def read_all(torque_needed: bool) -> tuple[Recording, ...]:
        return tuple(read(path, torque_needed) for path in (*arguments.logs, *arguments.hold_out))

    return diagnose_without_plan(
        robot,
        read_all,
        held_out=len(arguments.hold_out),
        known=known,
        motion_only=arguments.motion_only,
        progress=progress.show,
    )


def _logs_of_folders(logs: list[str]) -> list[str]:
    """The given recordings, with each folder replaced by the recordings in the folder.

    Raises:
        LogError: If a folder contains no recording.
    """
    if not any(Path(log).is_dir() for log in logs):
        return logs
    from identification.batch.diagnose_each import logs_in

    return [path for log in logs for path in logs_in(log)]


def _diagnose_each(arguments: argparse.Namespace) -> int:
    """Diagnose every recording by itself, print the table of verdicts and write the files.

    Returns:
        0 if every recording was diagnosed, 2 if at least one was refused. The others are diagnosed in any case.
    """
    from identification.batch.batch_tables import table, write_tables
    from identification.batch.diagnose_each import diagnose_each
    from identification.data.reading import ReadOptions
    from identification.export.known_model import known_model
    from identification.reporting.stored.diagnosis_files import check_targets

    check_targets(arguments.out, arguments.json, given_files(arguments))
    with Progress(Stage.LOADING, sys.stderr, stages=BATCH) as progress:
        known, robot = known_model(tuple(Path(path) for path in arguments.known), robot_with_effects(arguments))
        excluded = excluded_stretches(arguments)
        result = diagnose_each(
            robot,
            arguments.logs,
            known=known,
            reading=ReadOptions(arguments.columns, arguments.topic, arguments.ref_topic, excluded, arguments.anyway),
            out=arguments.out,
            jobs=arguments.jobs,
            progress=progress.show,
        )
        written = write_tables(result, out=arguments.out, json_file=arguments.json)
    say(table(result))
    for path in written:
        say(f"wrote {path}")
    if arguments.out is not None:
        count = len(result.rows) - len(result.refused)
        say(f"wrote {count} {'folder' if count == 1 else 'folders'} in {arguments.out}")
    if not result.refused:
        return DONE
    sys.stdout.flush()
    count = len(result.refused)
    say(
        f"phantom-dyn: {count} of {len(result.rows)} recordings {'was' if count == 1 else 'were'} refused; the table "
        "says why",
        file=sys.stderr,
    )
    return BAD_INPUT
