"""Time eight recordings of a pendulum that are diagnosed separately, and a map, by the number of processes or threads.

There are eight only if timing is on (``make bench``); the test suite uses one. The first round of two processes starts
them, which takes as long as importing the libraries, and does not count.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joblib import parallel_config

from benchmarks.diagnosis_cost import drive_torque, sines
from identification.batch.diagnose_each import diagnose_each
from phantom_dyn import load_robot
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.operational_map import operational_map

PENDULUM = Path(__file__).parents[1] / "tests" / "robots" / "pendulum.urdf"


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> list[Path]:
    folder, robot = tmp_path_factory.mktemp("logs"), load_robot(PENDULUM)
    out = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        motion = sines(robot, 8.0, rng)
        rows = np.column_stack([motion.t, motion.q, drive_torque(robot, motion, rng)])
        out.append(folder / f"run{seed}.csv")
        np.savetxt(out[-1], rows, "%.9g", ",", header="t,q.pin,tau.pin", comments="")
    return out


@pytest.mark.parametrize("jobs", [1, 2])
def test_each_of_eight_recordings(benchmark, logs, jobs):
    given = logs[:1] if benchmark.disabled else logs
    found = benchmark.pedantic(
        diagnose_each,
        (load_robot(PENDULUM), given),
        {"jobs": jobs},
        rounds=3,
        warmup_rounds=0 if benchmark.disabled else 1,
    )
    assert not found.refused


@pytest.mark.parametrize("backend", ["loky", "threading"])
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_map_in_processes_and_threads(benchmark, backend, jobs):
    count = 10 if benchmark.disabled else 70
    model = map_model(load_robot("phantom_1_5"))
    grid = read_grid(",".join(f"{axis}=-0.15:0.15:{count}" for axis in "xyz"), model.joint_names)

    def run():
        with parallel_config(backend=backend):
            return operational_map(model, grid, ("manipulability", "apparent_mass_matrix"), jobs=jobs)

    found = benchmark.pedantic(run, rounds=3, warmup_rounds=0 if benchmark.disabled else 1)
    assert found.grid.size == count**3
