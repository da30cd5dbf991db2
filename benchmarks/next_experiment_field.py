"""Robots with one effect as users have them, recorded as users record and then along another motion."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.fresh_noise import fresh_noise
from benchmarks.gapbench.makes.field.case import Setting, Sized, draw_open, feedforward
from benchmarks.gapbench.makes.field.records import LEAD, Recorder, columns, written
from benchmarks.gapbench.makes.field.simulate import STEP, Task
from benchmarks.gapbench.makes.field.world import World, moved, with_body
from benchmarks.next_experiment_makes import Case
from identification.data.changes import KnownPayload
from identification.data.reading import read_recording
from identification.data.recording import Recording
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Array = np.ndarray
Rng = np.random.Generator
HELD = 4  # number of simulation steps for which unrecorded torques stay constant
AFTER = 0.1  # time at rest after the motion [s]


def drawn_case(seed: int) -> Case | None:
    """The single case of a development seed with its ordinary recording; None if its effect leaves no trace."""
    drawn = draw_open(seed)
    if drawn is None:
        return None
    said, setting, one = drawn
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for name, content in said.items():
            (place / name).write_bytes(content)
        robot = load_robot(str(place / ("robot.xml" if "robot.xml" in said else "robot.urdf")))
        first = read_recording(place / f"log.{setting.recorder.ending}", robot)
    truth = (one.effect.name, one.effect.joint)
    return Case(
        f"{setting.robot.kind.name}, {setting.motion}", robot, truth, first, Repeated(seed, setting, one, robot)
    )


@dataclass(frozen=True)
class Repeated:
    """Records the robot of a case along other motions with the same controller, drives, encoders and logger.

    Attributes:
        seed: Seed of the case.
        setting: Everything except the effect.
        one: The effect.
        given: Given model.
    """

    seed: int
    setting: Setting
    one: Sized
    given: Robot

    def __call__(self, motion: Motion, noise: int, payload: KnownPayload | None = None) -> Recording | None:
        """Record a motion, see `Again`."""
        rng = np.random.default_rng([self.seed, 711, noise])
        setting = self.setting
        ref = reference_at_steps(motion)
        extra = fresh_noise(setting.task.extra[::HELD], math.ceil(len(ref) / HELD), rng)
        task = task_along(setting, ref, np.repeat(extra, HELD, axis=0)[: len(ref)])
        recorder = fresh_recorder(setting.recorder, float(motion.t[-1]), rng)
        log = log_of(setting, world_with(self.one, setting.world, len(ref), payload), task, recorder)
        if log is None:
            return None
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"next.{recorder.ending}"
            path.write_bytes(written(log, recorder.ending))
            return read_recording(path, self.given)


def reference_at_steps(motion: Motion) -> Array:
    """Positions at every simulation step, at rest before and after the motion [rad or m], shape ``(K, n)``."""
    t = np.arange(0.0, LEAD + motion.t[-1] + AFTER, STEP) - LEAD
    return CubicSpline(motion.t, motion.q, bc_type="clamped")(np.clip(t, 0.0, motion.t[-1]))


def task_along(setting: Setting, ref: Array, extra: Array) -> Task:
    """The controller of a setting on another reference; ``extra`` are unrecorded torques, as long as the reference."""
    speed, feed = feedforward(setting.robot, ref, setting.known)
    still = np.zeros(len(ref), dtype=bool)
    return replace(setting.task, ref=ref, speed=speed, feed=feed, extra=extra, held=still)


def world_with(one: Sized, world: World, steps: int, payload: KnownPayload | None) -> World:
    """The true robot with its effect for a number of steps, with an optional known mass in the last joint's frame."""
    still = np.zeros(steps, dtype=bool)
    world = one.effect.put(replace(world, held=still, pushed=np.zeros((steps, world.chain.n))), one.size)
    if payload is None:
        return world
    chain = with_body(world.chain, world.chain.n - 1, payload.mass, np.array(payload.center), np.zeros((3, 3)))
    return replace(world, chain=chain)


def log_of(setting: Setting, world: World, task: Task, recorder: Recorder) -> Mapping[str, Array] | None:
    """The log of a run; None if the robot does not follow its reference."""
    run = moved(world, task)
    miss = np.abs(run.reading - task.ref).max(axis=0)
    if not (np.isfinite(miss).all() and np.all(miss < np.maximum(0.5 * setting.scale.reach, 0.05))):
        return None
    return columns(setting.robot, run, task.ref, recorder, world.quantum)


def fresh_recorder(before: Recorder, seconds: float, rng: Rng) -> Recorder:
    """The same logger with new uneven times, lost and repeated rows, and noise."""
    count = int(seconds * before.rate)
    even = np.arange(count) / before.rate
    late = before.taken - np.arange(len(before.taken)) / before.rate
    taken = even + rng.choice(late, count)
    stamp = taken + rng.choice(before.stamp - before.taken, count)
    return replace(
        before,
        taken=taken,
        stamp=np.maximum.accumulate(stamp + np.arange(count) * 1e-9),
        noise=fresh_noise(before.noise, count, rng),
        kept=rng.choice(before.kept, count),
        twice=rng.choice(before.twice, count),
    )
