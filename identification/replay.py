"""A recording played again by drives that clip: the only fault under which the motion cannot be the recorded one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from phantom_dyn.dynamics import inverse_dynamics, mass_matrix
from phantom_dyn.effects.torque_saturation import held_within
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot
from phantom_dyn.simulation import simulate

Array = np.ndarray

# How fast a position controller takes out an error, where robot.yaml states none [rad/s]; critically damped.
_BANDWIDTH = 2.0 * np.pi * 4.0
# Steps [s] of the midpoint rule: at 10 Hz it has the phase right to 0.2 %.
_LONGEST_STEP = 2e-3


def replayed(
    robot: Robot, motion: Motion, needed: Float[Array, "N nv"], limits: Float[Array, " nv"]
) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Positions, velocities, and the torque that was asked for, when drives give no more than ``limits``.

    The controller asks for the torque that the recorded motion needs, and for what its gains make of the error to that
    motion: those of ``robot.yaml``, or 4 Hz with critical damping. What the recording needs beyond the model acts on
    the robot at the same times as it did.

    Args:
        robot: The model.
        motion: As recorded.
        needed: Drive torque of the recorded motion [N m or N].
        limits: Of the drives; infinite where they have none.

    Raises:
        ParameterError: If the robot falls out of the motion altogether.
    """
    rest = needed - inverse_dynamics(robot, motion)
    kp, kd = _gains(robot, motion)
    start, step, last = float(motion.t[0]), float(np.mean(np.diff(motion.t))), len(motion.t) - 2

    def at(t: float, *tables: Array) -> list[Array]:
        place = (t - start) / step
        k = min(max(int(place), 0), last)
        share = place - k
        return [(1.0 - share) * table[k] + share * table[k + 1] for table in tables]

    def controller(t: float, q: Array, v: Array) -> Array:
        wanted, extra, q_ref, v_ref, stiff, damped = at(t, needed, rest, motion.q, motion.v, kp, kd)
        return held_within(wanted + stiff * (q_ref - q) + damped * (v_ref - v), limits) - extra

    instant = replace(robot, torque_hold="instant", torque_source="command")
    try:
        moved = simulate(instant, (), controller, motion.t, motion.q[0], motion.v[0], max_step=_LONGEST_STEP).encoders
    except ParameterError as error:
        said = ", ".join(f"{limit:g}" for limit in limits)
        raise ParameterError(
            f"With torque limits of {said} the robot does not follow the recorded motion at all: give higher ones."
        ) from error
    asked = needed + kp * (motion.q - moved.q) + kd * (motion.v - moved.v)
    return moved.q, moved.v, asked


def _gains(robot: Robot, motion: Motion) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Gains of the position controllers at every sample."""
    inertia = np.einsum("njj->nj", mass_matrix(robot, motion.q))
    kp, kd = _BANDWIDTH**2 * inertia, 2.0 * _BANDWIDTH * inertia
    for k, actuator in enumerate(robot.actuators):
        if actuator.controller is not None:
            kp[:, k], kd[:, k] = actuator.controller.kp, actuator.controller.kd
    return kp, kd
