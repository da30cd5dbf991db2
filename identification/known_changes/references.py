"""The torque that known controllers asked for, where a recording has their references and no torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identification.recordings import Recording
from phantom_dyn.errors import LogError
from phantom_dyn.motion import read_only
from phantom_dyn.robot import Robot

Array = np.ndarray


def states_controllers(robot: Robot) -> bool:
    """True if every driven joint has a controller, and one at least is driven."""
    driven = [actuator for actuator in robot.actuators if actuator.actuated]
    return bool(driven) and all(actuator.controller is not None for actuator in driven)


def with_asked_torque(recording: Recording, robot: Robot) -> Recording:
    """The recording as it is if it has a torque, else with the torque that the controllers asked for.

    Velocities are the recorded ones, else differences of positions: the noise that this leaves is taken off with the
    band of the torque, which filters both alike.

    Args:
        recording: With references if it has no torque.
        robot: States the controllers in force.

    Raises:
        LogError: If there is neither torque nor a reference of every driven joint, or the references never move the
            torque.
    """
    if recording.tau is not None:
        return recording
    if recording.q_ref is None:
        raise LogError(
            f"{recording.file} has neither torque nor references: add tau.<joint>, or q_ref.<joint> of every joint, as "
            "its controllers are known."
        )
    torque = asked_torque(recording, robot)
    if not np.any(torque):
        raise LogError(
            f"{recording.file}: its controllers ask for no torque at all: check their gains, and that q_ref is not q."
        )
    words = f"{recording.file}: without torque columns, the torque is what its controllers asked for."
    return replace(recording, tau=read_only(torque), controlled=True, warnings=(*recording.warnings, words))


def asked_torque(recording: Recording, robot: Robot) -> Float[Array, "N nv"]:
    """``kp (q_ref - q) - kd v``, late by the controller's own delay; zeros for joints without a drive."""
    assert recording.q_ref is not None
    t = recording.t
    v = np.gradient(recording.q, t, axis=0) if recording.v is None else recording.v
    out = np.zeros_like(recording.q)
    for k, actuator in enumerate(robot.actuators):
        controller = actuator.controller
        if controller is None or not actuator.actuated:
            continue
        asked = controller.kp * (recording.q_ref[:, k] - recording.q[:, k]) - controller.kd * v[:, k]
        out[:, k] = asked if controller.delay == 0 else np.interp(t - controller.delay, t, asked)
    return out
