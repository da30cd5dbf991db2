# pyright: reportAttributeAccessIssue=false
"""Inverse dynamics and regressor of 1000 samples of a six-joint arm, against a bare loop over Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn import load_robot
from phantom_dyn.dynamics import inverse_dynamics, rigid_body_regressor
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

SAMPLES = 1000


@pytest.fixture(scope="module")
def ur10() -> Robot:
    return load_robot("example:ur10")


@pytest.fixture(scope="module")
def motion(ur10) -> Motion:
    return Motion(np.arange(SAMPLES) * 1e-3, *np.random.default_rng(0).normal(size=(3, SAMPLES, ur10.nv)))


def test_inverse_dynamics(benchmark, ur10, motion):
    assert benchmark(inverse_dynamics, ur10, motion).shape == (SAMPLES, 6)


def test_inverse_dynamics_of_bare_pinocchio(benchmark, ur10, motion):
    def loop():
        data = ur10.model.createData()
        return np.array([pin.rnea(ur10.model, data, *x) for x in zip(motion.q, motion.v, motion.a, strict=True)])

    assert benchmark(loop).shape == (SAMPLES, 6)


def test_regressor(benchmark, ur10, motion):
    assert benchmark(rigid_body_regressor, ur10, motion).shape == (SAMPLES, 6, 60)


def test_regressor_of_bare_pinocchio(benchmark, ur10, motion):
    def loop():
        data = ur10.model.createData()
        samples = zip(motion.q, motion.v, motion.a, strict=True)
        return np.array([pin.computeJointTorqueRegressor(ur10.model, data, *x).copy() for x in samples])

    assert benchmark(loop).shape == (SAMPLES, 6, 60)
