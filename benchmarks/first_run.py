"""Measure how much more processor time a first diagnosis needs than later ones, because it compiles functions.

    python benchmarks/first_run.py              # one joint, 6 s at 200 Hz
    python benchmarks/first_run.py --joints 6   # a UR10, 6 s at 1 kHz
    python benchmarks/first_run.py --functions   # also print the functions that are compiled and their times

Each run is a fresh ``phantom-dyn diagnose``; compiled functions are kept in a folder that is empty before the first
run. The goal is at most 10 s more of processor time.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.diagnosis_cost import Case, arm_of, fresh_process, write_recording
from phantom_dyn.model.loading import load_robot

GOAL_S = 10.0
SECONDS, RATE_HZ = 6.0, 200.0
SHOWN_S = 0.1  # faster functions are summed up

AXIS = """<robot name="axis"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.3"/><mass value="2"/>
<inertia ixx="0.06" ixy="0" ixz="0" iyy="0.06" iyz="0" izz="0.001"/></inertial></link>
<joint name="pin" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="50" velocity="10"/></joint></robot>"""


def axis_recording(path: Path, seconds: float = SECONDS, seed: int = 0) -> None:
    """Write a recording of a swinging rod, with friction that its model lacks, as CSV."""
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    hertz, sizes = np.array([0.3, 0.7, 1.1]), np.array([0.6, 0.25, 0.12])
    w = 2 * np.pi * hertz
    q = np.sin(np.outer(t, w)) @ sizes
    v, a = np.cos(np.outer(t, w)) @ (sizes * w), -np.sin(np.outer(t, w)) @ (sizes * w**2)
    tau = 0.24 * a + 2 * 9.81 * 0.3 * np.sin(q) + 0.4 * np.sign(v)
    tau += 0.01 * np.random.default_rng(seed).standard_normal(len(t))
    np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header="t,q.pin,tau.pin", comments="", fmt="%.9g")


def words_for(joints: int, folder: Path) -> list[str]:
    """The command; robot and recording are written into the folder."""
    log, config, out = folder / "log.csv", folder / "robot.yaml", folder / "out"
    if joints == 1:
        case = Case(str(folder / "axis.urdf"), "", SECONDS)
        Path(case.robot).write_text(AXIS)
        axis_recording(log)
    else:
        case = arm_of(joints, SECONDS)
    config.write_text(case.config)
    if joints > 1:
        write_recording(load_robot(case.robot, config=config), SECONDS, log)
    return ["diagnose", case.robot, str(log), "--robot-config", str(config), "--out", str(out)]


def compiled_functions(words: list[str]) -> None:
    """Diagnose in this fresh process and print the compiled functions, the slowest first.

    The time of a function excludes the functions that it calls.
    """
    from numba.core import event

    from identification.cli.main import main as run

    own: dict[str, float] = {}
    begun: list[list[float]] = []

    class Listener(event.Listener):
        def on_start(self, event: object) -> None:
            begun.append([time.process_time(), 0.0])

        def on_end(self, event) -> None:
            start, others = begun.pop()
            spent = time.process_time() - start
            if begun:
                begun[-1][1] += spent
            function = event.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__qualname__}"
            own[name] = own.get(name, 0.0) + spent - others

    with event.install_listener("numba:compile", Listener()), redirect_stdout(sys.stderr):
        run(words)
    for name, spent in sorted(own.items(), key=lambda item: -item[1]):
        if spent >= SHOWN_S:
            print(f"  {spent:5.2f} s  {name}")
    print(f"  {sum(own.values()):5.2f} s  all {len(own)}")


def main() -> None:
    """Measure the selected case."""
    parser = argparse.ArgumentParser(description="What a first diagnosis costs more than later ones.")
    parser.add_argument("--joints", type=int, default=1, help="1, or 2 to 7 of an arm")
    parser.add_argument("--repeats", type=int, default=1, help="pairs of runs; the least of each counts")
    parser.add_argument("--functions", action="store_true", help="once more in this process: what is compiled")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        words = words_for(given.joints, Path(name))
        first, later = [], []
        for repeat in range(given.repeats):
            os.environ["NUMBA_CACHE_DIR"] = str(Path(name) / f"compiled_{repeat}")
            for costs in (first, later):
                costs.append(fresh_process(["-m", "identification.cli", *words]).busy)
        more = min(first) - min(later)
        print(f"{given.joints} joint(s): {min(first):.1f} s of processor time at first, {min(later):.1f} s later")
        print(f"goal: at most {GOAL_S:g} s more; {more:.1f} s more: {'reached' if more <= GOAL_S else 'not reached'}")
        if given.functions:
            os.environ["NUMBA_CACHE_DIR"] = str(Path(name) / "compiled_here")
            watched = (
                "import sys; from benchmarks.first_run import compiled_functions; compiled_functions(sys.argv[1:])"
            )
            subprocess.run([sys.executable, "-c", watched, *words], check=True, cwd=Path(__file__).resolve().parents[1])


if __name__ == "__main__":
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    main()
