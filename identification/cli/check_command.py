"""The command ``phantom-dyn check``: reports faults of recordings."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from identification.cli.arguments import DONE, Parser, add_reading, expand_episodes, one_blas_thread
from identification.cli.terminal.printed import say
from identification.cli.terminal.progress import CHECK, Progress
from identification.files import looks_like_log, require_existing, require_not_swapped
from identification.stages import Announcement, Stage
from phantom_dyn.errors import UsageError
from phantom_dyn.model.robot_files import looks_like_robot


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn check",
        description="Tell what is wrong with recordings, nothing else: faults beyond doubt, for which diagnose and "
        "identify refuse a recording, what was mended, and what may be wrong. Exit code 0 whatever is found.",
        examples=("check robot.urdf log.csv", "check log.csv other.csv --columns columns.yaml"),
    )
    out.add_argument(
        "words",
        metavar="[ROBOT] LOG",
        nargs="+",
        help="URDF or MJCF file, example:NAME or built-in name (may be left out: then less is checked), and recordings",
    )
    out.add_argument("--robot", metavar="ROBOT", help="the same as ROBOT in front of the recordings")
    out.add_argument(
        "--robot-config", metavar="FILE", type=Path, help="robot.yaml of the robot (default: beside its file)"
    )
    out.add_argument(
        "--stance",
        action="store_true",
        help="if the robot is not bolted down, also say how many equations can be used while feet stand on the ground",
    )
    add_reading(out)
    return out


def run(arguments: argparse.Namespace) -> int:
    """Print a description of each recording and its faults."""
    one_blas_thread()
    robot_file, arguments.logs = _robot_and_logs(arguments)
    if arguments.robot_config is not None and robot_file is None:
        raise UsageError("--robot-config was given without a robot: name the robot that it belongs to.")
    for log in arguments.logs:
        require_existing(log)
    expand_episodes(arguments)
    from identification.data.checked_file import checked_file
    from phantom_dyn.model.loading import load_robot

    robot = None if robot_file is None else load_robot(robot_file, config=arguments.robot_config)
    options = {"columns": arguments.columns, "topic": arguments.topic, "ref_topic": arguments.ref_topic}
    for log in arguments.logs:
        with Progress(Stage.READING, sys.stderr, stages=CHECK) as progress:
            progress.show(Announcement(Stage.READING, detail={"file": Path(log).name}))
            found = checked_file(log, robot, **options, progress=progress.show)
        say(found)
        if arguments.stance and robot is not None:
            from identification.data.floating.stance_rows import stance_words
            from identification.data.reading import read_recording

            say(stance_words(read_recording(log, robot, **options), robot))
    return DONE


def _robot_and_logs(arguments: argparse.Namespace) -> tuple[str | None, list[str]]:
    """The robot (None if none was given) and the recordings."""
    first, *rest = arguments.words
    if looks_like_log(first) and any(looks_like_robot(word) for word in rest):
        require_not_swapped(first, rest)
    if arguments.robot is not None or not looks_like_robot(first):
        return arguments.robot, arguments.words
    if not rest:
        raise UsageError(f"{first} was given, a robot without a recording: name a recording after it.")
    return first, rest
