# pyright: reportAttributeAccessIssue=false
"""Time rigid-body quantities of a six-joint arm: compiled, with a loop over Pinocchio, and only writing the result.

Each group is one quantity: `pytest --benchmark-enable` shows them. `core_speed` compares the regressor's ratios with
their goals.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from benchmarks import pinocchio_loops
from phantom_dyn import load_robot
from phantom_dyn._kernels import rigid_body
from phantom_dyn.dynamics.dynamics import inverse_dynamics, mass_matrix, rigid_body_regressor
from phantom_dyn.dynamics.kinematics import frame_jacobian
from phantom_dyn.loops.solver import solve
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

ROBOTS = Path(__file__).resolve().parents[1] / "tests" / "robots"
SAMPLES = 15000
"""As many as in a minute of recording: the regressor of 43 MB does not fit into a cache."""


@pytest.fixture(scope="module")
def ur10() -> Robot:
    return load_robot("example:ur10")


@pytest.fixture(scope="module")
def motion(ur10) -> Motion:
    return Motion(np.arange(SAMPLES) * 1e-3, *np.random.default_rng(0).normal(size=(3, SAMPLES, ur10.nv)))


def written(*shape: int) -> np.ndarray:
    out = np.empty((SAMPLES, *shape))
    out[...] = 1.0
    return out


@pytest.mark.benchmark(group="regressor")
def test_regressor(benchmark, ur10, motion):
    assert benchmark(rigid_body_regressor, ur10, motion).shape == (SAMPLES, 6, 60)


@pytest.mark.benchmark(group="regressor")
def test_regressor_in_memory_that_is_used_again(benchmark, ur10, motion):
    out, block = np.zeros((1000, 6, 60)), (motion.q[:1000], motion.v[:1000], motion.a[:1000])

    def blocks():
        for _ in range(SAMPLES // 1000):
            rigid_body.regressor(ur10.model, ur10.arrays, *block, out=out)
        return out

    assert benchmark(blocks).shape == (1000, 6, 60)


@pytest.mark.benchmark(group="regressor")
def test_a_third_of_the_columns_of_the_regressor(benchmark, ur10, motion):
    columns = tuple(range(40, 60))
    assert benchmark(rigid_body_regressor, ur10, motion, columns=columns).shape == (SAMPLES, 6, 20)


@pytest.mark.benchmark(group="regressor")
def test_regressor_of_bare_pinocchio(benchmark, ur10, motion):
    found = benchmark.pedantic(pinocchio_loops.regressor, (ur10.model, motion.q, motion.v, motion.a), rounds=3)
    assert found.shape == (SAMPLES, 6, 60)


@pytest.mark.benchmark(group="regressor")
def test_writing_the_regressor(benchmark):
    assert benchmark(written, 6, 60).shape == (SAMPLES, 6, 60)


@pytest.mark.benchmark(group="inverse dynamics")
def test_inverse_dynamics(benchmark, ur10, motion):
    assert benchmark(inverse_dynamics, ur10, motion).shape == (SAMPLES, 6)


@pytest.mark.benchmark(group="inverse dynamics")
def test_inverse_dynamics_of_bare_pinocchio(benchmark, ur10, motion):
    found = benchmark.pedantic(pinocchio_loops.torque, (ur10.model, motion.q, motion.v, motion.a), rounds=3)
    assert found.shape == (SAMPLES, 6)


@pytest.mark.benchmark(group="inverse dynamics")
def test_inverse_dynamics_of_pinocchios_own_batch(benchmark, ur10, motion):
    pool = pin.ModelPool(ur10.model, 1)
    columns = [np.asfortranarray(x.T) for x in (motion.q, motion.v, motion.a)]
    assert benchmark(pin.rneaInParallel, 1, pool, *columns).shape == (6, SAMPLES)


@pytest.mark.benchmark(group="mass matrix")
def test_mass_matrix(benchmark, ur10, motion):
    assert benchmark(mass_matrix, ur10, motion.q).shape == (SAMPLES, 6, 6)


@pytest.mark.benchmark(group="mass matrix")
def test_mass_matrix_of_bare_pinocchio(benchmark, ur10, motion):
    assert benchmark.pedantic(pinocchio_loops.mass, (ur10.model, motion.q), rounds=3).shape == (SAMPLES, 6, 6)


@pytest.mark.benchmark(group="mass matrix")
def test_writing_the_mass_matrix(benchmark):
    assert benchmark(written, 6, 6).shape == (SAMPLES, 6, 6)


@pytest.mark.benchmark(group="Jacobian")
def test_jacobian(benchmark, ur10, motion):
    assert benchmark(frame_jacobian, ur10, motion.q, "tool0", "hybrid").shape == (SAMPLES, 6, 6)


@pytest.mark.benchmark(group="Jacobian")
def test_jacobian_of_bare_pinocchio(benchmark, ur10, motion):
    frame = ur10.model.getFrameId("tool0")
    found = benchmark.pedantic(pinocchio_loops.frame_jacobian, (ur10.model, motion.q, frame, False), rounds=3)
    assert found.shape == (SAMPLES, 6, 6)


@pytest.mark.benchmark(group="Jacobian")
def test_writing_the_jacobian(benchmark):
    assert benchmark(written, 6, 6).shape == (SAMPLES, 6, 6)


CHAIN_SAMPLES = 500
"""Samples of a trajectory whose loop is closed sample by sample."""


@pytest.fixture
def fourbar(tmp_path) -> Robot:
    config = tmp_path / "loop.yaml"
    config.write_text("loops: [{kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [crank]}]")
    return load_robot(ROBOTS / "fourbar.urdf", config=config)


@pytest.mark.benchmark(group="closing a loop")
def test_closing_a_loop(benchmark, fourbar):
    q, arrays = np.linspace(0.0, 6.0, CHAIN_SAMPLES)[:, None], fourbar.arrays
    solve(fourbar.model, fourbar.chain, q[:2], arrays=arrays)  # compiles
    found = benchmark.pedantic(solve, (fourbar.model, fourbar.chain, q), {"arrays": arrays}, rounds=3)
    assert found.G.shape == (CHAIN_SAMPLES, 3, 1)
