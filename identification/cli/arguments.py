"""The argument parser of every command, and what is checked before anything heavy is loaded.

The argument parser of every command, and the arguments that several have.

What commands that read a robot and recordings check before anything heavy is loaded.

How many threads linear algebra takes.
"""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path
from typing import NoReturn

from phantom_dyn.errors import UsageError


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `UsageError` where argparse would print its usage and leave the process."""

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
    parser.add_argument("logs", metavar="LOG", nargs="+", help="CSV, Parquet, NPZ, ROS bag or MCAP")
    add_reading(parser)
    parser.add_argument(
        "--exclude", metavar="T0:T1", action="extend", nargs="+", default=[], help="stretches of time [s] to leave out"
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """How the columns of a recording are read."""
    parser.add_argument("--columns", metavar="FILE", type=Path, help="YAML that maps other names, units and signs")
    parser.add_argument("--topic", metavar="NAME", help="JointState topic of a bag that has several")


def require_files(arguments: argparse.Namespace) -> None:
    """Refuse a robot or log that is not there, and a log given twice, before anything heavy is loaded.

    Blocks of a recording that is there twice would be judged by fits that have seen their copy.
    """
    from identification.data.readers.read_table import require_existing
    from phantom_dyn.model.robot_files import find_robot

    find_robot(arguments.robot)
    seen: dict[Path, str] = {}
    for option, paths in (("LOG", arguments.logs), ("--hold-out", arguments.hold_out)):
        for path in paths:
            require_existing(path)
            place = Path(path).resolve()
            if place in seen:
                raise UsageError(f"{path} is given twice, as {seen[place]} and as {option}; give every recording once")
            seen[place] = option


def stretch(text: str) -> tuple[float, float]:
    """``T0:T1`` as two times."""
    try:
        start, stop = (float(part) for part in text.split(":"))
    except ValueError:
        raise UsageError(f"--exclude {text} was given, wanted two times in seconds such as 2.5:4") from None
    if not start < stop:
        raise UsageError(f"--exclude {text} ends before it begins, wanted T0 < T1; turn the two times round")
    return start, stop


def one_blas_thread() -> None:
    """Before NumPy is loaded: matrices are small, and two threads on a busy machine wait for each other."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
