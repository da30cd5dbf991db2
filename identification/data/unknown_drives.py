"""Joints that something moves with a torque that nobody knows: the model's own torque stands in for it.

Their recorded motion acts on the other joints. Their own row gets no residual, and none of its samples is used.
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
    """The log with the model's torque in place of those of unknown drives, and where a joint carries a contact."""
    unknown = unknown_drives(robot) if log.touched is None else unknown_drives(robot) | log.touched
    if not unknown.any():
        return log
    return replace(log, tau=np.where(unknown, inverse_dynamics(robot, log.motion), log.tau))


def without_unknown_torques(recording: Recording, robot: Robot) -> Recording:
    """The recording with the model's torque on joints whose drive is unknown, for checks of the others."""
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
    """One sentence on the joints of which only the motion is used; none where there are none."""
    names = [name for name, own in zip(robot.joint_names, unknown_drives(robot), strict=True) if own]
    if not names:
        return ()
    joints = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return (
        f"{file}: the torque of {joints} is not known (drive: unknown): this motion is used, and the torque of "
        f"{'this joint' if len(names) == 1 else 'these joints'} is not judged.",
    )
