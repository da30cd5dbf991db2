"""Loads robots and recordings that users give as paths, names or objects, one or several."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from identification.data.readers.lerobot import with_episodes
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.files import is_lerobot, looks_like_log, require_not_swapped
from phantom_dyn import arguments
from phantom_dyn.arguments import parts_of, path_of
from phantom_dyn.errors import UsageError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import looks_like_robot

RobotLike = str | Path | Robot
"""A robot as a user may give it: a file, ``example:NAME``, a built-in name, or what `load_robot` returned."""
RecordingLike = str | Path | Recording
"""A recording as a user may give it: a file, or what `read_recording` returned."""
RecordingsLike = RecordingLike | Iterable[RecordingLike]
"""One recording or several."""
COLUMNS = path_of("the path of a column map or the name of one that is shipped")
"""Type check of the argument ``columns``."""

_ROBOT_WANTED = "wanted a URDF or MJCF file, example:NAME, a built-in name, or a robot from load_robot"
_LOG_WANTED = "wanted the path of a log, a recording from read_recording, or a list of them"


def robot_of(given: RobotLike, recordings: object = ()) -> Robot:
    """The given robot, which is loaded if it is a path or name.

    Args:
        given: A robot, a path, or the name of a built-in robot.
        recordings: Value of the argument for recordings, to detect that the two arguments were exchanged.

    Raises:
        UsageError: If ``given`` is no robot; the message states what was given and what is wanted.
        RobotError: If the robot cannot be loaded.
    """
    if isinstance(given, Robot):
        return given
    if isinstance(given, str | Path):
        logs = [one for one in as_tuple(recordings) if isinstance(one, str | Path)]
        require_not_swapped(given, logs)
        return load_robot(given)
    if isinstance(given, Recording):
        raise UsageError(f"{described(given)} was given in the place of the robot: give the robot first, then the log.")
    raise UsageError(f"{described(given)} was given as the robot, {_ROBOT_WANTED}.")


def recordings_of(
    given: RecordingsLike, robot: Robot, *, columns: str | Path | None = None, torque_needed: bool = True
) -> tuple[Recording, ...]:
    """The given recordings, which are read if they are paths.

    Args:
        given: One recording or several.
        robot: The robot that was recorded.
        columns: Column map for recordings that are paths.
        torque_needed: False if only the motion is used.

    Raises:
        UsageError: If no recording is given, or an element is no recording; the message states what is wanted.
        LogError: If a file cannot be read.
    """
    several = expanded(given)
    if not several:
        raise UsageError(f"No recording was given, {_LOG_WANTED}.")
    return tuple(_recording(one, robot, columns, torque_needed) for one in several)


def expanded(given: object) -> tuple[Any, ...]:
    """The given recordings as a tuple, with folders of LeRobot datasets replaced by their episodes."""
    out: list[object] = []
    for one in as_tuple(given):
        is_dataset = isinstance(one, str | Path) and is_lerobot(Path(one))
        out += with_episodes([str(one)], None) if is_dataset else [one]
    return tuple(out)


def as_tuple(given: object) -> tuple[object, ...]:
    """The elements of a given list or tuple; any other object, such as a text, as a tuple with one element."""
    parts = parts_of(given)
    return (given,) if parts is None else parts


def described(given: object) -> str:
    """Description of an argument, short enough for a message."""
    if isinstance(given, Robot):
        return f"the robot {given.name}"
    if isinstance(given, Recording):
        return f"the recording {given.file}"
    return arguments.described(given)


def _recording(given: object, robot: Robot, columns: str | Path | None, torque_needed: bool) -> Recording:
    """One recording, which is read if it is a path."""
    if isinstance(given, Recording):
        if given.joint_names != robot.joint_names:
            raise UsageError(
                f"the recording {given.file} has the joints {', '.join(given.joint_names)} and {robot.name} has "
                f"{', '.join(robot.joint_names)}: read it again with read_recording(path, robot)."
            )
        return given
    if isinstance(given, str | Path):
        if looks_like_robot(str(given)) and not looks_like_log(given):
            raise UsageError(f"{given} was given as a recording and is a robot: give one robot, and it goes first.")
        return read_recording(given, robot, columns=columns, torque_needed=torque_needed)
    raise UsageError(f"{described(given)} was given as a recording, {_LOG_WANTED}.")
