"""Time physically consistent least squares of a six-joint arm with random equations."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.estimators.consistent.consistent import consistent
from identification.regression.regressor import Regressor, torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.motion import Motion

SIGMA = 2.0  # noise [N m] at which constraints are active


@pytest.fixture(scope="module")
def equations() -> Regressor:
    robot = load_robot("example:ur10")
    rng = np.random.default_rng(0)
    motion = Motion(np.arange(2000) * 0.01, *rng.normal(size=(3, 2000, 6)))
    tau = inverse_dynamics(robot, motion) + 0.4 * motion.v + 0.6 * np.sign(motion.v)
    noisy = tau + SIGMA * rng.normal(size=tau.shape)
    log = Log("made", robot.joint_names, motion, noisy, Band(100.0, 50.0, np.ones(1), 1), np.ones(2000, dtype=bool))
    names = ("viscous_friction", "coulomb_friction")
    return torque_regressor(robot, log, [(effect_named(name), j) for j in robot.joint_names for name in names])


def test_nearest_to_the_given_bodies(benchmark, equations):
    assert benchmark(lambda: consistent(equations)).held
