"""Physically consistent least squares of a six-joint arm from its triangular factor: to build and to solve."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.estimators.consistent.consistent import consistent_parameters, program_of_factor
from identification.estimators.consistent.consistent_program import Prior
from identification.regression.regressor import Regressor, torque_regressor
from identification.regression.triangular import r_factor
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.motion import Motion

SIGMA = 2.0  # noise [N m] at which constraints act


@pytest.fixture(scope="module")
def equations() -> tuple[Regressor, np.ndarray]:
    robot = load_robot("example:ur10")
    rng = np.random.default_rng(0)
    motion = Motion(np.arange(2000) * 0.01, *rng.normal(size=(3, 2000, 6)))
    tau = inverse_dynamics(robot, motion) + 0.4 * motion.v + 0.6 * np.sign(motion.v)
    noisy = tau + SIGMA * rng.normal(size=tau.shape)
    log = Log("made", robot.joint_names, motion, noisy, Band(100.0, 50.0, np.ones(1), 1), np.ones(2000, dtype=bool))
    names = ("viscous_friction", "coulomb_friction")
    regressor = torque_regressor(robot, log, [(effect_named(name), j) for j in robot.joint_names for name in names])
    rows = np.concatenate([regressor.W, regressor.y[:, :, None]], axis=2) / SIGMA
    return regressor, r_factor([rows])


def test_nearest_to_the_given_bodies(benchmark, equations):
    point = benchmark(lambda: consistent_parameters(program_of_factor(*equations), chosen_only=True))
    assert point.held_bodies


def test_with_an_entropic_prior(benchmark, equations):
    point = benchmark(lambda: consistent_parameters(program_of_factor(*equations, prior=Prior(4.0, "entropic"))))
    assert len(point.pi) == 72
