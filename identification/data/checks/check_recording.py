"""All checks of a recording in order: each warning is one sentence that names the joint and the time."""

from __future__ import annotations

from dataclasses import replace

from identification.data.checks.against_model import (
    check_degrees,
    check_flipped,
    check_swapped,
    check_unsigned,
    model_torque,
    spread_samples,
)
from identification.data.checks.positions import check_coarse_step, check_frozen, check_stillness, check_velocity
from identification.data.checks.smoothed_copy import Smooth, smoothed
from identification.data.checks.times_and_torques import check_clipping, check_lag, check_timing
from identification.data.joint_torque import external_torque
from identification.data.recording import Recording
from phantom_dyn.model.robot import Robot


def check_recording(recording: Recording, robot: Robot | None) -> tuple[str, ...]:
    """Warnings about a recording that can be used but that may not be what it seems.

    Args:
        recording: Raw samples.
        robot: Without it only what needs no model is checked.

    Returns:
        One sentence each; a good recording gives none.
    """
    out = [*check_timing(recording), *check_stillness(recording, None if robot is None else robot.prismatic)]
    felt = recording if robot is None else _with_external_torque(recording, robot)
    smooth = smoothed(felt)
    if smooth is not None and smooth.inside.any():
        stated = tuple(
            robot is not None and robot.actuators[j].encoder_counts is not None
            for j in range(len(recording.joint_names))
        )
        out += check_frozen(recording, smooth)
        out += check_coarse_step(recording, smooth, stated)
        out += check_velocity(recording, smooth)
    out += check_clipping(recording)
    if robot is None or smooth is None or recording.tau is None:
        return (*out, *check_degrees(recording, robot, None, None))
    return (*out, *_check_against_model(felt, robot, smooth))


def _with_external_torque(recording: Recording, robot: Robot) -> Recording:
    """The recording with all torque that the joints feel: that of their drives and that of measured forces."""
    if recording.tau is None or not recording.forces:
        return recording
    return replace(recording, tau=recording.tau + external_torque(robot, recording.q, recording.forces))


def _check_against_model(recording: Recording, robot: Robot, smooth: Smooth) -> list[str]:
    """Checks of the torque against the model; one that finds a misreading ends them, as the next would echo it."""
    data = spread_samples(smooth)
    if data is None:
        return list(check_degrees(recording, robot, None, None))
    model = model_torque(robot, data.motion)
    degrees = check_degrees(recording, robot, data, model)
    if degrees:
        return list(degrees)
    swapped, found = check_swapped(recording, robot, data, model)
    if found:
        return list(swapped)
    return [
        *check_flipped(recording, data, model),
        *check_unsigned(recording, data, model),
        *check_lag(recording, robot, smooth),
    ]
