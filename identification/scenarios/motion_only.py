"""Computes the torque that position controllers command, for recordings without a torque.

The torque follows from references, positions and gains. `identification.scenarios.gains` estimates gains that the robot
does not state.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.drives.joint_torque import voltage_bound
from identification.data.recording import Recording
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Actuator, Controller, Robot

_LEAST_ROWS = 20


def states_controllers(robot: Robot) -> bool:
    """True if every driven joint has a stated controller, and at least one joint is driven."""
    driven = [actuator for actuator in robot.actuators if actuator.actuated]
    return bool(driven) and all(actuator.controller is not None for actuator in driven)


def with_controller_torque(recording: Recording, robot: Robot) -> Recording:
    """The recording unchanged if it has a torque, else with the torque that the controllers command.

    Args:
        recording: A recording, with references if it has no torque.
        robot: The robot with its controllers.

    Raises:
        LogError: If there is neither a torque nor a reference for every driven joint, or the controllers' torque is
            zero throughout.
    """
    if recording.tau is not None:
        return recording
    if recording.q_ref is None:
        raise LogError(
            f"{recording.file} has neither torque nor references: add tau.<joint>, or q_ref.<joint> of every joint, as "
            "its controllers are known."
        )
    torque = controller_torque(recording, robot)
    if not np.any(torque):
        raise LogError(
            f"{recording.file}: its controllers ask for no torque at all: check their gains, and that q_ref is not q."
        )
    note = Note(Code.TORQUE_ASKED, numbers={"file": recording.file})
    return _with_controller_gains(replace(recording, tau=read_only(torque), notes=(*recording.notes, note)), robot)


def _with_controller_gains(recording: Recording, robot: Robot) -> Recording:
    """The recording with the gains of its controllers' torque on reference and velocity, and the limits of this torque.

    Where velocities were recorded, the torque contains no finite difference, so no velocity gain is needed.
    """
    controllers = [Controller() if a.controller is None or not a.actuated else a.controller for a in robot.actuators]
    supply_ratio = np.array([float(np.mean(_supply_ratio(recording, actuator))) for actuator in robot.actuators])
    limits = np.array([_position_torque_limit(actuator) for actuator in robot.actuators]) * supply_ratio
    # The torque of a controller with a delay depends on an earlier velocity, so it has no gain for the present one.
    undelayed = np.array([controller.delay == 0 for controller in controllers])
    velocity_gain = np.array([controller.kd for controller in controllers]) * undelayed if recording.v is None else None
    reference_gain = np.array([controller.kp for controller in controllers]) * supply_ratio
    return replace(
        recording,
        controlled=True,
        velocity_gain=None if velocity_gain is None else read_only(velocity_gain),
        reference_gain=read_only(reference_gain),
        reference_torque_limit=read_only(limits),
    )


def _position_torque_limit(actuator: Actuator) -> float:
    """Limit of the torque that a position error commands: by voltage or controller, else the drive's torque limit."""
    limit = voltage_bound(actuator)
    if actuator.controller is not None:
        limit = min(limit, actuator.controller.limit)
    return limit if np.isfinite(limit) or actuator.torque_limit is None else actuator.torque_limit


def controller_torque(recording: Recording, robot: Robot) -> Float[Array, "N nv"]:
    """Torque ``kp (q_ref - q) - kd v`` of delayed controllers before the drives' torque limits; zero without a drive.

    The part by ``kp`` is limited as the controller states, and by the drive's largest voltage if it is known.
    Velocities that were not recorded are differentiated positions; the low pass of the torque removes their noise
    later.
    """
    assert recording.q_ref is not None
    t = recording.t
    v = np.gradient(recording.q, t, axis=0) if recording.v is None else recording.v
    out = np.zeros_like(recording.q)
    for k, actuator in enumerate(robot.actuators):
        controller = actuator.controller
        if controller is None or not actuator.actuated:
            continue
        limit, delay = voltage_bound(actuator), controller.reference_delay
        reference = np.interp(t - delay, t, recording.q_ref[:, k]) if delay else recording.q_ref[:, k]
        command = np.clip(controller.stiff_part(reference - recording.q[:, k]), -limit, limit)
        command = _supply_ratio(recording, actuator) * command
        command = command - controller.kd * v[:, k]
        out[:, k] = command if controller.delay == 0 else np.interp(t - controller.delay, t, command)
    return out


def _supply_ratio(recording: Recording, actuator: Actuator) -> Float[Array, " N"] | float:
    """Ratio of measured to stated supply voltage for a drive whose output is a duty cycle; 1 for other drives."""
    duty = actuator.controller is not None and actuator.controller.kind == "duty"
    if not duty or recording.supply is None or actuator.voltage_limit is None:
        return 1.0
    return recording.supply / actuator.voltage_limit


def gains_of_file(robot: Robot) -> dict[str, tuple[float, float, float]]:
    """Gains kp and kd, and lag of the references, of the joints for which the robot's file states them."""
    return {
        joint: (a.controller.kp, a.controller.kd, a.reference_lag)
        for joint, a in zip(robot.joint_names, robot.actuators, strict=True)
        if joint in robot.gains_of_file and a.controller
    }


def commanded_robot(robot: Robot) -> Robot:
    """The robot with ``command`` as the source of its torque, for recordings without a measured torque."""
    return replace(robot, torque_source="command")


def with_commanded_torque(recording: Recording, robot: Robot) -> Recording:
    """The recording with the torque ``kp (q_ref - q) - kd v`` of its controllers, delayed and limited as stated.

    Args:
        recording: A recording with references, or with voltages that give a torque.
        robot: The robot with its controllers.

    Raises:
        LogError: If a controller, its gain or the references are missing, and no voltage gives the torque.
    """
    without_gain = [
        joint
        for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
        if actuator.actuated and (actuator.controller is None or actuator.controller.kp <= 0)
    ]
    if recording.q_ref is not None and not without_gain:
        numbers = {"file": recording.file, "has_torque": recording.tau is not None, "gains": gains_of_file(robot)}
        tau = limited_controller_torque(recording, robot)
        note = Note(Code.MOTION_ONLY, numbers=numbers)
        return _with_controller_gains(replace(recording, tau=tau, unread=(), notes=(*recording.notes, note)), robot)
    if recording.voltage is not None and recording.tau is not None:
        return recording
    if recording.q_ref is None:
        raise LogError(
            f"{recording.file} has no q_ref.<joint> of every joint: --motion-only needs the references of the position "
            "controllers, or motor voltages u.<joint> with resistance and torque_constant in robot.yaml."
        )
    raise LogError(
        f"{recording.file}: robot.yaml states no controller with a gain kp of {', '.join(without_gain)}: --motion-only "
        "needs it to know the torque, as positions alone do not separate a gain from the inertia that it moves. Add "
        "controller: {kind: pd, kp: ..., kd: ..., delay: ...} under joints, in N m/rad and N m s/rad at the joint. "
        "Without a gain, only joints that rest under loads of either sign (weight or f. columns), with encoder_side: "
        "link, can be judged."
    )


def limited_controller_torque(recording: Recording, robot: Robot) -> Float[Array, "N nv"]:
    """Torque [N m or N] of the stated controllers (see `controller_torque`) within the drives' limits; read-only.

    Args:
        recording: A recording with references.
        robot: The robot with its controllers.

    Raises:
        LogError: If the recording is too short, or a reference is not finite, or the torque is zero throughout.
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
    torque = np.clip(controller_torque(recording, robot), -limits, limits)
    if not np.any(torque):
        raise LogError(f"{recording.file}: its controllers ask for no torque at all: check that q_ref is not q.")
    return read_only(torque)
