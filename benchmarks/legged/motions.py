"""Reference motions of the robots' controllers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.legged.robots import Robot

Array = np.ndarray


@dataclass(frozen=True)
class Task:
    """Kind of motion.

    Attributes:
        hangs: True if the robot hangs in a hand, False if it walks.
        seconds: Duration [s].
        rate: Rate of control and recording [Hz].
        gait: Steps of each leg per second [Hz].
        duty: Share of the time in which a foot is on the ground.
        stride, lift: Length and height of a step [m].
        stiff: Gains of the controllers as a multiple of the robot's.
    """

    hangs: bool
    seconds: float
    rate: float
    gait: float
    duty: float
    stride: float
    lift: float
    stiff: float


def phases_of(robot: Robot, task: Task, rng: np.random.Generator) -> Array:
    """Phases of the limbs [turns]: diagonal legs, or left and right alternately; random in the hand."""
    if robot.name == "arm":
        return rng.uniform(0, 1, 6)
    phases = np.array([0.0, 0.5, 0.5, 0.0]) if robot.name == "quadruped" else np.array([0.0, 0.5])
    return phases + (rng.uniform(0, 1, len(phases)) if task.hangs else 0.0)


def references(robot: Robot, task: Task, t: float, phases: Array) -> Array:
    """Reference positions of the controllers; every step has another length and height."""
    return {"quadruped": _quadruped, "biped": _biped, "arm": _arm}[robot.name](task, t, phases)


def _steps(task: Task, t: float) -> tuple[float, float, float]:
    """Stride and lift [m], and the number of steps."""
    stride = task.stride * (0.4 + 0.9 * np.sin(2 * np.pi * 0.083 * t))
    lift = task.lift * (1 + 0.35 * np.sin(2 * np.pi * 0.21 * t + 1))
    return stride, lift, task.gait * (t + 0.25 * np.sin(2 * np.pi * 0.11 * t))


def _knee(x: float, z: float, link: float) -> tuple[float, float]:
    """Hip and knee angle for which two equal links reach a place below the hip."""
    reach = np.clip(np.hypot(x, z), 0.1, 2 * link - 0.005)
    half = np.arccos(reach / (2 * link))
    return np.arctan2(-x, -z) + half, -2 * half


def _swing(s: float) -> tuple[float, float]:
    """Way along the stride and height, each from 0 to 1, at a share of a swing."""
    return s - np.sin(2 * np.pi * s) / (2 * np.pi), 0.5 * (1 - np.cos(2 * np.pi * s))


def _quadruped(task: Task, t: float, phases: Array) -> Array:
    out, height = np.empty(12), 0.30
    stride, lift, cycles = _steps(task, t)
    for k in range(4):
        phase = (cycles + phases[k]) % 1.0
        if task.hangs:
            x = 0.5 * task.stride * np.sin(2 * np.pi * (task.gait * (1 + 0.07 * k) * t + phases[k]))
            z = -height + 0.06 * np.sin(2 * np.pi * (1.37 * task.gait * t + 2 * phases[k]))
            y = 0.25 * np.sin(2 * np.pi * (0.61 * task.gait * (1 + 0.05 * k) * t + phases[k]))
        elif phase < task.duty:
            x, z = stride * (0.5 - phase / task.duty), -height
            y = 0.04 * np.sin(2 * np.pi * 0.31 * t + k)
        else:
            s = (phase - task.duty) / (1 - task.duty)
            along, up = _swing(s)
            x, z = stride * (along - 0.5), -height + lift * up
            y = 0.04 * np.sin(2 * np.pi * 0.31 * t + k) + 0.1 * np.sin(2 * np.pi * 0.17 * t) * np.sin(np.pi * s) ** 2
        out[3 * k : 3 * k + 3] = (y if k % 2 == 0 else -y), *_knee(x, z, 0.213)
    return out


def _biped(task: Task, t: float, phases: Array) -> Array:
    out, height = np.empty(10), 0.54
    stride, lift, cycles = _steps(task, t)
    for k in range(2):
        phase, side = (cycles + phases[k]) % 1.0, 1.0 - 2 * k
        turns, tips = 0.0, 0.0
        if task.hangs:
            x = 0.5 * task.stride * np.sin(2 * np.pi * (task.gait * (1 + 0.07 * k) * t + phases[k]))
            z = -height + 0.09 * np.sin(2 * np.pi * (1.37 * task.gait * t + 2 * phases[k])) - 0.02
            leans = 0.2 * np.sin(2 * np.pi * (0.61 * task.gait * t + phases[k])) + 0.05 * side
            turns = 0.35 * np.sin(2 * np.pi * (0.83 * task.gait * (1 + 0.05 * k) * t + phases[k]))
            tips = 0.3 * np.sin(2 * np.pi * (1.13 * task.gait * t + 3 * phases[k]))
        else:
            x, z, leans = stride * (0.5 - phase / task.duty), -height, 0.0
            if phase >= task.duty:
                s = (phase - task.duty) / (1 - task.duty)
                along, up = _swing(s)
                x, z = stride * (along - 0.5), -height + lift * up
                leans = 0.08 * np.sin(2 * np.pi * 0.17 * t) * up
                turns, tips = 0.15 * np.sin(2 * np.pi * 0.23 * t + k) * up, 0.25 * np.sin(2 * np.pi * s) * up
        thigh, knee = _knee(x, z, 0.3)
        out[5 * k : 5 * k + 5] = turns, leans, thigh, knee, -thigh - knee + tips
    return out


def _arm(task: Task, t: float, phases: Array) -> Array:
    size = np.array([0.9, 0.7, 0.8, 1.0, 0.9, 1.2])
    speed = task.gait * np.array([0.31, 0.37, 0.53, 0.61, 0.71, 0.83])
    slow = 0.6 * np.sin(2 * np.pi * (speed * t + phases)) + 0.4 * np.sin(2 * np.pi * (1.73 * speed * t + 3 * phases))
    return size * slow + np.array([0.0, 0.4, -0.8, 0.0, 0.3, 0.0])
