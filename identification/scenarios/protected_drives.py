"""Detects drives that protect themselves: beyond a certain position error they reduce their output.

If the torque was computed from references, no output of the drive was recorded, and the modelled torque along the
motion is used instead. As a function of the position error, it shows the gain and delay of the control loop, and the
error beyond which the drive reduces its output. A wrong mass in the model changes the gain, but not this error.
"""

from __future__ import annotations

import numpy as np

from identification.data.drive_loop import DriveLoop, drive_loop
from identification.data.drives.joint_torque import voltage_bound
from identification.data.log import Log
from identification.data.recording import Recording
from identification.diagnosis.columns.operations import operation_of
from identification.diagnosis.columns.session import Session
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot


def protection_notes(session: Session) -> tuple[Note, ...]:
    """A note for each joint and recording in which a drive protects itself, unless robot.yaml states it.

    Args:
        session: Robot, logs and recordings.
    """
    out = []
    for k, (log, recording) in enumerate(zip(session.logs, session.recordings, strict=False)):
        if log.references is None or log.q_ref is None:
            continue
        needed = operation_of(session.robot, log, session.known, k, session.cutoff_hz).tau
        for j, joint in enumerate(session.robot.joint_names):
            controller = session.robot.actuators[j].controller
            stated = recording.controlled and controller is not None and np.isfinite(controller.drops_beyond)
            loop = None if stated else needed_loop(log, recording, needed, j)
            if loop is not None and loop.dropped:
                out.append(_note(session.robot, recording, j, joint, loop))
    return tuple(out)


def needed_loop(log: Log, recording: Recording, needed: Float[Array, "N nv"], j: int) -> DriveLoop | None:
    """The control loop from a joint's position error to its torque, estimated from the modelled torque.

    Args:
        log: Motion and references.
        recording: The recording, with the dependence of its torque on speed.
        needed: Modelled torque along the motion [N m or N], shape ``(N, nv)``.
        j: Index of the joint.
    """
    references = log.references
    if references is None or log.q_ref is None or not references.gain[j]:
        return None
    # The output of the position loop is the torque plus the part that the drive subtracts in proportion to speed.
    slowing = 0.0 if recording.velocity_gain is None else recording.velocity_gain[j] * log.motion.v[:, j]
    q = log.motion.q if log.raw_q is None else log.raw_q
    return drive_loop("tau", log.motion.t, needed[:, j] + slowing, log.q_ref[:, j], q[:, j])


def _note(robot: Robot, recording: Recording, j: int, joint: str, loop: DriveLoop) -> Note:
    most = voltage_bound(robot.actuators[j])
    numbers = {
        "file": recording.file,
        "beyond": loop.drops_beyond,
        "most": loop.drops_to,
        "asked": loop.gain * loop.drops_beyond,
        "share": loop.dropped,
        "of_supply": loop.drops_to / most if np.isfinite(most) else None,
        "units": ("m", "N") if robot.prismatic[j] else ("rad", "N m"),
    }
    return Note(Code.DRIVE_PROTECTED, joint, numbers)
