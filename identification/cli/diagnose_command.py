"""``phantom-dyn diagnose``: find what the model of a robot lacks, from recordings."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from identification.cli.arguments import Parser, add_logs, add_robot, one_blas_thread, require_files, stretch
from identification.cli.each_command import require_each, run_each
from phantom_dyn.errors import UsageError


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    out = Parser(
        prog="phantom-dyn diagnose",
        description="Say where the gap between a robot and its model lies, which unmodelled effect causes it, and how "
        "far the gap shrinks on data that no fit has seen once the effect is added.",
    )
    add_robot(out)
    add_logs(out)
    out.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="write diagnosis.json, report.html, corrected.yaml, .urdf and .xml, randomisation.yaml, feedforward.py "
        "and .csv there",
    )
    out.add_argument("--json", metavar="FILE", type=Path, help="write the diagnosis as JSON to this file")
    several = {"action": "extend", "nargs": "+", "default": []}
    out.add_argument(
        "--hold-out", metavar="LOG", **several, help="recordings that no fit may see; all figures are theirs"
    )
    out.add_argument("--with", dest="known", metavar="FILE", **several, help="corrected.yaml of an earlier diagnosis")
    out.add_argument("--recordings", metavar="FILE", type=Path, help="recordings.yaml: what changed between the LOGs")
    out.add_argument(
        "--motion-only",
        action="store_true",
        help="no torque was recorded: take the one that the controllers in robot.yaml ask for at the q_ref. columns",
    )
    out.add_argument(
        "--each",
        action="store_true",
        help="diagnose every LOG by itself; a LOG may be a folder of them. --out gets a folder for each and the table "
        "of verdicts, diagnoses.csv and diagnoses.json; exit code 2 if one was refused, the others are diagnosed",
    )
    out.add_argument(
        "--jobs",
        metavar="N",
        type=int,
        help="with --each, recordings at once (default: one per core); a single diagnosis needs one process",
    )
    return out


def run(arguments: argparse.Namespace) -> int:
    """Diagnose and print a summary; write files where they are asked for."""
    excluded = tuple(stretch(text) for text in arguments.exclude)
    if arguments.jobs is not None and arguments.jobs < 1:
        raise UsageError(f"--jobs {arguments.jobs} was given, wanted a number of processes from 1 on; leave it out")
    if arguments.motion_only and (arguments.each or getattr(arguments, "recordings", None) is not None):
        raise UsageError("--motion-only does not go with --each or --recordings; diagnose the recordings one by one")
    if arguments.each:
        require_each(arguments)
    require_files(arguments)
    one_blas_thread()
    if arguments.each:
        return run_each(arguments, excluded)
    from identification.cli.progress import Progress
    from identification.export.all_files import not_written
    from identification.reporting.diagnosis_files import check_targets, write_outputs

    check_targets(arguments.out, arguments.json)
    with Progress("reading", sys.stderr) as progress:
        from identification.data.changes import Change
        from identification.data.reading import read_recording
        from identification.diagnosis.diagnosis import diagnose
        from identification.export.corrected.corrected_yaml import known_effects
        from identification.scenarios.at_rest.diagnose_at_rest import diagnose_at_rest, judged_at_rest
        from identification.scenarios.motion_only import motion_robot, with_commanded_torque
        from identification.scenarios.recordings_file import read_changed, read_changes
        from phantom_dyn.model.loading import load_robot

        robot = load_robot(arguments.robot, config=arguments.robot_config)
        robot = motion_robot(robot) if arguments.motion_only else robot
        known = known_effects(tuple(Path(path) for path in arguments.known), robot)
        every = (*arguments.logs, *arguments.hold_out)
        stated = arguments.recordings is not None
        changes = read_changes(arguments.recordings, every, robot.joint_names) if stated else ()

        def read(path: str, change: Change):
            progress.say(f"reading {Path(path).name}")
            if arguments.motion_only:
                return read_recording(
                    path,
                    robot,
                    columns=arguments.columns,
                    topic=arguments.topic,
                    excluded=excluded,
                    torque_needed=False,
                )
            return read_changed(
                path, robot, change, columns=arguments.columns, topic=arguments.topic, excluded=excluded
            )

        alike = tuple(Change(Path(path).name) for path in every)
        read_all = tuple(read(path, change) for path, change in zip(every, changes or alike, strict=True))
        at_rest = arguments.motion_only and judged_at_rest(robot, read_all)
        if at_rest and (known or arguments.hold_out):
            raise UsageError(
                "--with and --hold-out do not go with recordings that are judged at rest, where every rest is held "
                "out in turn; leave them out"
            )
        if arguments.motion_only and not at_rest:
            read_all = tuple(with_commanded_torque(recording, robot) for recording in read_all)
        recordings, hold_out = read_all[: len(arguments.logs)], read_all[len(arguments.logs) :]
        if at_rest:
            diagnosis = diagnose_at_rest(robot, recordings)
        else:
            diagnosis = diagnose(
                robot, recordings, hold_out=hold_out, known=known, changes=changes, progress=progress.say
            )
        progress.say("writing")
        config = arguments.robot_config
        written = write_outputs(
            diagnosis, robot, out=arguments.out, json_file=arguments.json, known=known, config=config
        )
    from identification.reporting.diagnosis_summary import summary

    print(summary(diagnosis))
    for path in written:
        print(f"wrote {path}")
    if arguments.out is not None and (lacking := not_written(arguments.out, written)):
        print(f"not written: {', '.join(lacking)}; see {arguments.out / 'report.html'}")
    return 0
