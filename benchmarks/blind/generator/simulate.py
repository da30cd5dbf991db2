# pyright: reportAttributeAccessIssue=false
"""Moves a plant along a reference with a sampled position controller and keeps the truth beside what is logged."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.blind.generator.plant import INNER_STEP, JointFriction, Plant, compiled, mass_matrix, rigid_torque
from benchmarks.blind.generator.robots import Table


@dataclass(frozen=True)
class Session:
    """Everything about a recording except the machine: equal for a run and for its pair without the effect.

    Attributes:
        rate: Of control and log [Hz].
        reference: ``(N, nv)`` [rad].
        disturbance: Drive torque that the log does not hold, one value per hold, ``(N, nv)`` [N m].
        encoder_counts: Per revolution of the joint; 0 for an ideal encoder.
        dither: Noise of the encoder before rounding, ``(N, nv)`` [rad].
        bandwidth: Of the controller [Hz].
    """

    rate: float
    reference: np.ndarray
    disturbance: np.ndarray
    encoder_counts: int
    dither: np.ndarray
    bandwidth: float


@dataclass(frozen=True)
class Run:
    """One recording: what the log holds (`measured`, `command`) and the truth (`q`, `v`, one sample longer).

    Attributes:
        t: ``(N,)`` [s].
        measured: Encoder readings, ``(N, nv)`` [rad].
        command: Torque held from sample k to k + 1, ``(N, nv)`` [N m].
        q: True positions, ``(N + 1, nv)``.
        v: True velocities, ``(N + 1, nv)``.
    """

    t: np.ndarray
    measured: np.ndarray
    command: np.ndarray
    q: np.ndarray
    v: np.ndarray


def feedforward(model: Table, reference: np.ndarray, rate: float) -> np.ndarray:
    """Torque that the owner's model asks for along the reference, friction included, ``(N, nv)`` [N m]."""
    v = np.gradient(reference, 1.0 / rate, axis=0)
    a = np.gradient(v, 1.0 / rate, axis=0)
    viscous, coulomb = (np.array([getattr(link, name) for link in model.links]) for name in ("viscous", "coulomb"))
    return rigid_torque(model, reference, v, a) + viscous * v + coulomb * np.tanh(v / 0.02)


def _moves_with_speed(friction: JointFriction) -> bool:
    return friction.extra != 0.0 or friction.c_positive != friction.c_negative


def _set_friction(model: mujoco.MjModel, plant: Plant, v: np.ndarray) -> None:
    """Friction level and viscous coefficient of the joints whose law changes with speed."""
    for j, law in enumerate(plant.friction):
        if _moves_with_speed(law):
            link = plant.table.links[j]
            level = 0.5 * (law.positive + law.negative) + law.extra * np.exp(-((v[j] / law.speed) ** 2))
            model.dof_frictionloss[j] = link.coulomb + level
            model.dof_damping[j] = link.viscous + (law.c_positive if v[j] > 0 else law.c_negative)


def simulate(plant: Plant, owner: Table, session: Session) -> Run:
    """The machine under feedforward of the owner's model and a sampled PD controller on the encoder."""
    n, nv = session.reference.shape
    dt = 1.0 / session.rate
    inner = round(dt / INNER_STEP)
    model = compiled(plant)
    data = mujoco.MjData(model)
    data.qpos[:] = session.reference[0]
    ahead = feedforward(owner, session.reference, session.rate)
    speed = np.gradient(session.reference, dt, axis=0)
    omega = 2.0 * np.pi * session.bandwidth
    inertia = np.diag(mass_matrix(owner, session.reference[:: max(1, n // 50)]))
    kp, kd = inertia * omega**2, inertia * 1.6 * omega
    # Constant parts: offset, and half the difference of the two directions (MuJoCo's Coulomb level is symmetric).
    lean = np.array(plant.offset) - np.array([0.5 * (f.positive - f.negative) for f in plant.friction])
    ratio, varies = np.array(plant.ratio), any(_moves_with_speed(f) for f in plant.friction)
    quantum = 2.0 * np.pi / session.encoder_counts if session.encoder_counts else 0.0
    keep = np.exp(-2.0 * np.pi * 40.0 * dt)
    measured, command = np.empty((n, nv)), np.empty((n, nv))
    q, v = np.empty((n + 1, nv)), np.empty((n + 1, nv))
    estimate, last = np.zeros(nv), None
    for k in range(n):
        q[k], v[k] = data.qpos, data.qvel
        reading = q[k] + session.dither[k]
        if quantum:
            reading = np.round(reading / quantum) * quantum
        if last is not None:
            estimate = keep * estimate + (1.0 - keep) * (reading - last) / dt
        last = measured[k] = reading
        command[k] = ahead[k] + kp * (session.reference[k] - reading) + kd * (speed[k] - estimate)
        data.qfrc_applied[:] = ratio * command[k] + session.disturbance[k] + lean
        if varies:
            for _ in range(inner):
                _set_friction(model, plant, data.qvel)
                mujoco.mj_step(model, data)
        else:
            mujoco.mj_step(model, data, inner)
    q[n], v[n] = data.qpos, data.qvel
    return Run(np.arange(n) * dt, measured, command, q, v)


def midpoint_motion(run: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True q, v, a at the middle of every hold, each ``(N, nv)``; a is the mean over the hold."""
    dt = run.t[1] - run.t[0]
    q = 0.5 * (run.q[1:] + run.q[:-1]) - 0.125 * dt * (run.v[1:] - run.v[:-1])
    return q, 0.5 * (run.v[1:] + run.v[:-1]), (run.v[1:] - run.v[:-1]) / dt
