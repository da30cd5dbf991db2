"""Compare the cost of the command with its goals; each kind of work runs in a fresh process and writes its report.

    python benchmarks/cost_goals.py                     # all rows; the two hours of recording need a gigabyte of disk
    python benchmarks/cost_goals.py one-joint panda     # some rows
    python benchmarks/cost_goals.py --names             # names of the rows
    python benchmarks/cost_goals.py --folder DIR ...    # keep the recordings there for the next run

Processor seconds are measured, because other programs may run, and peak memory. One recording is diagnosed before the
first row, so that no row includes compiling. `diagnosis_cost` makes the recordings: sums of sines with friction and
rotor inertia that the model lacks, and noise; the quadruped of twelve joints trots in MuJoCo.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.diagnosis_cost import IMPORTS, POSITION_NOISE, Case, Cost, arm_of, drive_torque, fresh_process, sines
from benchmarks.first_run import AXIS, axis_recording
from benchmarks.legged.cases import write_trot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

HUMANOID = Case(
    "example:talos_data/talos_reduced", "lock: [gripper_left_joint, gripper_right_joint]\n", 30.0, rate_hz=500.0
)
TROT = "quadruped"


@dataclass(frozen=True)
class Goal:
    """One kind of work: its command, and its limits for processor seconds and megabytes."""

    name: str
    case: Case | None
    seconds: float
    megabytes: float = np.inf
    command: str = "diagnose"


ANSWERS = (
    Goal("one-joint", None, 1.2),
    Goal("three-joints", arm_of(3, 20.0), 2.2),
    Goal("six-joints-5s", arm_of(6, 5.0), 3.5),
    Goal("six-joints-60s", arm_of(6, 60.0), 6.0),
    Goal("panda", arm_of(7, 21.0), 8.0),
    Goal("humanoid", HUMANOID, 90.0),
)
"""Goals for verdict and findings alone, without report, files and next experiment."""

GOALS = (
    Goal("one-joint", None, 1.2),
    Goal("three-joints", arm_of(3, 20.0), 2.5),
    Goal("six-joints-5s", arm_of(6, 5.0), 4.0),
    Goal("six-joints-60s", arm_of(6, 60.0), 8.0, 800.0),
    Goal("panda", arm_of(7, 21.0), 8.0),
    Goal("humanoid", HUMANOID, 60.0),
    Goal(TROT, Case(TROT, "", 60.0, rate_hz=500.0), 20.0),
    *(replace(goal, command="diagnose --quick", name=f"answer-{goal.name}") for goal in ANSWERS),
    Goal("check", arm_of(6, 60.0), 1.5, command="check"),
    Goal("two-hours", arm_of(6, 7200.0), 60.0, 1500.0),
)
IMPORT_GOAL_S = 1.2
EACH, EACH_JOBS, EACH_GOAL = 100, 2, 1.9


def write_long(robot: Robot, case: Case, path: Path) -> None:
    """Write the recording of a case as NPZ; long recordings are computed in pieces of a minute."""
    piece = min(case.seconds, 60.0)
    motion = sines(robot, case.seconds, np.random.default_rng(20260101), case.rate_hz)
    count = round(piece * case.rate_hz)
    tau, sizes = np.empty_like(motion.q), None
    for start in range(0, len(motion.t), count):
        rows = slice(start, start + count)
        part = Motion(motion.t[rows], motion.q[rows], motion.v[rows], motion.a[rows])
        if sizes is None:
            sizes = np.abs(inverse_dynamics(robot, part)).max(axis=0)
        tau[rows] = drive_torque(robot, part, np.random.default_rng(start), sizes)
    q = motion.q + POSITION_NOISE * np.random.default_rng(1).standard_normal(motion.q.shape)
    columns = {"t": motion.t}
    for k, joint in enumerate(robot.joint_names):
        columns |= {f"q.{joint}": q[:, k], f"tau.{joint}": tau[:, k]}
    np.savez(path, allow_pickle=False, **columns)


def words_for(goal: Goal, folder: Path) -> list[str]:
    """Command of a row; robot and recording are written into the folder unless they exist."""
    place = folder / ("six-joints-60s" if goal.command == "check" else goal.name.removeprefix("answer-"))
    place.mkdir(exist_ok=True)
    log, config = place / ("log.npz" if goal.case else "log.csv"), place / "robot.yaml"
    options: list[str] = []
    if goal.case is None:
        robot = str(place / "axis.urdf")
        Path(robot).write_text(AXIS)
        if not log.exists():
            axis_recording(log, 10.0)
    elif goal.name == TROT:
        robot = str(place / "robot.urdf")
        if not log.exists():
            write_trot(place, goal.case.seconds, goal.case.rate_hz)
    else:
        robot = goal.case.robot
        config.write_text(goal.case.config)
        if not log.exists():
            write_long(load_robot(robot, config=config), goal.case, log)
        if goal.case.config:
            options += ["--robot-config", str(config)]
    if goal.command != "check":
        options += ["--out", str(place / "out")]
    return ["-m", "identification.cli", *goal.command.split(), robot, str(log), *options]


def each_ratio(folder: Path) -> float:
    """Wall-clock seconds of `EACH` recordings one after the other, divided by those on `EACH_JOBS` cores."""
    place = folder / "each"
    place.mkdir(exist_ok=True)
    (place / "axis.urdf").write_text(AXIS)
    for k in range(EACH):
        if not (place / f"run{k:03}.csv").exists():
            axis_recording(place / f"run{k:03}.csv", 10.0, seed=k)
    logs = sorted(str(path) for path in place.glob("run*.csv"))
    spent = []
    for jobs in (1, EACH_JOBS):
        words = ["-m", "identification.cli", "diagnose", str(place / "axis.urdf"), *logs, "--each", "--jobs", str(jobs)]
        started = time.perf_counter()
        subprocess.run(
            [sys.executable, *words, "--out", str(place / f"out{jobs}")], check=True, stdout=subprocess.DEVNULL
        )
        spent.append(time.perf_counter() - started)
        print(f"each: {EACH} recordings of one joint, {jobs} at once: {spent[-1]:.1f} s of wall clock", flush=True)
    return spent[0] / spent[1]


def row(name: str, cost: Cost, goal: Goal) -> str:
    """One row: its cost, and whether the goal is reached."""
    memory = "" if np.isinf(goal.megabytes) else f", {goal.megabytes:g} MB"
    reached = cost.busy <= goal.seconds and cost.megabytes <= goal.megabytes
    return (
        f"{name:<21} {cost.busy:6.1f} s of processor time, {cost.megabytes:5.0f} MB; "
        f"wanted {goal.seconds:g} s{memory}: " + ("reached" if reached else "not reached")
    )


def main() -> None:
    """Measure the selected rows."""
    names = [goal.name for goal in GOALS] + ["imports", "each"]
    parser = argparse.ArgumentParser(description="What the command costs, beside what it may cost.")
    parser.add_argument("rows", nargs="*", metavar="NAME", help="rows to measure (default: all)")
    parser.add_argument("--names", action="store_true", help="print the names of the rows")
    parser.add_argument("--folder", type=Path, help="where recordings are kept")
    given = parser.parse_args()
    if given.names:
        print(" ".join(names))
        return
    if unknown := set(given.rows) - set(names):
        parser.error(f"unknown rows {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    wanted = given.rows or names
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        folder.mkdir(exist_ok=True)
        fresh_process(words_for(GOALS[2], folder))
        for goal in GOALS:
            if goal.name in wanted:
                print(row(goal.name, fresh_process(words_for(goal, folder)), goal), flush=True)
        if "imports" in wanted:
            print(row("imports", fresh_process(["-c", IMPORTS]), Goal("imports", None, IMPORT_GOAL_S)), flush=True)
        if "each" in wanted:
            ratio = each_ratio(folder)
            print(
                f"each                  {ratio:.2f} times as fast on {EACH_JOBS} cores; wanted {EACH_GOAL:g}: "
                + ("reached" if ratio >= EACH_GOAL else "not reached")
            )


if __name__ == "__main__":
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    main()
