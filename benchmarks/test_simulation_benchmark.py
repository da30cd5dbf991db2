"""Time compiled simulations with stiction, bristle, backlash and delay in steps per second, also with two threads.

As a script it prints a table with the goals and returns 1 if one is missed:
``python -m benchmarks.test_simulation_benchmark``. Times are processor time, the best of several runs, so that other
programs change them little; times of two threads are wall-clock time.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.control import torque_over_time
from phantom_dyn.simulation.simulate import Cause, Simulation, simulate

ROBOTS = Path(__file__).resolve().parents[1] / "tests" / "robots"
STEP, SAMPLE = 1e-5, 1e-3
# Goals in steps per second.
GOALS = {"two-mass axis": 20e6, "three-joint arm": 1e6}
SECONDS = {"two-mass axis": 20.0, "three-joint arm": 2.0}
REPEATS = 7


def robot_of(name: str) -> Robot:
    """A pendulum or an arm of two hinges and a slide, with rotors; the torque is held between samples."""
    robot = load_robot(ROBOTS / ("pendulum.urdf" if name == "two-mass axis" else "arm3.urdf"))
    model = robot.model.copy()
    model.armature = np.full(robot.nv, 0.1)
    return replace(robot, model=model, torque_hold="zoh")


def causes_of(robot: Robot) -> tuple[Cause, ...]:
    """Stiction, a bristle and backlash on the first joint, and a delayed drive."""
    first = robot.joint_names[0]
    late = None if robot.nv > 1 else first
    laws = (("coulomb_friction", first, [0.1]), ("presliding_friction", first, [0.2, 0.01]),
            ("backlash", first, [0.02]), ("input_delay", late, [0.004]))  # fmt: skip
    return tuple(Cause(effect_named(name), joint, np.array(theta)) for name, joint, theta in laws)


def simulation_of(name: str, seconds: float) -> tuple[Callable[[], Simulation], int]:
    """One simulation as a function, and its number of steps."""
    robot = robot_of(name)
    t = np.arange(0.0, seconds, SAMPLE)
    push = torque_over_time(t, 2.0 * np.sin(np.outer(t, 7.0 + np.arange(robot.nv))))
    causes, start = causes_of(robot), np.zeros(robot.nv)
    return lambda: simulate(robot, causes, push, t, start, max_step=STEP), (len(t) - 1) * round(SAMPLE / STEP)


def best(run: Callable[[], object], clock: Callable[[], float]) -> float:
    """Shortest time [s] of several runs."""
    times = []
    for _ in range(REPEATS):
        start = clock()
        run()
        times.append(clock() - start)
    return min(times)


def thread_ratio(name: str) -> float:
    """Time of two simulations in two threads divided by their time one after the other."""
    run, _ = simulation_of(name, SECONDS[name])
    with ThreadPoolExecutor(2) as threads:
        both = best(lambda: [future.result() for future in [threads.submit(run), threads.submit(run)]], time.monotonic)
        return both / best(lambda: (run(), run()), time.monotonic)


@pytest.mark.parametrize("name", GOALS)
def test_a_simulation_with_effects_that_have_a_memory(benchmark, name):
    simulation_of(name, 0.01)[0]()  # compile before timing
    run, steps = simulation_of(name, 1.0 if benchmark.enabled else 0.02)
    s = benchmark(run)
    if benchmark.stats:
        benchmark.extra_info["million_steps_per_second"] = steps / benchmark.stats.stats.min / 1e6
    assert np.isfinite(s.q).all()


def main() -> int:
    """Print the table; return 1 if a goal is missed."""
    missed = False
    for name, goal in GOALS.items():
        simulation_of(name, 0.01)[0]()
        run, steps = simulation_of(name, SECONDS[name])
        speed = steps / best(run, time.thread_time)
        ratio = thread_ratio(name)
        said = "reached" if speed >= goal else "missed"
        missed = missed or speed < goal
        print(
            f"{name}: {speed / 1e6:.2f} million steps/s, goal {goal / 1e6:g}: {said}; "
            f"two threads take {ratio:.2f} of the time of one after the other"
        )
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
