# pyright: reportAttributeAccessIssue=false
"""Simulate a robot under position control in MuJoCo, which walks on flat ground or hangs in a swaying hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from benchmarks.legged.files import plant
from benchmarks.legged.motions import Task, phases_of, references
from benchmarks.legged.robots import Numbers, Robot

Array = np.ndarray
Rng = np.random.Generator

STEP = 0.0005  # integration step [s]
TOUCHING = 4.0  # least force on a foot that counts as contact [N]
HAND = 3000.0, 180.0  # stiffness [N/m] and damping [N s/m] of the hand that holds the trunk
TILTS = 200.0, 12.0  # rotational stiffness [N m/rad] and damping [N m s/rad] of the hand
GANTRY = 0.6  # share of a biped's weight that a gantry carries while it walks
RIPPLE = 0.1  # torque ripple of the drives in each millisecond, not logged [N m]
CREEPS = 0.02  # speed at which dry friction is 76 % of its torque [rad/s]
ENCODER = 2 * np.pi / 2**15  # resolution of a position [rad]
SHAKES = 1e-5  # noise of a position [rad]
GYROSCOPE, ACCELEROMETER = 0.003, 0.05  # noise of the inertial sensor [rad/s, m/s^2]


@dataclass(frozen=True)
class Drive:
    """Errors of the drives, each ``(n,)``.

    Attributes:
        scale: Actual torque divided by commanded torque.
        delay: Delay of the torque [s].
    """

    scale: Array
    delay: Array


@dataclass(frozen=True)
class Sensor:
    """Errors of the inertial sensor.

    Attributes:
        offsets: Offsets of gyroscope [rad/s] and accelerometer [m/s^2], ``(2, 3)``.
        scales: Readings divided by true values, ``(2, 3)``.
        turn: Rotation vector of its axes [rad].
        shift: Error of its position on the base [m].
        late: Delay [s].
        mount: Natural frequency of its mount [Hz]; infinite for a rigid mount.
    """

    offsets: Array
    scales: Array
    turn: Array
    shift: Array
    late: float
    mount: float = np.inf


@dataclass(frozen=True)
class Ground:
    """The ground: friction coefficient, and time constant of contacts [s]."""

    rubs: float = 0.8
    softness: float = 0.02


@dataclass(frozen=True)
class Run:
    """One run: its log, and true values at the same times.

    Attributes:
        log: Columns of the log.
        qpos, qvel: MuJoCo's positions and velocities of base and joints.
        asked, given: Commanded torque, and torque of the drives without their ripple [N m], ``(N, n)``.
        touched: 1 where an end has contact, ``(N, ends)``.
        shaken: Error of gyroscope and accelerometer because of a loose mount [rad/s, m/s^2], ``(N, 6)``.
    """

    log: Mapping[str, Array]
    qpos: Array
    qvel: Array
    asked: Array
    given: Array
    touched: Array
    shaken: Array


def simulate(robot: Robot, numbers: Numbers, drive: Drive, sensor: Sensor, ground: Ground, task: Task, rng: Rng) -> Run:
    """Simulate one run of a robot.

    The logged torque is the commanded torque, without the ripple of the drives; the inertial sensor averages over the
    time between two samples.

    Raises:
        FloatingPointError: If the robot falls.
    """
    model = mujoco.MjModel.from_xml_string(plant(robot, numbers, STEP, ground.rubs, ground.softness))
    model.site("imu").pos[:] += sensor.shift
    data = mujoco.MjData(model)
    n_joints, phases = len(robot.parts), phases_of(robot, task, rng)
    data.qpos[7:] = references(robot, task, 0.0, phases)
    held = _held(robot, task)
    if task.hangs:
        data.qpos[2] = held.height
    inner = round(1 / (task.rate * STEP))
    wait = np.round(drive.delay / STEP).astype(int)
    past = np.zeros((int(wait.max()) + 1, n_joints))
    settle, count = round(0.6 * task.rate), round(task.seconds * task.rate)
    names = [f"{q}.{joint}" for q in ("q", "tau", "q_ref") for joint in robot.joints]
    rows, sensed = np.empty((count, 3 * n_joints)), np.empty((count, 6))
    touched = np.empty((count, len(robot.ends)))
    qpos, qvel = np.empty((count, n_joints + 7)), np.empty((count, n_joints + 6))
    delivered = np.zeros((count, n_joints))
    sways = rng.uniform(0.2, 0.9, 6), rng.uniform(0, 6.28, 6)
    read, felt, ripple = np.zeros(6), np.zeros(len(robot.ends)), np.zeros(n_joints)
    for n in range(-settle, count):
        t = n / task.rate
        asked = references(robot, task, max(t, 0.0), phases)
        q = np.round((data.qpos[7:] + SHAKES * rng.normal(size=n_joints)) / ENCODER) * ENCODER
        tau = task.stiff * robot.kp * (asked - q) - np.sqrt(task.stiff) * robot.kd * data.qvel[6:]
        if n >= 0:
            rows[n], sensed[n], touched[n] = np.concatenate([q, tau, asked]), read, felt > TOUCHING
            qpos[n], qvel[n] = data.qpos, data.qvel
        read = np.zeros(6)
        for step in range(inner):
            past = np.roll(past, 1, axis=0)
            past[0] = tau
            given = drive.scale * past[wait, np.arange(n_joints)]
            if n >= 0:
                delivered[n] += given / inner
            ripple = RIPPLE * rng.normal(size=n_joints) if step % round(0.001 / STEP) == 0 else ripple
            data.ctrl[:] = given + ripple
            data.qfrc_applied[6:] = -numbers.friction * np.tanh(data.qvel[6:] / CREEPS)
            if held.share:
                data.xfrc_applied[1] = _hand(data, t, sways, held)
            mujoco.mj_step(model, data)
            read += data.sensordata[:6] / inner
        felt = data.sensordata[6:].copy()
        upright = 1 - 2 * (data.qpos[4] ** 2 + data.qpos[5] ** 2)
        if not np.isfinite(data.qpos).all() or upright < 0.5:
            raise FloatingPointError(f"The robot falls after {t:.2f} s.")
    out = {"t": np.arange(count) / task.rate} | dict(zip(names, rows.T, strict=True))
    firm = read_by(replace(sensor, mount=np.inf), sensed, task.rate)
    sensed = read_by(sensor, sensed, task.rate)
    shaken = sensed - firm
    sensed[:, :3] += GYROSCOPE * rng.normal(size=(count, 3))
    sensed[:, 3:] += ACCELEROMETER * rng.normal(size=(count, 3))
    for k, (quantity, axis) in enumerate([(q, a) for q in ("w", "sf") for a in "xyz"]):
        out[f"{quantity}.imu.{axis}"] = sensed[:, k]
    out |= {f"contact.{end.name}": touched[:, k] for k, end in enumerate(robot.ends)}
    return Run(out, qpos, qvel, rows[:, n_joints : 2 * n_joints], delivered, touched, shaken)


def read_by(sensor: Sensor, there: Array, rate: float) -> Array:
    """Readings of the sensor for true angular velocity and specific force at its place, ``(N, 6)``."""
    if np.isfinite(sensor.mount):
        there = _on_springs(there, sensor.mount, rate)
    matrix, flat = np.zeros(9), np.zeros(4)
    angle = float(np.linalg.norm(sensor.turn))
    mujoco.mju_axisAngle2Quat(flat, sensor.turn / max(angle, 1e-300), angle)
    mujoco.mju_quat2Mat(matrix, flat)
    t = np.arange(len(there)) / rate
    out = np.hstack([part @ matrix.reshape(3, 3) for part in (there[:, :3], there[:, 3:])])
    out = out * sensor.scales.ravel() + sensor.offsets.ravel()
    return np.column_stack([np.interp(t - sensor.late, t, column) for column in out.T])


def _on_springs(there: Array, hz: float, rate: float) -> Array:
    """Response of a mass on a spring with a tenth of the critical damping to each reading."""
    w, inner = 2 * np.pi * hz, 8
    out, x, v = np.empty_like(there), there[0].copy(), np.zeros(there.shape[1])
    for n, now in enumerate(there):
        for _ in range(inner):
            v = v + (w**2 * (now - x) - 0.2 * w * v) / (rate * inner)
            x = x + v / (rate * inner)
        out[n] = x
    return out


@dataclass(frozen=True)
class _Held:
    """How a hand or gantry holds the trunk: its height [m], how far it sways [m, rad], share of the weight."""

    height: float
    sway: float
    tilt: float
    share: float
    weight: float


def _held(robot: Robot, task: Task) -> _Held:
    if task.hangs:
        height = 0.8 if robot.name == "quadruped" else 1.4
        return _Held(height, 0.06, 0.3, 1.0, robot.weight)
    return _Held(robot.height - 0.005, 0.004, 0.04, GANTRY if robot.name == "biped" else 0.0, robot.weight)


def _hand(data: mujoco.MjData, t: float, sways: tuple[Array, Array], held: _Held) -> Array:
    """Force and moment on the trunk of a hand that moves and turns it slowly."""
    speed, start = sways
    place = held.sway * np.sin(2 * np.pi * speed[:3] * t + start[:3]) + np.array([0.0, 0.0, held.height])
    turn = held.tilt * np.sin(2 * np.pi * speed[3:] * t + start[3:])
    quat = data.qpos[3:7] if data.qpos[3] >= 0 else -data.qpos[3:7]
    lifts = np.array([0.0, 0.0, held.share * held.weight])
    force = HAND[0] * (place - data.qpos[:3]) - HAND[1] * data.qvel[:3] + lifts
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, data.qpos[3:7])
    body = axes.reshape(3, 3)
    moment = TILTS[0] * (turn - 2 * body @ np.array(quat[1:])) - TILTS[1] * body @ data.qvel[3:6]
    return np.concatenate([force, moment])
