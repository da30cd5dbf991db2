"""What a voltage that is read once a frame leaves open: when within the frame the next reference arrives in the drive.

A drive follows a held reference until the next one comes, so that its voltage jumps when it comes and falls as the
joint follows. A bus reads it once a frame, always at the same moment after a jump: the line through the readings is not
the mean over the frame. Both differ by the gain times the change of the reference in up to half a frame, of either
sign, and the readings are the same whenever the reference arrives. Only the motion can say.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.drive_loop import DriveLoop
from identification.data.joint_torque import copper_share, per_volt
from identification.data.log import Log
from identification.data.recording import Recording
from identification.notes import Code, Note
from phantom_dyn.array_types import Float
from phantom_dyn.model.robot import Robot

Array = np.ndarray


def torque_of_arrival(
    recording: Recording, robot: Robot, t: Float[Array, " N"], held: bool
) -> Float[Array, "N nv"] | None:
    """Torque more [N m or N] with references that arrive one sample later; None where that is known or no matter.

    Args:
        recording: With the loops that were read from its voltages.
        robot: Gives the constants of the drives.
        t: Uniform times [s].
        held: True if a reference acts from its sample to the next.
    """
    if not held or recording.q_ref is None or not recording.loops:
        return None
    step = float((t[-1] - t[0]) / max(len(t) - 1, 1))
    out = np.zeros((len(t), robot.nv))
    for j, (joint, loop) in enumerate(zip(robot.joint_names, recording.loops, strict=True)):
        if loop is None or loop.computed or recording.torque_from.get(joint) != "u":
            continue
        late, early = (_voltage(loop, recording, t, j, loop.delay + side * step) for side in (0.5, -0.5))
        warm = 1.0 if recording.temperature is None else copper_share(recording.temperature[:, j])
        share = np.interp(t, recording.t, np.broadcast_to(warm, recording.t.shape))
        out[:, j] = share * per_volt(robot.actuators[j]) * (late - early)
    return out if out.any() else None


def _voltage(loop: DriveLoop, recording: Recording, t: Array, j: int, delay: float) -> Float[Array, " N"]:
    """Voltage of a loop along the recorded motion with references that are late."""
    assert recording.q_ref is not None
    reference = np.interp(t - delay, recording.t, recording.q_ref[:, j])
    asked = loop.gain * (reference - np.interp(t, recording.t, recording.q[:, j]))
    return asked if loop.limit is None else np.clip(asked, -loop.limit, loop.limit)


def arrival_notes(robot: Robot, recordings: tuple[Recording, ...]) -> tuple[Note, ...]:
    """A note on each joint whose references arrive at a moment that is left open, with the friction that is as much.

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
    return tuple(out)


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
