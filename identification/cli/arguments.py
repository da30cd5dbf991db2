"""Defines the argument parser of all commands, arguments that several commands share, and checks of arguments.

This module has no slow imports, so that wrong arguments are reported at once.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from identification.files import is_lerobot, require_existing, require_not_swapped
from phantom_dyn.errors import UsageError
from phantom_dyn.model.robot_files import find_robot

if TYPE_CHECKING:
    from identification.data.recording import Recording
    from phantom_dyn.model.robot import Robot

DONE, BAD_INPUT, INTERRUPTED = 0, 2, 130
"""Exit codes of every command."""
_LOG_HELP = "CSV, Parquet, NPZ, ROS bag, MCAP or the folder of a LeRobot dataset"
EXAMPLES = "examples:"
"""Line before the examples at the end of a help text."""


class _Formatter(argparse.HelpFormatter):
    """Wraps descriptions, but keeps the lines of examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith(EXAMPLES) else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `UsageError` for wrong arguments, instead of printing its usage and exiting.

    Its help ends with examples, one per line, given without the name of the program.
    """

    def __init__(self, *, prog: str, description: str | None = None, examples: Sequence[str] = ()):
        lines = "\n".join(f"  {prog.split()[0]} {example}" for example in examples)
        epilog = f"{EXAMPLES}\n{lines}" if examples else None
        super().__init__(prog=prog, epilog=epilog, description=description, formatter_class=_Formatter)

    def _parse_optional(self, arg_string: str):
        # -1:2 is no option, but a time interval that begins before zero.
        return None if re.match(r"-[\d.]", arg_string) else super()._parse_optional(arg_string)

    def error(self, message: str) -> NoReturn:
        """Raise a `UsageError` with the message."""
        raise UsageError(f"{message.strip()}; see {self.prog} --help")


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Add the argument ROBOT, and the option that names the robot's configuration."""
    parser.add_argument("robot", metavar="ROBOT", help="URDF or MJCF file, example:NAME, or a built-in device")
    parser.add_argument(
        "--robot-config", metavar="FILE", type=Path, help="robot.yaml to use instead of the one beside ROBOT"
    )


def add_logs(parser: argparse.ArgumentParser) -> None:
    """Add the argument LOG, which may be given several times, and the options for reading logs."""
    parser.add_argument("logs", metavar="LOG", nargs="+", help=_LOG_HELP)
    _add_log_options(parser)


def add_log(parser: argparse.ArgumentParser) -> None:
    """Add the argument LOG, which is given once, and the options for reading the log."""
    parser.add_argument("log", metavar="LOG", help=_LOG_HELP)
    _add_log_options(parser)


def _add_log_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for reading a log, and for leaving out or accepting parts of it."""
    add_reading(parser)
    add_list(parser, "--exclude", metavar="T0:T1", help="stretches of time [s] to leave out")
    parser.add_argument("--anyway", action="store_true", help="judge a recording although it is certainly wrong")


def add_list(parser: argparse.ArgumentParser, option: str, *, metavar: str, help: str, dest: str | None = None) -> None:
    """Add an option that takes one or several values and may be repeated; all values are collected in one list."""
    dest = dest or option.removeprefix("--").replace("-", "_")
    parser.add_argument(option, dest=dest, metavar=metavar, action="extend", nargs="+", default=[], help=help)


def add_effects(parser: argparse.ArgumentParser) -> None:
    """Add the option that names Python files with effects defined by the user."""
    parser.add_argument(
        "--effects",
        dest="effect_files",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="Python file with effects of your own, which join the catalogue for this run; it is executed",
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add the options for reading recordings: columns, topics and episodes."""
    parser.add_argument(
        "--columns",
        metavar="FILE|PRESET",
        type=Path,
        help="YAML that maps other names, units and signs, or the name of a map that is shipped: ur_rtde, libfranka, "
        "plotjuggler, lowstate, bam, sage, mujoco, isaac_lab",
    )
    parser.add_argument("--topic", metavar="NAME", help="topic of joint states in a bag that has several")
    parser.add_argument(
        "--ref-topic", metavar="NAME", help="topic of a bag that has the references, if they are on another one"
    )
    parser.add_argument(
        "--episodes",
        metavar="A:B",
        help="episodes of a LeRobot dataset, each a recording: 0:5 is the first five, 3 is one (default: all)",
    )


def expand_episodes(arguments: argparse.Namespace) -> None:
    """Replace the folders of LeRobot datasets in the arguments by their episodes."""
    hold_out = getattr(arguments, "hold_out", [])
    if arguments.episodes is None and not any(map(is_lerobot, map(Path, (*arguments.logs, *hold_out)))):
        return
    from identification.data.readers.lerobot import with_episodes

    arguments.logs = with_episodes(arguments.logs, arguments.episodes)
    arguments.hold_out = with_episodes(hold_out, None)


def expand_one_episode(arguments: argparse.Namespace) -> None:
    """Replace the folder of a LeRobot dataset in the arguments by the chosen episode.

    Raises:
        UsageError: If several episodes are chosen.
    """
    arguments.logs = [arguments.log]
    expand_episodes(arguments)
    count = len(arguments.logs)
    if count > 1:
        raise UsageError(f"{arguments.log} has {count} episodes, wanted one: choose it, as in --episodes 0")
    arguments.log = arguments.logs[0]


def given_files(arguments: argparse.Namespace) -> tuple[str | Path | None, ...]:
    """All arguments of a command that name files to read; None for arguments that were not given."""
    lists = (getattr(arguments, name, ()) for name in ("logs", "hold_out", "known", "effect_files"))
    single = (getattr(arguments, name, None) for name in ("robot", "robot_config", "columns", "recordings"))
    return (*single, *(path for paths in lists for path in paths or ()))


def require_files(arguments: argparse.Namespace) -> None:
    """Raise an error if the robot or a log does not exist, or if a log is given twice.

    If a recording were given twice, the fit would use copies of its held-out blocks.
    """
    require_not_swapped(arguments.robot, arguments.logs)
    find_robot(arguments.robot)
    seen: dict[Path, str] = {}
    for option, paths in (("LOG", arguments.logs), ("--hold-out", arguments.hold_out)):
        for path in paths:
            require_existing(path)
            resolved = Path(path).resolve()
            if resolved in seen:
                raise UsageError(
                    f"{path} is given twice, as {seen[resolved]} and as {option}; give every recording once"
                )
            seen[resolved] = option


def excluded_stretches(arguments: argparse.Namespace) -> tuple[tuple[float, float], ...]:
    """Start and end [s] of each time interval that ``--exclude`` names."""
    return tuple(_stretch(text) for text in arguments.exclude)


def with_reading_options(read: Callable[..., Recording], arguments: argparse.Namespace) -> Callable[..., Recording]:
    """The function ``read`` with the reading options from the arguments."""
    return partial(
        read,
        columns=arguments.columns,
        topic=arguments.topic,
        ref_topic=arguments.ref_topic,
        excluded=excluded_stretches(arguments),
        anyway=arguments.anyway,
    )


def robot_with_effects(arguments: argparse.Namespace) -> Robot:
    """Loads the robot that the arguments name, with effects from files of the user and from installed packages."""
    from phantom_dyn.effects.user.user_effects import with_user_effects
    from phantom_dyn.model.loading import load_robot

    return with_user_effects(load_robot(arguments.robot, config=arguments.robot_config), arguments.effect_files)


def _stretch(text: str) -> tuple[float, float]:
    """The two times of ``T0:T1`` [s]."""
    try:
        start, stop = (float(part) for part in text.split(":"))
        if math.isnan(start) or math.isnan(stop):
            raise ValueError
    except ValueError:
        raise UsageError(f"--exclude {text} was given, wanted two times in seconds such as 2.5:4") from None
    if not start < stop:
        raise UsageError(f"--exclude {text} ends before it begins, wanted T0 < T1; swap the two times")
    return start, stop


def one_blas_thread() -> None:
    """Limit linear algebra to one thread; must be called before NumPy is loaded.

    The matrices are small, so several threads would only wait for each other. Their number also changes the order of
    sums, and so the last digits of results.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
