"""Run this library's side of a comparison in a process of its own, and print seconds and memory as JSON.

own_worker.py fit ROBOT RECORDING.npz [EFFECT,...]    file to base parameters, least squares, deviations
own_worker.py arm ROBOT RECORDING.npz FIELD...        armature and damping beyond those of the given model
own_worker.py stream ROBOT SAMPLES                    as many samples, in recordings of which one is held at a time
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from identification.data.log import Band, Log
from identification.data.reading import read_recording
from identification.data.signals import process
from identification.estimators.fit import refit
from identification.estimators.weighted_least_squares import ols
from identification.regression.reduction import combined
from identification.regression.regressor import EffectOnJoint, gap_regressor, torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

FEW = 200
"""Samples of a first run that is not timed, so that late imports and compiling do not count."""

CHUNK = 50_000
NOISE = 0.1  # standard deviation of the torque noise [N m]


def memory_mb(field: str) -> float:
    """VmRSS (now) or VmHWM (largest so far) of this process [MB]; unlike in rusage, without the parent's."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(field))


def log_of(robot: Robot, motion: Motion, tau: np.ndarray) -> Log:
    """Samples without a filter."""
    rate = 1.0 / float(motion.t[1] - motion.t[0])
    band = Band(rate, rate / 2, np.ones(1), 1)
    return Log("recording", robot.joint_names, motion, tau, band, np.ones(len(tau), dtype=bool))


def read(robot: Robot, path: str, few: int | None = None) -> Log:
    """A recording with derivatives."""
    arrays = np.load(path)
    motion = Motion(*(arrays[name][:few] for name in ("t", "q", "v", "a")))
    return log_of(robot, motion, arrays["tau"][:few])


def terms(robot: Robot, names: str) -> list[EffectOnJoint]:
    """Columns of each effect on every joint."""
    return [(effect_named(name), joint) for name in filter(None, names.split(",")) for joint in robot.joint_names]


def fit(robot: Robot, path: str, effects: str = "") -> dict[str, float]:
    """From the file to base parameters by `ols`, and by reduction alone, whose deviations assume white noise."""
    given = terms(robot, effects)
    some = read(robot, path, FEW)
    ols(torque_regressor(robot, some, given))
    refit(torque_regressor(robot, some, given).reduction)
    bare = memory_mb("VmRSS")
    start = time.process_time()
    log = read(robot, path)
    found = ols(torque_regressor(robot, log, given))
    middle = time.process_time()
    peak = memory_mb("VmHWM")
    again = refit(torque_regressor(robot, read(robot, path), given).reduction)
    end = time.process_time()
    rms = float(np.sqrt(np.mean((log.tau - found.predict(robot, log.motion)) ** 2)))
    return {
        "seconds": middle - start,
        "reduced": end - middle,
        "rank": found.rank,
        "rms": rms,
        "reduced_gap": float(np.max(np.abs(again.theta - found.theta) / found.std())),
        "peak_mb": peak,
        "bare_mb": bare,
    }


def from_start_of_step(log: Log, h: float) -> Log:
    """The recording with the speeds at the start of a simulator's steps of ``h`` seconds."""
    motion = log.motion
    return replace(log, motion=replace(motion, v=motion.v - 0.5 * h * motion.a))


def arm(robot: Robot, path: str, *fields: str) -> dict[str, Any]:
    """Armature, or armature and damping, of every joint, from positions and torques; derivatives are computed.

    A step ``h`` of MuJoCo, implicit in the damping, starts from the speed half a step before that of the positions at
    this time, ``v - h / 2 * a``, and damps the speed at its end, which is larger by ``h * a``. The fit gets the first
    speed, so its coefficient of the acceleration is ``armature + h * damping``; the second part is subtracted.
    """
    effects = {"armature": ("rotor_inertia", "inertia"), "damping": ("viscous_friction", "coefficient")}
    stated = {"armature": robot.rotor_inertia, "damping": robot.viscous_friction}
    given, recording = terms(robot, ",".join(effects[f][0] for f in fields)), read_recording(path, robot)
    h = float(np.median(np.diff(recording.t)))
    # The first run is not timed, so that late imports and compiling do not count.
    ols(gap_regressor(robot, from_start_of_step(process(recording, robot), h), given))
    start = time.process_time()
    found = ols(gap_regressor(robot, from_start_of_step(process(recording, robot), h), given))
    added = dict(zip(found.names, found.theta.tolist(), strict=True))
    whole = {
        f: stated[f] + [added.get(f"{joint}.{'.'.join(effects[f])}", 0.0) for joint in robot.joint_names]
        for f in effects
    }
    whole["armature"] = whole["armature"] - h * whole["damping"]
    seconds = time.process_time() - start
    values = {f"{f}.{joint}": float(whole[f][k]) for f in fields for k, joint in enumerate(robot.joint_names)}
    return {"values": values, "seconds": seconds}


def drawn(robot: Robot, samples: int) -> Iterator[Log]:
    """Recordings of `CHUNK` samples, made one by one."""
    rng = np.random.default_rng(0)
    for start in range(0, samples, CHUNK):
        count = min(CHUNK, samples - start)
        motion = Motion(np.arange(count) * 1e-3, *rng.normal(size=(3, count, robot.nv)))
        yield log_of(robot, motion, inverse_dynamics(robot, motion) + NOISE * rng.normal(size=(count, robot.nv)))


def stream(robot: Robot, samples: str) -> dict[str, float]:
    """Reduction of many samples and the fit of all; making the samples is not timed."""
    for log in drawn(robot, FEW):
        refit(torque_regressor(robot, log).reduction)
    seconds, total = 0.0, None
    for log in drawn(robot, int(samples)):
        start = time.process_time()
        one = torque_regressor(robot, log).reduction
        total = one if total is None else combined([total, one])
        seconds += time.process_time() - start
    assert total is not None
    start = time.process_time()
    found = refit(total)
    again = time.process_time() - start
    peak, rank = memory_mb("VmHWM"), len(found.theta)
    return {"seconds": seconds + again, "refit": again, "peak_mb": peak, "rank": rank, "samples": found.samples}


def main(what: str, robot: str, *words: str) -> None:
    print(json.dumps({"fit": fit, "arm": arm, "stream": stream}[what](load_robot(robot), *words)))


if __name__ == "__main__":
    main(*sys.argv[1:])
