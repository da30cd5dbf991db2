# pyright: reportAttributeAccessIssue=false
"""Compute how large an effect is relative to the true noise while a joint's descendants have no contact.

Everything is computed from the simulated truth, without any diagnosis: the torque that the effect adds along the
motion, minus the part that links, rotors and friction within two tolerances explain, below `BAND` and in free swings,
divided by the ripple of drives and the noise of encoders and inertial sensors in the same band and swings.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from scipy import ndimage
from scipy.optimize import lsq_linear

from benchmarks.gapbench.makes.drake.measure import size_of
from benchmarks.legged.files import plant
from benchmarks.legged.robots import Numbers, Robot
from benchmarks.legged.simulate import ACCELEROMETER, CREEPS, ENCODER, GYROSCOPE, RIPPLE, SHAKES, STEP, Run

Array = np.ndarray

BAND = 20.0  # frequency at which the low pass has half of the amplitude [Hz]
_WIDTH = np.sqrt(2 * np.log(2)) / (2 * np.pi * BAND)  # standard deviation of the smoothing Gaussian [s]
_REACH = 3.0  # length of this Gaussian in standard deviations
_MARGIN = 0.02  # time next to a contact that is excluded [s]
_RATE = 250.0  # rate at which torques are compared [Hz]
_TOLERANCES = {"mass": 0.05, "armature": 0.1, "damping": 0.05, "friction": 0.05}


def gap_over_floor(robot: Robot, healthy: Numbers, changed: Numbers, run: Run, rate: float) -> float:
    """Part of an effect beyond two tolerances in free swings [noise floors], over the joints that it changes.

    Args:
        robot: Links, joints and ends.
        healthy: Numbers of the robot without the effect.
        changed: Numbers that the effect changes.
        run: Run of the robot with the effect.
        rate: Rate of its recording [Hz].
    """
    step = max(1, round(rate / _RATE))
    mass, axes = _mass(robot, healthy, np.median(run.qpos, axis=0))
    shaken = run.shaken.reshape(-1, 2, 3) @ axes.T
    there = _smooth(run.asked - run.given, rate) + _of_base(mass, shaken[:, 0], shaken[:, 1], rate)
    free = _free(robot, run, rate)[::step]
    a = np.gradient(run.qvel, 1 / rate, axis=0)
    state = run.qpos[::step], run.qvel[::step], a[::step]
    own = _needed(robot, healthy, *state)
    change = (there[::step] + _smooth(_needed(robot, changed, *state) - own, rate / step)) * free
    floor = _rms(_noise(mass, run.asked.shape, rate)[::step], free)
    floor[~free.any(axis=0)] = np.inf
    if not change.any():
        return 0.0
    left = _beyond_tolerance(robot, healthy, state, own, change / floor, free / floor, rate / step)
    return size_of(left * np.sqrt(len(free) / np.maximum(free.sum(axis=0), 1)))


def _free(robot: Robot, run: Run, rate: float) -> Array:
    """True while a joint's descendants have no contact within the length of the filter, ``(N, n)``."""
    out = np.ones(run.asked.shape, dtype=bool)
    reach = round((_MARGIN + _REACH * _WIDTH) * rate)
    for end, touches in zip(robot.ends, run.touched.T, strict=True):
        away, part = ndimage.minimum_filter1d(touches == 0, 2 * reach + 1), end.part
        while part >= 0:
            out[:, part] &= away
            part = robot.parts[part].before
    out[:reach], out[len(out) - reach :] = False, False
    return out


def _smooth(x: Array, rate: float) -> Array:
    return ndimage.gaussian_filter1d(x, _WIDTH * rate, axis=0, truncate=_REACH)


def _rms(x: Array, free: Array) -> Array:
    return np.sqrt((x**2 * free).sum(axis=0) / np.maximum(free.sum(axis=0), 1))


def _needed(robot: Robot, numbers: Numbers, q: Array, v: Array, a: Array) -> Array:
    """Torque that links, rotors and friction need on the joints without contacts [N m], ``(N, n)``."""
    model = mujoco.MjModel.from_xml_string(plant(robot, numbers, STEP))
    data, torque, out = mujoco.MjData(model), np.empty(model.nv), np.empty((len(q), len(robot.parts)))
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, torque)
        out[k] = torque[6:]
    joints = v[:, 6:]
    return out + numbers.armature * a[:, 6:] + numbers.damping * joints + numbers.friction * np.tanh(joints / CREEPS)


def _mass(robot: Robot, numbers: Numbers, q: Array) -> tuple[Array, Array]:
    """Mass matrix of base and joints with an upright base, and the axes of the inertial sensor."""
    model = mujoco.MjModel.from_xml_string(plant(robot, numbers, STEP))
    data, mass = mujoco.MjData(model), np.empty((model.nv, model.nv))
    data.qpos[:] = q
    data.qpos[3:7] = 1.0, 0.0, 0.0, 0.0
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    return mass, data.site("imu").xmat.reshape(3, 3)


def _of_base(mass: Array, w: Array, sf: Array, rate: float) -> Array:
    """Change of the joint torques for small errors of the base's angular velocity and specific force [N m]."""
    return _smooth(np.hstack([sf, np.gradient(w, 1 / rate, axis=0)]), rate) @ mass[6:, :6].T


def _noise(mass: Array, shape: tuple[int, int], rate: float) -> Array:
    """Torque error below the band because of noise [N m], ``(N, n)``."""
    rng = np.random.default_rng(0)
    errors = SHAKES * rng.normal(size=shape) + ENCODER * rng.uniform(-0.5, 0.5, shape)
    joints = np.gradient(np.gradient(_smooth(errors, rate), 1 / rate, axis=0), 1 / rate, axis=0)
    ripple = RIPPLE / np.sqrt(max(1.0, 1000.0 / rate)) * rng.normal(size=shape)
    w, sf = GYROSCOPE * rng.normal(size=(shape[0], 3)), ACCELEROMETER * rng.normal(size=(shape[0], 3))
    return _smooth(ripple, rate) + joints @ mass[6:, 6:].T + _of_base(mass, w, sf, rate)


def _beyond_tolerance(
    robot: Robot,
    numbers: Numbers,
    state: tuple[Array, Array, Array],
    own: Array,
    change: Array,
    weight: Array,
    rate: float,
) -> Array:
    """Part of a change that links, rotors and friction within two tolerances cannot explain."""
    reached = np.sqrt((change**2).mean(axis=0))
    rows = np.flatnonzero(reached >= 0.1 * reached.max())
    columns = []
    for name, tolerance in _TOLERANCES.items():
        for j in range(len(robot.parts)):
            values = getattr(numbers, name).copy()
            values[j] *= 1 + tolerance
            if name != "mass" and j not in rows:
                continue
            moved = _needed(robot, replace(numbers, **{name: values}), *state) - own
            if np.any(moved[:, rows]):
                columns.append((weight * _smooth(moved, rate))[:, rows].ravel())
    matrix = np.column_stack(columns)
    out = np.zeros_like(change)
    q, r = np.linalg.qr(matrix)
    fit = lsq_linear(r, q.T @ change[:, rows].ravel(), bounds=(-2.0, 2.0))
    out[:, rows] = change[:, rows] - (matrix @ fit.x).reshape(-1, len(rows))
    return out
