"""Replaces the torque of joints whose drive torque is unknown by the model's torque.

Their recorded motion is still used, because it acts on the other joints. Their own residual becomes zero, so that it
does not affect any fit.
"""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import replace

import numpy as np

from identification.data.log import Log
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Bool
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError, listed
from phantom_dyn.model.robot import Robot


def unknown_drives(robot: Robot) -> Bool[Array, " nv"]:
    """True for joints with ``drive: unknown``, or whose torque was not read."""
    return np.array([not actuator.drive_known for actuator in robot.actuators], dtype=bool)


def without_unread_drives(robot: Robot, recordings: Iterable[Recording]) -> Robot:
    """The robot, with the drive of each joint marked as unknown if some row of its torque was not read.

    Raises:
        LogError: If no joint with a known torque is left.
    """
    unread = {joint: recording.file for recording in recordings for joint in recording.unread}
    robot = with_unknown_drives(robot, unread)
    if unread and not any(one.actuated and one.drive_known for one in robot.actuators):
        raise LogError(
            f"{next(iter(unread.values()))}: the torque of {listed(unread)} was not read in every row, and no other "
            "torque is known: log torques that were read for every row (phantom-dyn check says what is wrong)."
        )
    return robot


def with_unknown_drives(robot: Robot, joints: Container[str]) -> Robot:
    """The robot, with the drives of some joints marked as unknown."""
    actuators = tuple(
        replace(one, drive_known=one.drive_known and joint not in joints)
        for joint, one in zip(robot.joint_names, robot.actuators, strict=True)
    )
    return replace(robot, actuators=actuators)


def with_model_torque(robot: Robot, log: Log) -> Log:
    """The log with the model's torque on joints with unknown drives, and on joints while a contact acts on them."""
    unknown = unknown_drives(robot) if log.touched is None else unknown_drives(robot) | log.touched
    if not unknown.any():
        return log
    return replace(log, tau=np.where(unknown, inverse_dynamics(robot, log.motion), log.tau))


def unknown_words(file: str, robot: Robot) -> tuple[str, ...]:
    """One sentence that names the joints with unknown drives; empty if there are none."""
    names = [name for name, is_unknown in zip(robot.joint_names, unknown_drives(robot), strict=True) if is_unknown]
    if not names:
        return ()
    joints = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return (
        f"{file}: the torque of {joints} is not known (drive: unknown): this motion is used, and the torque of "
        f"{'this joint' if len(names) == 1 else 'these joints'} is not judged.",
    )
