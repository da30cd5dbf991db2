"""Time the design of a 10 s motion of a six-joint arm, and compare it with the best of 200 random feasible motions.

``python benchmarks/test_excitation_benchmark.py`` prints both condition numbers and the seconds of the design.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pytest

from identification.excitation.collisions import collisions_of
from identification.excitation.criteria import ConditionNumber
from identification.excitation.descent import feasible_postures, random_motion
from identification.excitation.design_problem import DesignProblem, Grid, base_of
from identification.excitation.excite import condition_of, excite
from identification.excitation.limits import Limits, limits_of
from identification.excitation.motion_shapes import BSplines, FourierSeries, TrianglesAndSines
from phantom_dyn import load_robot
from phantom_dyn.model.robot import Robot

RANDOM = 200
FEW = 20
"""Number of random motions if nothing is measured: this takes seconds less."""
RATIO = 1.3


@dataclass(frozen=True)
class Arm:
    robot: Robot
    limits: Limits


def ur10() -> Arm:
    robot = load_robot("example:ur10")
    return Arm(robot, limits_of(robot, collisions=collisions_of(robot)))


@pytest.fixture(scope="module")
def arm() -> Arm:
    return ur10()


def best_random(arm: Arm, shapes: FourierSeries, seed: int, count: int) -> float:
    """Condition number of the best of many random motions, each as large as the limits allow."""
    problem = DesignProblem(arm.robot, base_of(arm.robot, planned=1001.0), ConditionNumber(), arm.limits)
    grid, rng = Grid.of(shapes, shapes.samples), np.random.default_rng(seed)
    postures = feasible_postures(problem, rng)
    drawn = (random_motion(problem, grid, postures[rng.integers(len(postures))], rng) for _ in range(count))
    return min(condition_of(problem, grid, weights) for weights in drawn)


@pytest.mark.whole
def test_it_is_no_worse_than_the_best_of_many_random_motions(benchmark, arm):
    shapes = FourierSeries(10.0, 5)
    design = benchmark.pedantic(lambda: excite(arm.robot, shapes, limits=arm.limits), rounds=1)
    best = best_random(arm, shapes, seed=1, count=FEW if benchmark.disabled else RANDOM)
    benchmark.extra_info.update(condition=design.condition, best_random=best)
    assert design.condition <= RATIO * best


@pytest.mark.whole
@pytest.mark.parametrize(
    ("shapes", "short"),
    [
        (BSplines(10.0, 10), BSplines(4.0, 6)),
        (TrianglesAndSines(10.0, harmonics=5), TrianglesAndSines(4.0, 2, 3)),
    ],
    ids=["splines", "triangles"],
)
def test_other_families(benchmark, arm, shapes, short):
    shapes = short if benchmark.disabled else shapes  # takes seconds less if nothing is measured
    design = benchmark.pedantic(lambda: excite(arm.robot, shapes, limits=arm.limits), rounds=1)
    benchmark.extra_info.update(condition=design.condition)
    assert design.condition < design.start


def main() -> None:
    arm, shapes = ur10(), FourierSeries(10.0, 5)
    started = time.perf_counter()
    design = excite(arm.robot, shapes, limits=arm.limits)
    spent = time.perf_counter() - started
    best = best_random(arm, shapes, seed=1, count=RANDOM)
    print(f"condition number {design.condition:.2f} in {spent:.1f} s; best of {RANDOM} random motions: {best:.2f}")


if __name__ == "__main__":
    main()
