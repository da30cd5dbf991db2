"""What a diagnosis costs: seconds, imports included, and peak memory of ``phantom-dyn diagnose`` in a fresh process.

    python benchmarks/diagnosis_cost.py                # six joints, 20 s at 1 kHz
    python benchmarks/diagnosis_cost.py --all          # 60 s too, and seven joints

The recording is made with Pinocchio: sums of sines, friction on every joint and an inertia that the model does not
have, noise on torque and position. The goal for six joints and 20 s is 20 s and 1.5 GB on two cores.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.loading import load_robot
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

RATE_HZ = 1000.0
REPEATS = 3
PANDA_CONFIG = "lock: [panda_finger_joint1, panda_finger_joint2]\n"
# Relative to the greatest torque of each joint.
TORQUE_NOISE = 0.01
POSITION_NOISE = 5e-6  # rad


@dataclass(frozen=True)
class Case:
    """One recording to diagnose."""

    robot: str
    config: str
    seconds: float


@dataclass(frozen=True)
class Cost:
    """Of one fresh process: seconds on the wall clock and of processor time, and peak memory."""

    seconds: float
    busy: float
    megabytes: float


SIX_JOINTS = Case("example:ur10", "", 20.0)
CASES = (SIX_JOINTS, Case("example:ur10", "", 60.0), Case("example:panda", PANDA_CONFIG, 20.0))


def sines(robot: Robot, seconds: float, rng: np.random.Generator) -> Motion:
    """Five sines a joint between 0.1 and 1 Hz, with their derivatives."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    q, v, a = (np.zeros((len(t), robot.nv)) for _ in range(3))
    for joint in range(robot.nv):
        for hz in rng.uniform(0.1, 1.0, 5):
            w, phase = 2 * np.pi * hz, rng.uniform(0, 2 * np.pi)
            size = 0.1 / max(hz, 0.3)
            q[:, joint] += size * np.sin(w * t + phase)
            v[:, joint] += size * w * np.cos(w * t + phase)
            a[:, joint] -= size * w**2 * np.sin(w * t + phase)
    return Motion(t, q, v, a)


def drive_torque(robot: Robot, motion: Motion, rng: np.random.Generator) -> np.ndarray:
    """Torque of a robot with friction and rotor inertia that the model lacks, ``(N, nv)``, with noise."""
    operation = Operation.of(robot, motion)
    model = operation.tau
    tau = model.copy()
    for k, joint in enumerate(robot.joint_names):
        scale = float(np.abs(model[:, k]).max())
        for name, theta in (("coulomb_friction", 0.1), ("viscous_friction", 0.1), ("rotor_inertia", 0.02)):
            tau -= effect_named(name).torque(robot, operation, joint, np.array([theta * scale]))
    return tau + TORQUE_NOISE * np.abs(model).max(axis=0) * rng.standard_normal(tau.shape)


def write_recording(robot: Robot, seconds: float, path: Path) -> None:
    """Make one recording and write it as CSV."""
    rng = np.random.default_rng(20260101)
    motion = sines(robot, seconds, rng)
    tau = drive_torque(robot, motion, rng)
    q = motion.q + POSITION_NOISE * rng.standard_normal(motion.q.shape)
    head = ["t", *(f"q.{joint}" for joint in robot.joint_names), *(f"tau.{joint}" for joint in robot.joint_names)]
    rows = np.column_stack([motion.t, q, tau])
    np.savetxt(path, rows, delimiter=",", header=",".join(head), comments="", fmt="%.9g")


def fresh_process(words: list[str]) -> Cost:
    """Seconds and peak memory of the command in a process of its own."""
    started = time.perf_counter()
    child = subprocess.Popen([sys.executable, "-m", "identification.cli", *words], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - started
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode != 0:
        raise SystemExit(f"phantom-dyn {' '.join(words)} ended with exit code {child.returncode}")
    return Cost(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


def stages(robot: Robot, log: Path) -> dict[str, float]:
    """Seconds of each stage of one diagnosis in this process, under the words that the progress line shows."""
    from identification.diagnosis.diagnose import diagnose
    from identification.recordings import read_recording

    marks = [("reading", time.perf_counter())]
    recording = read_recording(log, robot)
    diagnose(robot, (recording,), progress=lambda words: marks.append((words, time.perf_counter())))
    marks.append(("", time.perf_counter()))
    out: dict[str, float] = {}
    for (words, start), (_, stop) in pairwise(marks):
        stage = words.partition(",")[0]
        out[stage] = out.get(stage, 0.0) + stop - start
    return out


def measure(case: Case, repeats: int) -> None:
    """Print the cost of one case."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config, log = folder / "robot.yaml", folder / "log.csv"
        config.write_text(case.config)
        robot = load_robot(case.robot, config=config)
        write_recording(robot, case.seconds, log)
        words = ["diagnose", case.robot, str(log), "--robot-config", str(config), "--out", str(folder / "out")]
        costs = [fresh_process(words) for _ in range(repeats)]
        seconds, busy = statistics.median(c.seconds for c in costs), statistics.median(c.busy for c in costs)
        print(
            f"{case.robot}, {robot.nv} joints, {case.seconds:g} s at {RATE_HZ:g} Hz: {seconds:.1f} s "
            f"({busy:.1f} s of processor time), {max(c.megabytes for c in costs):.0f} MB"
        )
        for stage, spent in stages(robot, log).items():
            print(f"  {spent:6.2f} s  {stage}")


def main() -> None:
    """Measure what the arguments ask for."""
    parser = argparse.ArgumentParser(description="What a diagnosis costs.")
    parser.add_argument("--all", action="store_true", help="60 s and seven joints too")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="fresh processes a case; the median counts")
    arguments = parser.parse_args()
    for case in CASES if arguments.all else (SIX_JOINTS,):
        measure(case, arguments.repeats)


if __name__ == "__main__":
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    main()
