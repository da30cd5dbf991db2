"""Replaces the torque of joints whose drive torque is unknown by the model's torque.

The recorded motion of these joints acts on the other joints. Their own torque has no residual then, and no fit uses it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.smoothed_copy import smoothed
from identification.data.log import Log
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Bool, read_only
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def unknown_drives(robot: Robot) -> Bool[Array, " nv"]:
    """True for joints with ``drive: unknown``."""
    return np.array([not actuator.drive_known for actuator in robot.actuators], dtype=bool)


def with_model_torque(robot: Robot, log: Log) -> Log:
    """The log with the model's torque for unknown drives, and for joints that carry a contact while they do."""
    unknown = unknown_drives(robot) if log.touched is None else unknown_drives(robot) | log.touched
    if not unknown.any():
        return log
    return replace(log, tau=np.where(unknown, inverse_dynamics(robot, log.motion), log.tau))


def without_unknown_torques(recording: Recording, robot: Robot) -> Recording:
    """The recording with the model's torque on joints whose drive is unknown, for checks of the other joints."""
    unknown = unknown_drives(robot)
    # A robot with a floating base is compared with the model only once its contacts are known.
    if recording.tau is None or not unknown.any() or robot.floating:
        return recording
    smooth = smoothed(recording)
    if smooth is None:
        return recording
    model = inverse_dynamics(robot, Motion(smooth.t, smooth.q, smooth.v, smooth.a))
    tau = recording.tau.copy()
    for row in np.flatnonzero(unknown):
        tau[:, row] = np.interp(recording.t, smooth.t, model[:, row])
    return replace(recording, tau=read_only(tau))


def unknown_words(file: str, robot: Robot) -> tuple[str, ...]:
    """One sentence on the joints of which only the motion is used; empty if there are no such joints."""
    names = [name for name, is_unknown in zip(robot.joint_names, unknown_drives(robot), strict=True) if is_unknown]
    if not names:
        return ()
    joints = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return (
        f"{file}: the torque of {joints} is not known (drive: unknown): this motion is used, and the torque of "
        f"{'this joint' if len(names) == 1 else 'these joints'} is not judged.",
    )
