"""The argument parser of every command, and the arguments that several have."""

from __future__ import annotations

import argparse
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
