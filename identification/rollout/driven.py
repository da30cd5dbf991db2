"""Simulation of a model under a recorded torque, through its drives, free or pulled along the recording."""

from __future__ import annotations

import numpy as np

from identification.data.floating.base_errors import base_without_errors
from identification.data.log import Log
from identification.diagnosis.columns.motion.soft_friction import softness
from identification.rollout.rollout_starts import Start
from identification.rollout.simulated_models import Model
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion
from phantom_dyn.simulation.control import Tracking
from phantom_dyn.simulation.simulate import Cause, Given, Simulation, simulate

SHORTEST = 2e-5  # shortest step [s]: with shorter ones a rollout would take too long
STEP = 1e-3  # longest step [s]: the midpoint rule follows a 20 Hz motion with a phase error of 0.2 %
# Natural frequency [rad/s] of the critically damped feedback that keeps a model with hidden states on the recording.
_PULL = 2.0 * np.pi * 15.0
# The same for a motor behind a spring or backlash: higher, as its inertia alone is small.
_MOTOR_PULL = 2.0 * np.pi * 60.0


def given_torque(model: Model, t: Float[Array, " N"], tau: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Torque [N m or N] of the drives when ``tau`` is commanded at uniform times.

    Args:
        model: The model, with the effects of its drives and the timing of the log.
        t: Times [s].
        tau: Recorded torque.
    """
    out = np.array(tau, dtype=float)
    if model.late:
        dt = (t[-1] - t[0]) / (len(t) - 1)
        out = np.column_stack([np.interp(t - model.late * dt, t, column) for column in out.T])
    for drive in model.drives:
        out = drive.given(t, out)
    return out


def acting_torque(model: Model, log: Log) -> Float[Array, "N nv"]:
    """Torque [N m or N] of a model's drives over a recording, plus that of measured external forces."""
    tau = log.tau
    if model.late_references is not None and log.references is not None:
        rows = [log.references.later(float(delay), (row,)) for row, delay in enumerate(model.late_references)]
        tau = tau + np.hstack(rows)
    if model.arrivals:
        tau = tau + log.later_references(model.arrivals)
    out = given_torque(model, log.motion.t, tau) + (0.0 if log.external is None else log.external)
    for joint, share in model.soft:
        out -= share * softness(model.robot, log.motion, joint)
    return out


def base_of(model: Model, log: Log, rows: slice) -> BaseMotion | None:
    """Motion of a model's base over some samples; None for a fixed base."""
    return base_without_errors(model.robot, log, rows, model.base)


def simulated(
    robot: Robot,
    causes: tuple[Cause, ...],
    law: Tracking,
    start: Start,
    base: BaseMotion | None = None,
    *,
    max_step: float = STEP,
) -> Simulation:
    """A simulation from a start, at the times of its law.

    Args:
        robot: The robot.
        causes: Effects beside its rigid-body model.
        law: Torque of its drives.
        start: State of links and motors.
        base: Motion of the base; None for a fixed one.
        max_step: Longest step [s].

    Raises:
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    given = Given((start.motor_q, start.motor_v), base)
    return simulate(robot, causes, law, law.t, start.q, start.v, max_step=max_step, given=given)


def moved(model: Model, law: Tracking, start: Start, base: BaseMotion | None) -> Simulation:
    """A simulation of a model in which the law gives the torque that the drives exert."""
    return simulated(model.moving, model.causes, law, start, base)


def pull(model: Model, q: Float[Array, " nv"]) -> Float[Array, "2 nv"]:
    """Gains of position and velocity of the feedback that keeps readings on the recording.

    They are zero where the encoder is on the link behind a spring or backlash: feedback through the motor is unstable.
    """
    inertia = np.diag(mass_matrix(model.robot, q[None])[0]).copy()
    speed = np.full(model.robot.nv, _PULL)
    for part in model.transmissions:
        row = row_of(model.robot, part.joint)
        on_motor = model.robot.actuators[row].encoder_side == "motor"
        inertia[row], speed[row] = model.robot.rotor_inertia[row], _MOTOR_PULL if on_motor else 0.0
    return np.array([speed**2 * inertia, 2.0 * speed * inertia])


def pulling(
    t: Float[Array, " n"],
    torque: Float[Array, "n nv"],
    q: Float[Array, "n nv"],
    v: Float[Array, "n nv"],
    gains: Float[Array, "2 nv"],
    where: Bool[Array, "n nv"],
) -> Tracking:
    """The recorded torque, with feedback towards ``q`` and ``v`` at some samples of each joint."""
    tables = gains[:, None] * where
    return Tracking(t, torque, q, v, tables[0], tables[1], np.zeros_like(q), np.full(q.shape[1], np.inf))
