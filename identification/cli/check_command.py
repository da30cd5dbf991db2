"""``phantom-dyn check``: what is wrong with a recording, nothing else."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from identification.cli.arguments import Parser, add_reading
from identification.files import require_existing
from phantom_dyn.errors import UsageError

if TYPE_CHECKING:
    from identification.data.recording import Recording


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    out = Parser(prog="phantom-dyn check", description="Tell what is wrong with a recording, nothing else.")
    out.add_argument("log", metavar="LOG", help="CSV, NPZ, Parquet, ROS bag or MCAP")
    out.add_argument("--robot", metavar="ROBOT", help="URDF or MJCF file, example:NAME or built-in name")
    out.add_argument("--robot-config", metavar="FILE", help="robot.yaml of the robot (default: beside its file)")
    add_reading(out)
    return out


def run(arguments: argparse.Namespace) -> int:
    """Print what the recording is and what is wrong with it."""
    if arguments.robot_config is not None and arguments.robot is None:
        raise UsageError("--robot-config was given without --robot: name the robot that it belongs to.")
    require_existing(arguments.log)
    found = _recording(arguments) if arguments.robot is None else _recording_of_robot(arguments)
    seconds = float(found.t[-1] - found.t[0])
    print(f"{found.file}: {len(found.t)} samples, {seconds:.6g} s, {(len(found.t) - 1) / seconds:.6g} Hz")
    print(f"joints: {', '.join(found.joint_names)}")
    for warning in found.warnings:
        print(f"warning: {warning}")
    if not found.warnings:
        print("nothing is wrong with it" + ("" if arguments.robot else ", as far as can be told without --robot"))
    return 0


def _recording(arguments: argparse.Namespace) -> Recording:
    """The log with every warning that needs no model of the robot."""
    from identification.data.checks.check_recording import check_recording
    from identification.data.readers.read_table import read_table
    from identification.data.reading import unassigned_recording

    table = read_table(arguments.log, columns=arguments.columns, topic=arguments.topic)
    found = unassigned_recording(table)
    return replace(found, warnings=(*table.warnings, *check_recording(found, None)))


def _recording_of_robot(arguments: argparse.Namespace) -> Recording:
    """The log with every warning about it and about the model of its robot."""
    from identification.data.reading import read_recording
    from phantom_dyn.model.loading import load_robot

    config = None if arguments.robot_config is None else Path(arguments.robot_config)
    robot = load_robot(arguments.robot, config=config)
    found = read_recording(arguments.log, robot, columns=arguments.columns, topic=arguments.topic)
    return replace(found, warnings=(*robot.warnings, *found.warnings))
