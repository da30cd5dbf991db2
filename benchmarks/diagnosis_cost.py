"""Measure time and peak memory of ``phantom-dyn diagnose`` in a fresh process, with imports.

    python benchmarks/diagnosis_cost.py              # the goal: six joints, 60 s at 1 kHz
    python benchmarks/diagnosis_cost.py --samples    # six joints, 15, 30 and 60 s
    python benchmarks/diagnosis_cost.py --joints     # two, three, six and seven joints, 15 s
    python benchmarks/diagnosis_cost.py --seconds 15 --stages    # another length, and the time of each stage

Pinocchio makes the recording: sums of sines, friction on every joint and an inertia that the model lacks, noise on
torque and position. A short recording is diagnosed first, so that no case includes compiling loops, which stay on
disk. The goal for six joints, 60 s and the full catalogue is under 8 s on two cores and
under 800 MB, with a cost that is linear in samples and at most quadratic in joints. If other programs run, processor
seconds count. A power of one in samples means linear; the cost of a process that only imports is subtracted.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

RATE_HZ = 1000.0
GOAL_SECONDS, GOAL_CORES, GOAL_MEGABYTES = 8.0, 2, 800.0
RECORDED, SHORT, WARM_UP = (15.0, 30.0, 60.0), 15.0, 5.0  # of each recording [s]
JOINTS = (2, 3, 6, 7)
IMPORTS = "import identification.cli.main, identification.pipeline, identification.reporting.page.diagnosis_report"
PANDA_CONFIG = "lock: [panda_finger_joint1, panda_finger_joint2]\n"
# Relative to the largest torque of each joint.
TORQUE_NOISE = 0.01
POSITION_NOISE = 5e-6  # noise of positions [rad]


@dataclass(frozen=True)
class Case:
    """One recording to diagnose."""

    robot: str
    config: str
    seconds: float
    rate_hz: float = RATE_HZ


@dataclass(frozen=True)
class Cost:
    """Cost of one process: seconds on the wall clock and of processor time, and peak memory."""

    seconds: float
    busy: float
    megabytes: float


UR10 = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def arm_of(joints: int, seconds: float) -> Case:
    """A UR10 whose last joints are held fixed, or all seven joints of a Panda."""
    if joints > len(UR10):
        return Case("example:panda", PANDA_CONFIG, seconds)
    held = ", ".join(f"{name}_joint" for name in UR10[joints:])
    return Case("example:ur10", f"lock: [{held}]\n" if held else "", seconds)


def sines(robot: Robot, seconds: float, rng: np.random.Generator, rate_hz: float = RATE_HZ) -> Motion:
    """Five sines for each joint between 0.1 and 1 Hz, with their derivatives."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    q, v, a = (np.zeros((len(t), robot.nv)) for _ in range(3))
    for joint in range(robot.nv):
        for hz in rng.uniform(0.1, 1.0, 5):
            w, phase = 2 * np.pi * hz, rng.uniform(0, 2 * np.pi)
            size = 0.1 / max(hz, 0.3)
            q[:, joint] += size * np.sin(w * t + phase)
            v[:, joint] += size * w * np.cos(w * t + phase)
            a[:, joint] -= size * w**2 * np.sin(w * t + phase)
    return Motion(t, q, v, a)


def drive_torque(
    robot: Robot, motion: Motion, rng: np.random.Generator, sizes: Sequence[float] | None = None
) -> np.ndarray:
    """Torque of a robot with friction and rotor inertia that the model lacks, ``(N, nv)``, with noise.

    Both are proportional to `sizes`, a torque of each joint; by default its largest torque.
    """
    operation = Operation.of(robot, motion)
    model = operation.tau
    scale = np.abs(model).max(axis=0) if sizes is None else np.asarray(sizes)
    tau = model.copy()
    for k, joint in enumerate(robot.joint_names):
        for name, theta in (("coulomb_friction", 0.1), ("viscous_friction", 0.1), ("rotor_inertia", 0.02)):
            tau -= effect_named(name).torque(robot, operation, joint, np.array([theta * scale[k]]))
    return tau + TORQUE_NOISE * scale * rng.standard_normal(tau.shape)


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
    """Seconds and peak memory of Python with these arguments in a process of its own.

    Byte code of modules is kept, as after an installation, whatever the environment says.
    """
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    kept["PYTHONPYCACHEPREFIX"] = str(Path(tempfile.gettempdir()) / f"phantom-dyn-byte-code-{os.getuid()}")
    started = time.perf_counter()
    child = subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL, env=kept)
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - started
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode != 0:
        raise SystemExit(f"python {' '.join(words)} ended with exit code {child.returncode}")
    return Cost(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


def stages(robot: Robot, log: Path) -> dict[str, float]:
    """Seconds of each stage of one diagnosis in this process, with the names of the progress line."""
    from identification.data.reading import read_recording
    from identification.pipeline import diagnose
    from identification.stages import Stage
    from identification.words.stage_words import NAMES

    marks = [(Stage.READING, time.perf_counter())]
    recording = read_recording(log, robot)
    diagnose(robot, (recording,), progress=lambda now: marks.append((now.stage, time.perf_counter())))
    marks.append((Stage.WRITING, time.perf_counter()))
    out: dict[str, float] = {}
    for (stage, start), (_, stop) in pairwise(marks):
        out[NAMES[stage]] = out.get(NAMES[stage], 0.0) + stop - start
    return out


def measure(case: Case, repeats: int, *, with_stages: bool = False) -> Cost:
    """Print the cost of one case as the median of several processes; return it with the largest memory."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config, log = folder / "robot.yaml", folder / "log.csv"
        config.write_text(case.config)
        robot = load_robot(case.robot, config=config)
        write_recording(robot, case.seconds, log)
        diagnose = ["-m", "identification.cli", "diagnose", case.robot, str(log), "--robot-config", str(config)]
        costs = [fresh_process([*diagnose, "--out", str(folder / "out")]) for _ in range(repeats)]
        cost = Cost(
            statistics.median(c.seconds for c in costs),
            statistics.median(c.busy for c in costs),
            max(c.megabytes for c in costs),
        )
        print(
            f"{case.robot:<14} {robot.nv} joints {case.seconds:4g} s at {RATE_HZ:g} Hz: {cost.seconds:6.1f} s, "
            f"{cost.busy:6.1f} s of processor time, {cost.megabytes:5.0f} MB",
            flush=True,
        )
        if with_stages:
            for stage, spent in stages(robot, log).items():
                print(f"  {spent:6.2f} s  {stage}")
    return cost


def beside_goal(cost: Cost) -> str:
    """The goal, and whether it is reached."""
    yes = {True: "reached", False: "not reached"}
    return (
        f"goal: under {GOAL_SECONDS:g} s on {GOAL_CORES} cores and under {GOAL_MEGABYTES:g} MB; "
        f"{cost.seconds:.1f} s: {yes[cost.seconds < GOAL_SECONDS]}, "
        f"{cost.busy:.1f} s of processor time on one core: {yes[cost.busy < GOAL_SECONDS]}, "
        f"{cost.megabytes:.0f} MB: {yes[cost.megabytes < GOAL_MEGABYTES]}"
    )


def power(sizes: Sequence[float], costs: Sequence[Cost], idle: float) -> float:
    """Power of the size with which processor seconds grow: the slope of a line through both logarithms."""
    busy = [max(cost.busy - idle, 1e-9) for cost in costs]
    return float(np.polyfit(np.log(sizes), np.log(busy), 1)[0])


def main() -> None:
    """Measure the selected cases."""
    parser = argparse.ArgumentParser(description="What a diagnosis costs.")
    parser.add_argument("--samples", action="store_true", help="six joints, 15, 30 and 60 s")
    parser.add_argument("--joints", action="store_true", help="two, three, six and seven joints, 15 s")
    parser.add_argument("--seconds", type=float, default=RECORDED[-1], help="recorded, without the two above")
    parser.add_argument("--stages", action="store_true", help="once more in this process: where the time goes")
    parser.add_argument("--repeats", type=int, default=1, help="fresh processes a case; the median counts")
    given = parser.parse_args()
    print("before:", end=" ")
    measure(arm_of(6, WARM_UP), 1)
    idle = fresh_process(["-c", IMPORTS]).busy if given.samples or given.joints else 0.0
    if given.samples:
        costs = [measure(arm_of(6, seconds), given.repeats) for seconds in RECORDED]
        print(f"processor seconds beyond {idle:.1f} s of imports go with samples^{power(RECORDED, costs, idle):.2f}")
        print(beside_goal(costs[-1]))
    if given.joints:
        costs = [measure(arm_of(joints, SHORT), given.repeats) for joints in JOINTS]
        print(f"processor seconds beyond {idle:.1f} s of imports go with joints^{power(JOINTS, costs, idle):.2f}")
    if not (given.samples or given.joints):
        cost = measure(arm_of(6, given.seconds), given.repeats, with_stages=given.stages)
        if given.seconds == RECORDED[-1]:
            print(beside_goal(cost))


if __name__ == "__main__":
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    main()
