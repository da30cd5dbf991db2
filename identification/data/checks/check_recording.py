"""Runs all checks of a recording in order; each warning is one sentence that names the joint and the time."""

from __future__ import annotations

from dataclasses import dataclass, replace

from identification.data.checks.against_model import (
    check_degrees,
    check_flipped,
    check_swapped,
    model_torque,
    spread_samples,
)
from identification.data.checks.beyond_range import beyond_range
from identification.data.checks.certain_faults import certain_faults, load_or_current_words
from identification.data.checks.divergence import diverged
from identification.data.checks.drive_loops import check_computed, check_controllers
from identification.data.checks.one_line import check_one_line
from identification.data.checks.positions import (
    check_coarse_step,
    check_frozen,
    check_jumps,
    check_sampling,
    check_stillness,
    check_velocity,
    position_noise,
)
from identification.data.checks.readings.reading import as_recorded
from identification.data.checks.readings.suspects import slow_clock
from identification.data.checks.references import reference_faults
from identification.data.checks.smoothed_copy import SmoothedRecording, smoothed
from identification.data.checks.times_and_torques import check_clipping, check_flat, check_repeated, check_timing
from identification.data.checks.torques.filtered_torques import check_filtered, filtered_joints
from identification.data.checks.torques.lag_warnings import check_lag
from identification.data.checks.torques.late_torques import late_torques
from identification.data.checks.torques.subtracted_friction import check_subtracted_friction
from identification.data.checks.torques.torque_lag import is_reported, lags_and_low_passes
from identification.data.checks.torques.unknown_torques import without_unknown_torques
from identification.data.checks.torques.unsigned_torques import check_unsigned
from identification.data.checks.torques.weight_and_friction import check_weights
from identification.data.drives.joint_torque import external_torque
from identification.data.floating.sensor_checks import check_base
from identification.data.recording import Fault, Recording
from identification.data.stretches import busiest
from identification.data.unknown_drives import with_unknown_drives
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class Checked:
    """Result of the checks.

    Attributes:
        warnings: Sentences on possible errors.
        wrong: Certain faults.
        unread: Joints whose torque repeats one value in many rows in which it was not measured; a diagnosis does not
            judge them.
    """

    warnings: tuple[str, ...]
    wrong: tuple[Fault, ...] = ()
    unread: tuple[str, ...] = ()


def checked(recording: Recording, robot: Robot | None) -> Checked:
    """Possible errors and certain faults of a recording.

    Args:
        recording: Raw samples.
        robot: The given model; None for the checks that need no model.

    Returns:
        Warnings of one sentence each, and faults; a good recording has neither. In a long recording, checks that
        compare columns use the five minutes with most motion.
    """
    repeated = check_repeated(recording)
    certain = slow_clock(recording) or diverged(recording)
    if certain is not None:
        # All other findings would be consequences of this fault.
        return Checked((), (certain,), tuple(repeated))
    prismatic = None if robot is None else robot.prismatic
    noise = position_noise(recording)
    out = [
        *check_timing(recording),
        *check_sampling(recording, prismatic, noise),
        *check_jumps(recording, prismatic, noise),
        *check_stillness(recording, prismatic, noise),
        *check_clipping(recording),
        *repeated.values(),
        *check_flat(recording),
    ]
    recording = busiest(recording)
    if robot is not None and repeated:
        # On these joints, any difference from the model would only come from the missing readings of the torque. So
        # their torque is not compared with the model.
        robot = with_unknown_drives(robot, repeated)
        recording = without_unknown_torques(recording, robot)
    smooth = smoothed(recording)
    if smooth is not None and smooth.inside.any():
        stated = tuple(
            robot is not None and robot.actuators[j].encoder_counts is not None
            for j in range(len(recording.joint_names))
        )
        out += [
            *check_frozen(recording, smooth),
            *check_coarse_step(recording, smooth, stated),
            *check_velocity(recording, smooth),
        ]
    filtered = filtered_joints(recording)
    out += [*check_computed(recording), *check_filtered(recording, filtered)]
    if robot is None or robot.floating or smooth is None or recording.tau is None:
        found = _check_motion(recording, robot)
    else:
        found = _check_torque(recording, robot, smooth, filtered)
    return Checked((*out, *found.warnings), found.wrong, tuple(repeated))


def _check_motion(recording: Recording, robot: Robot | None) -> Checked:
    """Checks of a recording whose torque is not compared with the model.

    There is no torque, no model, a floating base, or too short a recording.

    Args:
        recording: Raw samples.
        robot: The given model, or None.
    """
    degrees = check_degrees(recording, robot, None, None)
    if robot is None:
        return Checked(degrees)
    if robot.floating:
        # Contact forces on the feet cause torques that the model does not contain.
        warnings, wrong = check_base(recording, robot)
        return Checked((*degrees, *warnings), wrong)
    wrong = certain_faults(recording, robot, None)[0] or beyond_range(recording, robot)
    return Checked(degrees, wrong or reference_faults(recording, robot))


def _check_torque(recording: Recording, robot: Robot, smooth: SmoothedRecording, filtered: tuple[str, ...]) -> Checked:
    """Checks of the torque that compare it with the model.

    Args:
        recording: Raw samples.
        robot: The given model.
        smooth: The smoothed copy.
        filtered: Joints whose torque was filtered differently from their position.
    """
    assert recording.tau is not None
    external = external_torque(robot, recording.q, recording.forces) if recording.forces else None
    # The torque of the measured forces is smoothed like that of the drives, in a copy of the recording in which it
    # takes the place of the drive torque.
    forces = None if external is None else smoothed(replace(recording, tau=external, forces={}))
    # A reading is the data under one assumption on units, signs and order of joints; this one is the data as recorded.
    reading = as_recorded(smooth, robot, recording.torque_from, None if forces is None else forces.tau)
    wrong, possible_mistakes = certain_faults(recording, robot, reading)
    wrong = wrong or beyond_range(recording, robot)
    if wrong or possible_mistakes:
        # Other differences from the model would mostly be consequences of these faults.
        return Checked(possible_mistakes, wrong)
    with_forces = recording
    if external is not None and forces is not None and forces.tau is not None and smooth.tau is not None:
        with_forces = replace(recording, tau=recording.tau + external, forces={})
        smooth = replace(smooth, tau=smooth.tau + forces.tau)
    against = _check_against_model(recording, robot, smooth, with_forces, filtered)
    loads = load_or_current_words(recording, robot, reading)
    return Checked((*loads, *check_controllers(recording, robot), *against.warnings), against.wrong)


def _check_against_model(
    recording: Recording, robot: Robot, smooth: SmoothedRecording, with_forces: Recording, filtered: tuple[str, ...]
) -> Checked:
    """Checks of the torque against the model; an error that would disturb the later checks is reported alone.

    Args:
        recording: Raw samples.
        robot: The given model.
        smooth: The smoothed copy; its torque includes that of measured forces.
        with_forces: Raw samples, with the torque of measured forces added to their torque.
        filtered: Joints whose torque was filtered differently from their position.
    """
    data = spread_samples(smooth)
    if data is None:
        return Checked(check_degrees(recording, robot, None, None))
    model = model_torque(robot, data.motion)
    degrees = check_degrees(recording, robot, data, model)
    if degrees:
        return Checked(degrees)
    swapped, found = check_swapped(recording, robot, data, model)
    if found:
        return Checked(tuple(swapped))
    lags = lags_and_low_passes(robot, with_forces, smooth)
    reported = [(lag, low_pass) for lag, low_pass in lags if lag is not None and is_reported(lag)]
    low_passes = [low_pass for _, low_pass in reported if low_pass is not None]
    late = late_torques(with_forces, [lag for lag, _ in reported], low_passes, smooth.step)
    if late is not None:
        return Checked((), (late,))
    return Checked(
        (
            *check_one_line(robot, smooth),
            *check_weights(recording.file, robot, smooth),
            *check_flipped(recording, robot, data, model),
            *check_unsigned(recording, data, model),
            *check_lag(with_forces, robot, smooth, lags, higher_order=filtered),
            *check_subtracted_friction(recording, robot, smooth),
        )
    )
