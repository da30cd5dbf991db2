"""Estimates the torque between two readings of a drive's voltage, which a bus reads once per frame.

A drive holds each reference until the next one arrives. Its voltage jumps when a reference arrives, and then falls as
the joint follows. The bus always reads the voltage at the same time after a jump. So linear interpolation between the
readings does not give the mean voltage over the frame. They differ by at most the gain times the change of the
reference in half a frame, with either sign. The readings do not show when in the frame a reference arrives; only the
motion shows this.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.data.drive_loop import DriveLoop
from identification.data.drives.joint_torque import copper_share, per_volt
from identification.data.log import Log
from identification.data.recording import Recording
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot

# Number of points within a frame over which a voltage is averaged.
_FINE = 16
# Possible arrival times of the reference, counted from the middle of the frame, as shares of the frame.
_ARRIVALS = (-0.5, -0.25, 0.0, 0.25, 0.5)


@dataclass(frozen=True)
class BetweenReadings:
    """Torque of drives between two readings of their voltage, one frame apart, shape ``(N, nv)`` [N m or N].

    Attributes:
        torque: Mean torque over the frame around each reading, if references arrive in the middle of a frame, minus the
            interpolated readings. It is zero unless a drive reduces its voltage to protect itself.
        arrival: Change of the mean torque if references arrive one frame later.
        nonlinear_std: Standard deviation of the part of the mean torque that is not linear in the arrival time: a drive
            may reduce its voltage in this frame or in the next. It has a sign, so that filters act on it as on the
            torque.
    """

    torque: Float[Array, "N nv"]
    arrival: Float[Array, "N nv"]
    nonlinear_std: Float[Array, "N nv"]


def between_readings(recording: Recording, robot: Robot, t: Float[Array, " N"], held: bool) -> BetweenReadings | None:
    """Torque between readings of voltages; None without such readings, or if references are not held.

    Args:
        recording: Recording whose loops were identified from its voltages.
        robot: The robot, with the constants of its drives.
        t: Uniform times [s], shape ``(N,)``.
        held: True if a drive holds each reference until the next one.
    """
    if not held or recording.q_ref is None or not recording.loops:
        return None
    torque, arrival, nonlinear_std = np.zeros((3, len(t), robot.nv))
    for j, (joint, loop) in enumerate(zip(robot.joint_names, recording.loops, strict=True)):
        if loop is None or loop.computed or recording.torque_from.get(joint) != "u":
            continue
        cold_share = 1.0 if recording.temperature is None else copper_share(recording.temperature[:, j])
        torque_per_volt = per_volt(robot.actuators[j]) * np.interp(
            t, recording.t, np.broadcast_to(cold_share, recording.t.shape)
        )
        means = np.array([_mean_voltage(loop, recording, t, j, one) for one in _ARRIVALS])
        arrival[:, j] = torque_per_volt * (means[-1] - means[0])
        if loop.dropped:
            # The mean over a frame of straight lines between readings: an eighth of each neighbour and three quarters.
            interpolated = np.convolve(_read_voltage(loop, recording, t, j), [0.125, 0.75, 0.125], "same")
            middle = means[len(_ARRIVALS) // 2]
            # The part of the mean voltage that is not linear in the arrival time.
            deviation = means - middle - np.outer(_ARRIVALS, means[-1] - means[0])
            largest = np.argmax(np.abs(deviation), axis=0)
            sign = np.sign(deviation[largest, np.arange(len(t))])
            torque[1:-1, j] = (torque_per_volt * (middle - interpolated))[1:-1]
            nonlinear_std[1:-1, j] = (torque_per_volt * sign * np.sqrt(np.mean(deviation**2, axis=0)))[1:-1]
    return BetweenReadings(torque, arrival, nonlinear_std) if arrival.any() else None


def _read_voltage(loop: DriveLoop, recording: Recording, t: Float[Array, " N"], j: int) -> Float[Array, " N"]:
    """Computed voltage at the times at which the bus reads it, shape ``(N,)``."""
    assert recording.q_ref is not None
    reference = np.interp(t - loop.delay, recording.t, recording.q_ref[:, j])
    return loop.output_at(reference - np.interp(t, recording.t, recording.q[:, j]))


def _mean_voltage(
    loop: DriveLoop, recording: Recording, t: Float[Array, " N"], j: int, arrival: float
) -> Float[Array, " N"]:
    """Computed voltage, averaged over the frame around each time, shape ``(N,)``.

    Args:
        loop: Control loop of the drive.
        recording: Recording with references and motion.
        t: Uniform times [s], one frame apart.
        j: Index of the joint.
        arrival: Arrival time of references, one of `_ARRIVALS`.
    """
    assert recording.q_ref is not None
    frame = float((t[-1] - t[0]) / max(len(t) - 1, 1))
    out = np.zeros(len(t))
    for k in range(_FINE):
        times = t + frame * ((k + 0.5) / _FINE - 0.5)
        sent = np.searchsorted(recording.t, times - loop.delay - (arrival - 0.5) * frame + 1e-9, side="right") - 1
        reference = recording.q_ref[np.clip(sent, 0, None), j]
        out += loop.output_at(reference - np.interp(times, recording.t, recording.q[:, j])) / _FINE
    return out


def arrival_notes(robot: Robot, recordings: tuple[Recording, ...]) -> tuple[Note, ...]:
    """Notes on joints whose references arrive at an unknown time, with the viscous friction that has the same effect.

    Each recording in which such a drive reduces its voltage to protect itself adds a note.

    Args:
        robot: Robot with the names of these joints in ``unknown_arrivals``.
        recordings: Recordings with the control loops of their drives.
    """
    out = []
    for joint in robot.unknown_arrivals:
        j = robot.joint_names.index(joint)
        read = [(one, loop) for one in recordings if one.loops and (loop := one.loops[j]) is not None]
        frames = [(float(np.median(np.diff(one.t))), loop.gain) for one, loop in read]
        frame, gain = max(frames, key=lambda pair: pair[0] * pair[1])
        viscous = 0.5 * frame * gain * per_volt(robot.actuators[j])
        unit = "N s/m" if robot.prismatic[j] else "N m s/rad"
        out.append(Note(Code.OPEN_ARRIVAL, joint, {"frame": frame, "viscous": viscous, "unit": unit}))
        out += [_drop_note(one, robot, j, loop) for one, loop in read if loop.dropped]
    return tuple(out)


def _drop_note(recording: Recording, robot: Robot, j: int, loop: DriveLoop) -> Note:
    """Note on a drive that reduces its voltage beyond a position error."""
    numbers = {"file": recording.file, "beyond": loop.drops_beyond, "most": loop.drops_to, "share": loop.dropped}
    return Note(Code.DRIVE_DROPS, robot.joint_names[j], {**numbers, "unit": "m" if robot.prismatic[j] else "rad"})


def with_unknown_arrivals(robot: Robot, logs: tuple[Log, ...]) -> Robot:
    """The robot with the names of the joints whose references arrive at an unknown time within a frame."""
    unknown = [log.arrival.any(axis=0) for log in logs if log.arrival is not None]
    if not unknown:
        return robot
    joints = zip(robot.joint_names, np.any(unknown, axis=0), strict=True)
    return replace(robot, unknown_arrivals=tuple(joint for joint, is_unknown in joints if is_unknown))
