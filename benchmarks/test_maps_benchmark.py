# pyright: reportAttributeAccessIssue=false
"""Time maps of the PHANToM: a million configurations in seconds and megabytes, and 1000 with a loop over Pinocchio.

A million is computed only if timing is on (``make bench``); the test suite computes a hundredth of it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
from unittest.mock import patch

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn import load_robot
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.operational_map import operational_map
from phantom_dyn.maps.quantities import felt_at

SAMPLES = 1000
NAMES = ("manipulability", "apparent_mass", "apparent_mass_matrix", "viscous_friction", "gravity_force")

# A process of its own, so that the memory is that of the map alone; of the workers the largest one counts.
ALONE = """
import json, resource, sys, time
from phantom_dyn import load_robot
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.operational_map import operational_map
text, names, jobs = sys.argv[1], sys.argv[2].split(","), int(sys.argv[3])
model = map_model(load_robot("phantom_1_5"))
begin = time.perf_counter()
result = operational_map(model, read_grid(text, model.joint_names), names, jobs=jobs)
seconds = time.perf_counter() - begin
from joblib.externals.loky import get_reusable_executor
if jobs > 1:
    get_reusable_executor().shutdown(wait=True)
peak = [resource.getrusage(who).ru_maxrss / 1e3 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print(json.dumps({"points": result.grid.size, "seconds": seconds, "megabytes": peak[0] + jobs * peak[1]}))
"""


@pytest.fixture(scope="module")
def model():
    return map_model(load_robot("phantom_1_5"))


@pytest.fixture(scope="module")
def configurations() -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.7, 0.7, (SAMPLES, 3))


@pytest.mark.whole
@pytest.mark.parametrize("axes", ["q.theta1,q.theta2,q.theta3", "x,y,z"], ids=["joints", "tip"])
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_million_configurations(benchmark, axes, jobs):
    count = 22 if benchmark.disabled else 100
    grid = ",".join(f"{axis}=-0.15:0.15:{count}" for axis in axes.split(","))
    words = ["-c", grid, ",".join(NAMES), str(jobs)]

    def run():
        if benchmark.disabled:  # in this process, because its memory does not matter
            with patch.object(sys, "argv", words), redirect_stdout(StringIO()) as printed:
                exec(ALONE, {})
            return json.loads(printed.getvalue())
        command = [sys.executable, "-c", ALONE, *words[1:]]
        return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    found = benchmark.pedantic(run, rounds=1, iterations=1)
    benchmark.extra_info.update(found)
    assert found["points"] == count**3


def test_the_quantities(benchmark, model, configurations):
    values, _ = benchmark(felt_at, model, configurations, NAMES)
    assert values["apparent_mass_matrix"].shape == (SAMPLES, 3, 3)


def test_jacobian_mass_matrix_and_weight_of_bare_pinocchio(benchmark, configurations):
    robot = load_robot("phantom_1_5")
    data, frame = robot.model.createData(), robot.model.getFrameId("tip")

    def loop():
        for q in robot.configuration(configurations):
            pin.computeFrameJacobian(robot.model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
            pin.crba(robot.model, data, q)
            pin.computeGeneralizedGravity(robot.model, data, q)
        return data.M

    assert benchmark(loop).shape == (5, 5)


def test_branches_by_newton(benchmark, model):
    # Cost per point of a three-joint robot without a closed form.
    from dataclasses import replace

    searching = replace(model, branches=None)
    grid = read_grid("x=-0.1:0.1:10,y=-0.1:0.1:10,z=-0.1:0.1:10", model.joint_names)
    found = benchmark.pedantic(operational_map, (searching, grid, NAMES[:1]), {"jobs": 1}, rounds=2, iterations=1)
    assert found.unreachable == operational_map(model, grid, NAMES[:1], jobs=1).unreachable
