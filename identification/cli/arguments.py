"""The argument parser of every command, arguments that several share, and checks that need nothing heavy loaded."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from identification.files import is_lerobot, require_existing, require_not_swapped
from phantom_dyn.errors import UsageError
from phantom_dyn.model.robot_files import find_robot

DONE, BAD_INPUT, INTERRUPTED = 0, 2, 130
"""Exit codes of every command."""
_LOG_HELP = "CSV, Parquet, NPZ, ROS bag, MCAP or the folder of a LeRobot dataset"
EXAMPLES = "examples:"
"""First line of the examples at the end of a help."""


class _Formatter(argparse.HelpFormatter):
    """Wraps descriptions and leaves the lines of examples as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith(EXAMPLES) else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `UsageError` where argparse would print its usage and exit.

    Its help ends with examples, one a line, without the name of the program in front.
    """

    def __init__(self, *, prog: str, description: str | None = None, examples: Sequence[str] = ()):
        lines = "\n".join(f"  {prog.split()[0]} {example}" for example in examples)
        epilog = f"{EXAMPLES}\n{lines}" if examples else None
        super().__init__(prog=prog, epilog=epilog, description=description, formatter_class=_Formatter)

    def _parse_optional(self, arg_string: str):
        # A stretch of time that begins before zero, -1:2, is no option although it begins as one.
        return None if re.match(r"-[\d.]", arg_string) else super()._parse_optional(arg_string)

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments in one sentence."""
        raise UsageError(f"{message.strip()}; see {self.prog} --help")


def add_robot(parser: argparse.ArgumentParser) -> None:
    """ROBOT and the option that names its configuration."""
    parser.add_argument("robot", metavar="ROBOT", help="URDF or MJCF file, example:NAME, or a built-in device")
    parser.add_argument(
        "--robot-config", metavar="FILE", type=Path, help="robot.yaml to use instead of the one beside ROBOT"
    )


def add_logs(parser: argparse.ArgumentParser) -> None:
    """LOG, once or more, and how recordings are read."""
    parser.add_argument("logs", metavar="LOG", nargs="+", help=_LOG_HELP)
    _add_log_options(parser)


def add_log(parser: argparse.ArgumentParser) -> None:
    """LOG, once, and how it is read."""
    parser.add_argument("log", metavar="LOG", help=_LOG_HELP)
    _add_log_options(parser)


def _add_log_options(parser: argparse.ArgumentParser) -> None:
    add_reading(parser)
    add_list(parser, "--exclude", metavar="T0:T1", help="stretches of time [s] to leave out")
    parser.add_argument("--anyway", action="store_true", help="judge a recording although it is certainly wrong")


def add_list(parser: argparse.ArgumentParser, option: str, *, metavar: str, help: str, dest: str | None = None) -> None:
    """An option with one value or more that may be given again: all values are collected in one list."""
    dest = dest or option.removeprefix("--").replace("-", "_")
    parser.add_argument(option, dest=dest, metavar=metavar, action="extend", nargs="+", default=[], help=help)


def add_effects(parser: argparse.ArgumentParser) -> None:
    """The option that names files of effects beside the catalogue."""
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
    """How the columns of a recording are read."""
    parser.add_argument(
        "--columns",
        metavar="FILE|PRESET",
        type=Path,
        help="YAML that maps other names, units and signs, or the name of a map that is shipped: ur_rtde, libfranka, "
        "plotjuggler, lowstate, bam, sage, mujoco, isaac_lab",
    )
    parser.add_argument("--topic", metavar="NAME", help="topic of joint states in a bag that has several")
    parser.add_argument(
        "--ref-topic", metavar="NAME", help="topic of a bag that has the references, where another one has them"
    )
    parser.add_argument(
        "--episodes",
        metavar="A:B",
        help="episodes of a LeRobot dataset, each a recording: 0:5 are the first five, 3 is one (default: all)",
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
        UsageError: If several are chosen.
    """
    if arguments.episodes is None and not is_lerobot(Path(arguments.log)):
        return
    from identification.data.readers.lerobot import with_episodes

    meant = with_episodes([arguments.log], arguments.episodes)
    if len(meant) > 1:
        raise UsageError(f"{arguments.log} has {len(meant)} episodes, wanted one: choose it, as in --episodes 0")
    arguments.log = meant[0]


def given_files(arguments: argparse.Namespace) -> tuple[str | Path | None, ...]:
    """Arguments of a command that may be files to be read."""
    lists = (getattr(arguments, name, ()) for name in ("logs", "hold_out", "known", "effect_files"))
    one = (getattr(arguments, name, None) for name in ("robot", "robot_config", "columns", "recordings"))
    return (*one, *(path for paths in lists for path in paths or ()))


def require_files(arguments: argparse.Namespace) -> None:
    """Refuse a missing robot or log, and a log given twice, before slow imports.

    Blocks of a recording given twice would be predicted by fits that have seen their copy.
    """
    require_not_swapped(arguments.robot, arguments.logs)
    find_robot(arguments.robot)
    seen: dict[Path, str] = {}
    for option, paths in (("LOG", arguments.logs), ("--hold-out", arguments.hold_out)):
        for path in paths:
            require_existing(path)
            place = Path(path).resolve()
            if place in seen:
                raise UsageError(f"{path} is given twice, as {seen[place]} and as {option}; give every recording once")
            seen[place] = option


def excluded_stretches(arguments: argparse.Namespace) -> tuple[tuple[float, float], ...]:
    """Start and end [s] of each stretch of time that ``--exclude`` names."""
    return tuple(_stretch(text) for text in arguments.exclude)


def _stretch(text: str) -> tuple[float, float]:
    """``T0:T1`` as two times."""
    try:
        start, stop = (float(part) for part in text.split(":"))
        if math.isnan(start) or math.isnan(stop):
            raise ValueError
    except ValueError:
        raise UsageError(f"--exclude {text} was given, wanted two times in seconds such as 2.5:4") from None
    if not start < stop:
        raise UsageError(f"--exclude {text} ends before it begins, wanted T0 < T1; turn the two times round")
    return start, stop


def one_blas_thread() -> None:
    """One thread of linear algebra, if NumPy is not loaded yet, whatever the environment says.

    Matrices are small and threads wait for each other; and with more of them sums come in another order, so that the
    same recording would give other last digits on another machine.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
