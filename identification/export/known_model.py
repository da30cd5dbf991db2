"""Reads the effects that earlier diagnoses found, and warns if these were diagnoses of another robot."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from identification.diagnosis.columns.known_geometry import POSE_EFFECTS
from identification.diagnosis.columns.terms import KnownEffect
from identification.export.check.file_torques import MJCF_FORMAT, URDF_FORMAT, used_numbers
from identification.export.corrected.corrected_model import numbers_of_effect
from identification.export.corrected.corrected_yaml import Corrected, known_effects, read_corrected
from phantom_dyn.errors import ParameterError, RobotError, UsageError, known_names, listed, shortened
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot

_LAST_LINE = 200  # number of bytes at the end of a file in which the id of the run is searched


def known_model(files: tuple[Path, ...], robot: Robot) -> tuple[tuple[KnownEffect, ...], Robot]:
    """Reads several ``corrected.yaml``.

    Returns:
        All effects in the files, and the robot with the files' model error: for each joint the largest in any file.
        The robot has a warning for each file that was made for another robot.

    Raises:
        ParameterError: If a file names an unknown effect, joint or parameter, or leaves one out.
        UsageError: If effects would be added twice: a file is given twice, or the robot already has its effects.
    """
    effects = known_effects(files, robot)
    error, warnings, remaining = np.zeros((robot.nv, 2)), list[str](), iter(effects)
    for file in files:
        model = read_corrected(file)
        warnings += _wrong_robot_warning(file, model, tuple(islice(remaining, len(model.effects))), robot)
        for one in model.model_error:
            if one.joint not in robot.joint_names:
                raise ParameterError(
                    f"{file}: model_error is of joint '{shortened(one.joint)}', which this robot does not have: "
                    f"{known_names(one.joint, robot.joint_names, 'joints')}"
                )
            row = robot.joint_names.index(one.joint)
            error[row] = np.maximum(error[row], [one.slow, one.moving])
    if warnings:
        robot = replace(robot, warnings=(*robot.warnings, *warnings))
    return effects, replace(robot, model_error=error) if error.any() else robot


def _wrong_robot_warning(file: Path, model: Corrected, effects: Iterable[KnownEffect], robot: Robot) -> tuple[str, ...]:
    """A warning if a file was made for another robot; empty if the file states no hash, as files made by hand.

    Raises:
        UsageError: If one run wrote the robot's file and this one, as the robot then already has the effects.
    """
    if robot.sha256 in ("", model.sha256) or not re.fullmatch("[0-9a-f]{64}", model.sha256):
        return ()
    made_for = shortened(model.robot)
    twice = _effects_in_robot(file, effects, robot)
    if twice:
        raise UsageError(
            f"{robot.source} was written together with {file} and has its effects already ({listed(twice)}), which "
            f"would count twice: give {made_for}, for which {file} was made, or leave {file} out."
        )
    return (
        f"{file} was made for {made_for}, and {robot.source} is another file (their SHA-256 differ): leave it out if "
        f"{robot.source} has its effects already, or is another robot.",
    )


def _effects_in_robot(file: Path, effects: Iterable[KnownEffect], robot: Robot) -> list[str]:
    """Names of the effects that the robot's file already contains; none unless one run wrote both files."""
    try:
        robot_file = find_robot(robot.source)
    except RobotError:  # made in memory
        return []
    if _run_id(robot_file) is None or _run_id(robot_file) != _run_id(file):
        return []
    numbers = (URDF_FORMAT if robot_file.suffix == ".urdf" else MJCF_FORMAT).numbers or frozenset()
    return [
        one.effect if one.joint is None else f"{one.effect} on {one.joint}"
        for one in effects
        if one.effect in POSE_EFFECTS or used_numbers(numbers_of_effect(robot, one)) & numbers
    ]


def _run_id(file: Path) -> str | None:
    """Id of the run that wrote a file, from the file's last line; None if the line has no id."""
    found = re.search(rb"run: (\S+)(?: -->)?\s*$", file.read_bytes()[-_LAST_LINE:])
    return None if found is None else found[1].decode(errors="replace")
