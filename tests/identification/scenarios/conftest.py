"""A pendulum, and recordings of it under different conditions whose truth is known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Array = np.ndarray


@pytest.fixture(scope="session")
def frictionless(pendulum) -> Robot:
    """The same without friction: its torque constant and its masses are exact twins."""
    return replace(pendulum, viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1))


@pytest.fixture(scope="session")
def swing() -> Callable[[int], Motion]:
    """Three sines of known derivatives, 12 s at 100 Hz."""

    def motion(seed: int) -> Motion:
        rng = np.random.default_rng(seed)
        t = np.arange(1200) / 100.0
        w = 2 * np.pi * np.array([0.23, 0.61, 1.13])
        size = 1.5 * rng.uniform(0.25, 0.5, 3) / (1 + w / (2 * np.pi))
        angle = t[:, None] * w + rng.uniform(0, 2 * np.pi, 3)
        columns = (size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle))
        return Motion(t, *(column.sum(axis=1)[:, None] for column in columns))

    return motion


@pytest.fixture(scope="session")
def recorded() -> Callable[..., Recording]:
    """A recording of a motion: the torque that ``robot`` needs and ``extra``, with noise of 0.05 N m."""

    def record(robot: Robot, motion: Motion, extra: Array | float, file: str, seed: int = 1) -> Recording:
        rng = np.random.default_rng([7, seed])
        tau = inverse_dynamics(robot, motion) + extra + 0.05 * rng.standard_normal(motion.q.shape)
        return Recording(file, robot.joint_names, motion.t, motion.q + 1e-5 * rng.standard_normal(tau.shape), tau)

    return record
