# pyright: reportAttributeAccessIssue=false
"""Moves a plant along a reference with a sampled position controller and keeps the truth beside what is logged."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from .channel import Drive
from .inverse import mass_matrix, rigid_torque
from .laws import laws_of
from .plant import INNER_STEP, Channel, Encoder, Plant, compiled
from .robots import Table

LAW_STEP = 2  # inner steps between two evaluations of a law
RUNAWAY = 300.0  # [rad/s]: an unstable loop, stopped before the engine complains


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
    """One recording: what the log holds (`measured`, `command`), and what encoders without noise would have read.

    Attributes:
        t: ``(N,)`` [s].
        measured: Encoder readings, ``(N, nv)`` [rad].
        command: Torque held from sample k to k + 1, ``(N, nv)`` [N m].
        seen: Readings without noise and without the stated quantum, ``(N, nv)``.
        q: True positions of what the encoders sit on, ``(N, nv)``.
    """

    t: np.ndarray
    measured: np.ndarray
    command: np.ndarray
    seen: np.ndarray
    q: np.ndarray


def feedforward(model: Table, reference: np.ndarray, rate: float) -> np.ndarray:
    """Torque that the owner's model asks for along the reference, friction included, ``(N, nv)`` [N m]."""
    v = np.gradient(reference, 1.0 / rate, axis=0)
    a = np.gradient(v, 1.0 / rate, axis=0)
    viscous, coulomb = (np.array([getattr(link, name) for link in model.driven]) for name in ("viscous", "coulomb"))
    return rigid_torque(model, reference, v, a) + viscous * v + coulomb * np.tanh(v / 0.02)


def _readings(plant: Plant, q: np.ndarray) -> np.ndarray:
    """What encoders without noise read at true positions ``(nv,)``."""
    out = q.copy()
    for i, e in plant.encoders.items():
        j = plant.table.active.index(i)
        out[j] += e.offset + e.amplitude * np.sin(e.order * q[j] + e.phase)
        if e.step:
            out[j] = np.round(out[j] / e.step) * e.step
    return out


def _start(plant: Plant, reading: np.ndarray) -> np.ndarray:
    """MuJoCo's positions, all at rest, for which the encoders read ``reading``; eccentricity by fixed-point steps."""
    place = reading.copy()
    for i, e in plant.encoders.items():
        j = plant.table.active.index(i)
        for _ in range(30):
            place[j] = reading[j] - e.offset - e.amplitude * np.sin(e.order * place[j] + e.phase)
    tree = plant.table.selection() @ place
    return np.concatenate([tree, tree[list(plant.motors)]])


def _offsets(plant: Plant) -> np.ndarray:
    """Constant torque per drive: offset, and half the difference of the two directions (MuJoCo's level is even)."""
    lean = np.zeros(len(plant.table.links))
    for i, value in plant.offset.items():
        lean[i] += value
    for i, law in plant.friction.items():
        lean[i] -= 0.5 * (law.positive - law.negative)
    return lean[list(plant.table.active)]


def _sag(plant: Plant, command: np.ndarray, load: float, dt: float) -> tuple[float, float]:
    """Share of the torque that a weak supply gives, one at mean load, and the filtered load ``sum |tau| / scale``."""
    cause = plant.outside
    if cause is None or cause.name != "voltage_sag":
        return 1.0, load
    p = cause.parameters
    keep = np.exp(-dt / p["time_constant"])
    load = keep * load + (1.0 - keep) * float(np.abs(command).sum()) / p["scale"]
    return 1.0 - p["depth"] * (load - 1.0), load


def simulate(plant: Plant, owner: Table, session: Session) -> Run:
    """The machine under feedforward of the owner's model and a sampled PD controller on the encoder.

    MuJoCo's Euler steps are a leapfrog: velocities lie half a step before positions. So positions are read half a
    step back, at the time of the velocities, where a hold begins; that is exact to second order.
    """
    n, nv = session.reference.shape
    dt, active = 1.0 / session.rate, plant.table.active
    inner = round(dt / INNER_STEP)
    model = compiled(plant)
    data = mujoco.MjData(model)
    data.qpos[:] = _start(plant, session.reference[0])
    drives = np.array([plant.drive(i) for i in active])
    ahead = feedforward(owner, session.reference, session.rate)
    speed = np.gradient(session.reference, dt, axis=0)
    omega = 2.0 * np.pi * session.bandwidth
    inertia = np.diag(mass_matrix(owner, session.reference[:: max(1, n // 50)]))
    kp, kd = inertia * omega**2, inertia * 1.6 * omega
    held = [[] for _ in active]
    channels = [
        Drive(plant.channels.get(i, Channel()), held[j], dt, LAW_STEP * INNER_STEP) for j, i in enumerate(active)
    ]
    timed = [j for j, drive in enumerate(channels) if drive.channel.delay or drive.channel.lag]
    ratio = np.array([drive.channel.ratio for drive in channels])
    limit = np.array([drive.channel.limit for drive in channels])
    laws, lean = laws_of(plant, data.qpos[list(active)]), _offsets(plant)
    level0, damping = model.dof_frictionloss.copy(), model.dof_damping.copy()
    coarse = any(e != Encoder() for e in plant.encoders.values())
    quantum = 2.0 * np.pi / session.encoder_counts if session.encoder_counts else 0.0
    keep = np.exp(-2.0 * np.pi * 40.0 * dt)
    measured, command, seen, q = (np.empty((n, nv)) for _ in range(4))
    estimate, last, load = np.zeros(nv), None, 1.0
    torque = np.zeros(model.nv)
    for k in range(n):
        if not np.abs(data.qvel).max() < RUNAWAY:
            q[k:] = seen[k:] = measured[k:] = command[k:] = np.nan
            break
        q[k] = data.qpos[drives] - 0.5 * INNER_STEP * data.qvel[drives]
        seen[k] = _readings(plant, q[k]) if coarse else q[k]
        reading = seen[k] + session.dither[k]
        if quantum:
            reading = np.round(reading / quantum) * quantum
        if last is not None:
            estimate = keep * estimate + (1.0 - keep) * (reading - last) / dt
        last = measured[k] = reading
        command[k] = ahead[k] + kp * (session.reference[k] - reading) + kd * (speed[k] - estimate)
        left, load = _sag(plant, command[k], load, dt)
        drive = left * ratio * np.minimum(np.maximum(command[k], -limit), limit)
        beside = session.disturbance[k] + lean
        if not laws and not timed:
            data.qfrc_applied[drives] = drive + beside
            mujoco.mj_step(model, data, inner)
            continue
        for j in timed:
            held[j].append(float(command[k, j]))
        for step in range(inner // LAW_STEP):
            since = step * LAW_STEP * INNER_STEP
            for j in timed:
                drive[j] = left * channels[j].torque(k + since / dt)
            level = level0.copy()
            torque[:] = 0.0
            torque[drives] = drive + beside
            for law in laws:
                law(data, k * dt + since, level, torque, damping)
            if laws:
                model.dof_frictionloss[:] = np.maximum(level, 0.0)
                model.dof_damping[:] = damping
            data.qfrc_applied[:] = torque
            mujoco.mj_step(model, data, LAW_STEP)
    return Run(np.arange(n) * dt, measured, command, seen, q)
