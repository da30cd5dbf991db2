"""Time regressor, base parameters and fits of a six-joint arm: 2500 samples, 20 s at 1 kHz in a band of 50 Hz."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.signals import low_pass
from identification.estimators.weighted_least_squares import ols, wls
from identification.regression.base_parameters import base_parameters
from identification.regression.regressor import Regressor, torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


@pytest.fixture(scope="module")
def ur10() -> Robot:
    return load_robot("example:ur10")


def some_log(robot: Robot, samples: int) -> Log:
    rng = np.random.default_rng(0)
    motion = Motion(np.arange(samples) * 1e-3, *rng.normal(size=(3, samples, robot.nv)))
    tau = inverse_dynamics(robot, motion) + rng.normal(size=motion.q.shape)
    return Log("made", robot.joint_names, motion, tau, low_pass(50.0, 1000.0), np.ones(samples, dtype=bool))


def equations(robot: Robot, samples: int) -> Regressor:
    names = ("viscous_friction", "coulomb_friction", "torque_offset")
    effects = [(effect_named(name), joint) for joint in robot.joint_names for name in names]
    return torque_regressor(robot, some_log(robot, samples), effects)


@pytest.fixture(scope="module")
def ready(ur10: Robot) -> Regressor:
    regressor = equations(ur10, 20_000)
    assert regressor.W.shape[1:] == (6, 78)
    assert regressor.y.shape[1] == 6
    return regressor


def test_making_the_regressor_of_1000_samples(benchmark, ur10):
    assert benchmark(lambda: equations(ur10, 1000).W).shape[1:] == (6, 78)


def test_base_parameters(benchmark, ready):
    assert benchmark(base_parameters, ready).rank == 54


def test_ordinary_least_squares(benchmark, ready):
    assert benchmark(ols, ready).rank == 54


def test_weighted_least_squares(benchmark, ready):
    assert benchmark(wls, ready).rank == 54
