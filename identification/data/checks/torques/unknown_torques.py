"""Replaces the torque of joints whose drive is unknown by the model's torque, for the checks of the other joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.smoothed_copy import smoothed
from identification.data.recording import Recording
from identification.data.unknown_drives import unknown_drives
from phantom_dyn.array_types import read_only
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def without_unknown_torques(recording: Recording, robot: Robot) -> Recording:
    """The recording with the model's torque on joints whose drive is unknown.

    It is unchanged if there is no such joint, if the robot has a floating base, or if the recording is too short.
    """
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
