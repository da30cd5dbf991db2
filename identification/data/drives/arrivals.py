"""What a voltage that is read once a frame leaves open: when within the frame the next reference arrives in the drive.

A drive follows a held reference until the next one comes, so that its voltage jumps when it comes and falls as the
joint follows. A bus reads it once a frame, always at the same moment after a jump: the line through the readings is not
the mean over the frame. Both differ by the gain times the change of the reference in up to half a frame, of either
sign, and the readings are the same whenever the reference arrives. Only the motion can say.
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

# Moments of a frame at which a voltage is asked for.
_FINE = 16
# When references may arrive, of a frame from its middle.
_PARTS = (-0.5, -0.25, 0.0, 0.25, 0.5)


@dataclass(frozen=True)
class BetweenReadings:
    """What drives do between two readings of their voltage that are a frame apart, shape ``(N, nv)`` [N m or N].

    Attributes:
        torque: Mean over the frame about each reading less the line through the readings, where references arrive in
            the middle of a frame; zero but where a drive drops its voltage.
        arrival: Change of that mean with references that arrive a frame later.
        doubt: Standard deviation of what is not in proportion to that: whether a drive drops its voltage in this frame
            or the next. It has the sign of the change, so that filters make of it what they make of the torque.
    """

    torque: Float[Array, "N nv"]
    arrival: Float[Array, "N nv"]
    doubt: Float[Array, "N nv"]


def between_readings(recording: Recording, robot: Robot, t: Float[Array, " N"], held: bool) -> BetweenReadings | None:
    """What readings of voltages leave out; None where there is no such reading or references act at once.

    Args:
        recording: With the loops that were read from its voltages.
        robot: Gives the constants of the drives.
        t: Uniform times [s].
        held: True if a reference acts from its sample to the next.
    """
    if not held or recording.q_ref is None or not recording.loops:
        return None
    torque, arrival, doubt = np.zeros((3, len(t), robot.nv))
    for j, (joint, loop) in enumerate(zip(robot.joint_names, recording.loops, strict=True)):
        if loop is None or loop.computed or recording.torque_from.get(joint) != "u":
            continue
        warm = 1.0 if recording.temperature is None else copper_share(recording.temperature[:, j])
        own = per_volt(robot.actuators[j]) * np.interp(t, recording.t, np.broadcast_to(warm, recording.t.shape))
        means = np.array([_mean_voltage(loop, recording, t, j, part) for part in _PARTS])
        arrival[:, j] = own * (means[-1] - means[0])
        if loop.dropped:
            line = np.convolve(_read_voltage(loop, recording, t, j), [0.125, 0.75, 0.125], "same")
            middle = means[len(_PARTS) // 2]
            bent = means - middle - np.outer(_PARTS, means[-1] - means[0])
            largest = np.argmax(np.abs(bent), axis=0)
            sign = np.sign(bent[largest, np.arange(len(t))])
            torque[1:-1, j] = (own * (middle - line))[1:-1]
            doubt[1:-1, j] = (own * sign * np.sqrt(np.mean(bent**2, axis=0)))[1:-1]
    return BetweenReadings(torque, arrival, doubt) if arrival.any() else None


def _read_voltage(loop: DriveLoop, recording: Recording, t: Float[Array, " N"], j: int) -> Float[Array, " N"]:
    """Voltage of a loop when it is read."""
    assert recording.q_ref is not None
    reference = np.interp(t - loop.delay, recording.t, recording.q_ref[:, j])
    return loop.put_out(reference - np.interp(t, recording.t, recording.q[:, j]))


def _mean_voltage(
    loop: DriveLoop, recording: Recording, t: Float[Array, " N"], j: int, part: float
) -> Float[Array, " N"]:
    """Voltage of a loop along the recorded motion, mean over the frame about each time.

    Args:
        loop: The loop.
        recording: Gives references and motion.
        t: Uniform times [s], a frame apart.
        j: The joint.
        part: Of a frame by which references arrive later than half a frame before they are read.
    """
    assert recording.q_ref is not None
    frame = float((t[-1] - t[0]) / max(len(t) - 1, 1))
    out = np.zeros(len(t))
    for k in range(_FINE):
        then = t + frame * ((k + 0.5) / _FINE - 0.5)
        sent = np.searchsorted(recording.t, then - loop.delay - (part - 0.5) * frame + 1e-9, side="right") - 1
        reference = recording.q_ref[np.clip(sent, 0, None), j]
        out += loop.put_out(reference - np.interp(then, recording.t, recording.q[:, j])) / _FINE
    return out


def arrival_notes(robot: Robot, recordings: tuple[Recording, ...]) -> tuple[Note, ...]:
    """A note on each joint whose references arrive at a moment that is left open, with the friction that is as much.

    Another one where its drive protects itself.

    Args:
        robot: Names these joints.
        recordings: With their loops.
    """
    out = []
    for joint in robot.open_arrivals:
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
    numbers = {"file": recording.file, "beyond": loop.drops_beyond, "most": loop.drops_to, "share": loop.dropped}
    return Note(Code.DRIVE_DROPS, robot.joint_names[j], {**numbers, "unit": "m" if robot.prismatic[j] else "rad"})


def with_open_arrivals(robot: Robot, logs: tuple[Log, ...]) -> Robot:
    """The robot with the joints whose references arrive at a moment of a frame that the logs leave open.

    Args:
        robot: The given model.
        logs: Of all recordings.
    """
    left_open = [log.arrival.any(axis=0) for log in logs if log.arrival is not None]
    if not left_open:
        return robot
    joints = zip(robot.joint_names, np.any(left_open, axis=0), strict=True)
    return replace(robot, open_arrivals=tuple(joint for joint, own in joints if own))
