"""Standstill of motion without a rest; known truth: which joint moves, and when."""

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.data.signals import process
from identification.diagnosis.columns.motion.standstill import standing_still
from phantom_dyn.model.loading import load_robot
from places import ROBOTS


def still(q: np.ndarray, rate: float) -> np.ndarray:
    """Share of the samples in which each joint counts as standing."""
    robot = load_robot(ROBOTS / "planar2.urdf")
    t = np.arange(len(q)) / rate
    tau = np.sin(1.3 * t)[:, None] * np.ones(2)
    log = process(Recording("log.csv", robot.joint_names, t, q, tau), robot)
    return standing_still(log)[log.valid].mean(axis=0)


def swings(t: np.ndarray, *hertz: float) -> np.ndarray:
    return sum(np.sin(2 * np.pi * f * t + f) / f for f in hertz) * np.ones((2, 1))


@pytest.mark.parametrize(("rate", "hertz"), [(20.0, (0.9, 1.5, 2.1)), (200.0, (0.6, 1.7)), (30.0, (1.1, 2.9))])
def test_motion_without_a_rest_is_no_standstill(rng, rate, hertz):
    t = np.arange(0, 40, 1 / rate)
    q = 0.3 * swings(t, *hertz).T + 2e-6 * rng.standard_normal((len(t), 2))
    assert still(q, rate).max() < 0.2


@pytest.mark.parametrize("rate", [25.0, 200.0])
def test_a_joint_that_is_held_stands_beside_one_that_moves(rng, rate):
    t = np.arange(0, 40, 1 / rate)
    q = 0.3 * swings(t, 0.7, 1.9).T
    q[:, 1] = 0.4
    found = still(q + 1e-4 * rng.standard_normal((len(t), 2)), rate)
    assert found[0] < 0.2
    assert found[1] > 0.9
