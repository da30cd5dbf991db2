"""The torque that stated position controllers ask for along a recorded motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identification.known_changes.references import asked_torque
from identification.motion_only.gains import suggested_gains
from identification.recordings import Recording
from phantom_dyn.errors import LogError, PhantomDynError
from phantom_dyn.motion import read_only
from phantom_dyn.robot import Robot

Array = np.ndarray

_LEAST_ROWS = 20


def motion_robot(robot: Robot) -> Robot:
    """The robot whose torque is a command, whatever was said of torque columns: there are none."""
    return replace(robot, torque_source="command")


def with_commanded_torque(recording: Recording, robot: Robot) -> Recording:
    """The recording with the torque ``kp (q_ref - q) - kd v`` of its controllers, late and limited as stated.

    Args:
        recording: With references, or with voltages that give a torque.
        robot: States the controllers.

    Raises:
        LogError: If a controller, its gain or the references are missing, and no voltage gives the torque.
    """
    lacking = [
        joint
        for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
        if actuator.actuated and (actuator.controller is None or actuator.controller.kp <= 0)
    ]
    if recording.q_ref is not None and not lacking:
        used = " The torque of the log is not used." if recording.tau is not None else ""
        sentence = (
            f"{recording.file}: the torque is what the controllers of robot.yaml ask for at the recorded motion: "
            f"findings are as good as these gains.{used}"
        )
        tau = commanded_torque(recording, robot)
        return replace(recording, tau=tau, controlled=True, warnings=(*recording.warnings, sentence))
    if recording.voltage is not None and recording.tau is not None:
        return recording
    if recording.q_ref is None:
        raise LogError(
            f"{recording.file} has no q_ref.<joint> of every joint: --motion-only needs the references of the position "
            "controllers, or motor voltages u.<joint> with resistance and torque_constant in robot.yaml."
        )
    raise LogError(
        f"{recording.file}: robot.yaml states no controller with a gain kp of {', '.join(lacking)}: --motion-only "
        "needs it to know the torque, as positions alone do not tell a gain from the inertia that it moves. Add "
        "controller: {kind: pd, kp: ..., kd: ..., delay: ...} under joints, in N m/rad and N m s/rad at the "
        f"joint.{_guess(recording, robot, lacking)} "
        "Without a gain, only joints that rest under loads of either sign (weight or f. columns), with encoder_side: "
        "link, can be judged."
    )


def _guess(recording: Recording, robot: Robot, lacking: list[str]) -> str:
    """Gains that go with the masses of the model, for who trusts these; nothing where the motion tells none."""
    try:
        kp, kd = suggested_gains(recording, robot)
    except PhantomDynError:
        return ""
    words = ", ".join(
        f"kp {kp[j]:.3g} and kd {kd[j]:.2g} of {joint}"
        for j, joint in enumerate(robot.joint_names)
        if joint in lacking and np.isfinite(kp[j])
    )
    return f" If its masses are right, the model says {words}." if words else ""


def commanded_torque(recording: Recording, robot: Robot) -> Float[Array, "N nv"]:
    """Torque [N m or N] that the stated controllers ask for, zero without a drive; read-only.

    Args:
        recording: With references.
        robot: States the controllers.

    Raises:
        LogError: If the recording is too short, or a reference is not finite, or no torque is asked for.
    """
    q_ref, rows = recording.q_ref, len(recording.t)
    if q_ref is None or rows < _LEAST_ROWS:
        raise LogError(f"{recording.file} has {rows} rows: record at least ten seconds of motion with references.")
    if not np.isfinite(q_ref).all():
        row, joint = np.argwhere(~np.isfinite(q_ref))[0]
        raise LogError(
            f"{recording.file}: q_ref.{recording.joint_names[joint]} is {q_ref[row, joint]} in row {row}: give a "
            "reference for every sample."
        )
    limits = np.array([np.inf if a.torque_limit is None else a.torque_limit for a in robot.actuators])
    torque = np.clip(asked_torque(recording, robot), -limits, limits)
    if not np.any(torque):
        raise LogError(f"{recording.file}: its controllers ask for no torque at all: check that q_ref is not q.")
    return read_only(torque)
