# pyright: reportAttributeAccessIssue=false
"""A quadruped under position control in MuJoCo: it trots on flat ground, or hangs in a hand that sways."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.legged.quadruped import CALF, JOINTS, LEGS, THIGH, Numbers, plant

Array = np.ndarray
Rng = np.random.Generator

STEP = 0.0005  # [s]
TOUCHING = 4.0  # force on a foot from which on it touches [N]
HAND = 3000.0, 180.0  # stiffness [N/m] and damping [N s/m] of the hand that holds the trunk
TILTS = 200.0, 12.0  # the same against turning [N m/rad, N m s/rad]
RIPPLE = 0.1  # of the drives from millisecond to millisecond, in no log [N m]
CREEPS = 0.02  # speed at which dry friction is 76 % of its torque [rad/s]
ENCODER = 2 * np.pi / 2**15  # step of a position [rad]
SHAKES = 1e-5  # noise of a position [rad]
GYROSCOPE, ACCELEROMETER = 0.003, 0.05  # noise of a reading [rad/s, m/s^2]


@dataclass(frozen=True)
class Drive:
    """What the drives make of the torque that is commanded, each ``(12,)``.

    Attributes:
        scale: Torque over commanded torque.
        delay: By which it comes late [s].
        limit: Largest torque [N m].
    """

    scale: Array
    delay: Array
    limit: Array


@dataclass(frozen=True)
class Task:
    """How the robot moves.

    Attributes:
        hangs: In the hand, or else trots.
        seconds: How long.
        rate: Of control and record [Hz].
        gait: Steps of a leg a second [Hz].
        duty: Share of the time that a foot is on the ground.
        stride, lift: Of a foot [m].
        kp, kd: Gains of the controllers.
    """

    hangs: bool
    seconds: float
    rate: float
    gait: float
    duty: float
    stride: float
    lift: float
    kp: float
    kd: float


def references(task: Task, t: float, phases: Array) -> Array:
    """Positions that the controllers are asked for, ``(12,)``; no step is as long or as high as the one before."""
    out = np.empty(12)
    stride = task.stride * (0.4 + 0.9 * np.sin(2 * np.pi * 0.083 * t))
    lift = task.lift * (1 + 0.35 * np.sin(2 * np.pi * 0.21 * t + 1))
    cycles = task.gait * (t + 0.25 * np.sin(2 * np.pi * 0.11 * t))
    for k, leg in enumerate(LEGS):
        phase = (cycles + phases[k]) % 1.0
        height = 0.30
        if task.hangs:
            x = 0.5 * task.stride * np.sin(2 * np.pi * (task.gait * (1 + 0.07 * k) * t + phases[k]))
            z = -height + 0.06 * np.sin(2 * np.pi * (1.37 * task.gait * t + 2 * phases[k]))
            y = 0.25 * np.sin(2 * np.pi * (0.61 * task.gait * (1 + 0.05 * k) * t + phases[k]))
        elif phase < task.duty:
            x, z = stride * (0.5 - phase / task.duty), -height
            y = 0.04 * np.sin(2 * np.pi * 0.31 * t + k)
        else:
            s = (phase - task.duty) / (1 - task.duty)
            x = stride * (s - np.sin(2 * np.pi * s) / (2 * np.pi) - 0.5)
            z = -height + lift * 0.5 * (1 - np.cos(2 * np.pi * s))
            y = 0.04 * np.sin(2 * np.pi * 0.31 * t + k) + 0.1 * np.sin(2 * np.pi * 0.17 * t) * np.sin(np.pi * s) ** 2
        reach = np.clip(np.hypot(x, z), 0.1, THIGH + CALF - 0.005)
        knee = -(np.pi - np.arccos((THIGH**2 + CALF**2 - reach**2) / (2 * THIGH * CALF)))
        thigh = np.arctan2(-x, -z) + np.arccos((THIGH**2 + reach**2 - CALF**2) / (2 * THIGH * reach))
        out[3 * k : 3 * k + 3] = (y if leg[1] == "L" else -y), thigh, knee
    return out


def simulate(numbers: Numbers, drive: Drive, task: Task, rng: Rng) -> Mapping[str, Array]:
    """Columns of the log of one run, as the diagnosis reads them.

    The torque is the one that was commanded, without the ripple of the drives; the inertial sensor averages over the
    time between two samples.

    Raises:
        FloatingPointError: If the robot falls.
    """
    model = mujoco.MjModel.from_xml_string(plant(numbers, STEP))
    data = mujoco.MjData(model)
    phases = np.array([0.0, 0.5, 0.5, 0.0]) + (rng.uniform(0, 1, 4) if task.hangs else 0.0)
    data.qpos[7:] = references(task, 0.0, phases)
    if task.hangs:
        data.qpos[2] = 0.8
    inner = round(1 / (task.rate * STEP))
    wait = np.round(drive.delay / STEP).astype(int)
    past = np.zeros((int(wait.max()) + 1, 12))
    settle, count = round(0.6 * task.rate), round(task.seconds * task.rate)
    names = [f"{q}.{joint}" for q in ("q", "tau", "q_ref") for joint in JOINTS]
    rows, sensed, touched = np.empty((count, 36)), np.empty((count, 6)), np.empty((count, 4))
    sways = rng.uniform(0.2, 0.9, 6), rng.uniform(0, 6.28, 6)
    read = np.zeros(6)
    felt, ripple = np.zeros(4), np.zeros(12)
    for n in range(-settle, count):
        t = n / task.rate
        asked = references(task, max(t, 0.0), phases)
        q = np.round((data.qpos[7:] + SHAKES * rng.normal(size=12)) / ENCODER) * ENCODER
        tau = task.kp * (asked - q) - task.kd * data.qvel[6:]
        if n >= 0:
            rows[n], sensed[n], touched[n] = np.concatenate([q, tau, asked]), read, felt > TOUCHING
        read = np.zeros(6)
        for step in range(inner):
            past = np.roll(past, 1, axis=0)
            past[0] = tau
            given = drive.scale * past[wait, np.arange(12)]
            ripple = RIPPLE * rng.normal(size=12) if step % round(0.001 / STEP) == 0 else ripple
            data.ctrl[:] = np.clip(given, -drive.limit, drive.limit) + ripple
            data.qfrc_applied[6:] = -numbers.friction * np.tanh(data.qvel[6:] / CREEPS)
            if task.hangs:
                data.xfrc_applied[1] = _hand(data, t, sways)
            mujoco.mj_step(model, data)
            read += data.sensordata[:6] / inner
        felt = data.sensordata[6:].copy()
        upright = 1 - 2 * (data.qpos[4] ** 2 + data.qpos[5] ** 2)
        if not np.isfinite(data.qpos).all() or upright < 0.5:
            raise FloatingPointError(f"The robot falls after {t:.2f} s.")
    out = {"t": np.arange(count) / task.rate} | dict(zip(names, rows.T, strict=True))
    sensed[:, :3] += GYROSCOPE * rng.normal(size=(count, 3))
    sensed[:, 3:] += ACCELEROMETER * rng.normal(size=(count, 3))
    for k, (quantity, axis) in enumerate([(q, a) for q in ("w", "sf") for a in "xyz"]):
        out[f"{quantity}.imu.{axis}"] = sensed[:, k]
    return out | {f"contact.{leg}_foot": touched[:, k] for k, leg in enumerate(LEGS)}


def _hand(data: mujoco.MjData, t: float, sways: tuple[Array, Array]) -> Array:
    """Force and moment of a hand on the trunk, which it moves and turns about slowly."""
    speed, start = sways
    place = 0.06 * np.sin(2 * np.pi * speed[:3] * t + start[:3]) + np.array([0.0, 0.0, 0.8])
    turn = 0.3 * np.sin(2 * np.pi * speed[3:] * t + start[3:])
    quat = data.qpos[3:7] if data.qpos[3] >= 0 else -data.qpos[3:7]
    force = HAND[0] * (place - data.qpos[:3]) - HAND[1] * data.qvel[:3] + np.array([0.0, 0.0, 150.0])
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, data.qpos[3:7])
    body = axes.reshape(3, 3)
    moment = TILTS[0] * (turn - 2 * body @ np.array(quat[1:])) - TILTS[1] * body @ data.qvel[3:6]
    return np.concatenate([force, moment])
