"""Robots and logs with a known truth, for every estimator."""

from collections.abc import Callable

import numpy as np
import pytest

from identification.data.log import Band, Log
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.inertia import central_parameters
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def log_of(robot: Robot, motion: Motion, tau: np.ndarray) -> Log:
    everything = Band(100.0, 50.0, np.ones(1), 1)
    return Log("made", robot.joint_names, motion, tau, everything, np.ones(len(motion.t), dtype=bool))


@pytest.fixture(scope="session")
def make_log() -> Callable[[Robot, Motion, np.ndarray], Log]:
    """A log without a filter."""
    return log_of


@pytest.fixture
def swing() -> Callable[[Robot, int], Motion]:
    """Three incommensurate sines per joint, at 100 Hz, with their exact derivatives."""

    def motion(robot: Robot, samples: int) -> Motion:
        t = np.arange(samples) * 0.01
        w = np.array([1.1, 2.7, 5.3])[:, None] * (1 + 0.17 * np.arange(robot.nv))
        phase = np.outer(t, w.ravel()).reshape(samples, 3, robot.nv) + np.arange(robot.nv)
        size = np.array([0.8, 0.4, 0.2])[:, None]
        q, v, a = (size * f for f in (np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase)))
        return Motion(t, q.sum(axis=1), v.sum(axis=1), a.sum(axis=1))

    return motion


@pytest.fixture(scope="session")
def friction() -> Callable[[Robot], list]:
    """Viscous and Coulomb friction on every joint."""
    return lambda robot: [
        (effect_named(name), joint) for joint in robot.joint_names for name in ("viscous_friction", "coulomb_friction")
    ]


@pytest.fixture(scope="session")
def rubbing() -> Callable[[Robot, Motion], np.ndarray]:
    """Torque of a robot that has 0.4 N s of viscous and 0.6 N m of Coulomb friction more than its model."""
    return lambda robot, motion: inverse_dynamics(robot, motion) + 0.4 * motion.v + 0.6 * np.sign(motion.v)


@pytest.fixture(scope="session")
def all_possible() -> Callable[[np.ndarray], bool]:
    """True if bodies of these standard parameters can exist: mass, and no second moment of it below zero."""

    def possible(standard: np.ndarray) -> bool:
        for body in standard.reshape(-1, 10):
            mass, _, inertia = central_parameters(body)
            moments = 0.5 * np.trace(inertia) * np.eye(3) - inertia
            if mass <= 0 or np.linalg.eigvalsh(moments)[0] < -1e-9 * np.abs(body[4:]).max():
                return False
        return True

    return possible
