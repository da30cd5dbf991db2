"""A planar arm with rotors that swings under a controller, for tests of simulations."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.model.robot import Robot


@pytest.fixture(scope="session")
def frictionless(planar: Robot) -> Robot:
    """The same without friction."""
    return replace(planar, viscous_friction=np.zeros(2), coulomb_friction=np.zeros(2))


@pytest.fixture(scope="session")
def swinging() -> tuple[Callable, np.ndarray, np.ndarray]:
    """A controller that swings both joints of the arm, and positions and velocities at time zero."""
    size, omega, phase = np.array([0.7, 0.9]), np.array([4.0, 6.5]), np.array([0.3, 1.2])

    def controller(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        wanted, speed = size * np.sin(omega * t + phase), size * omega * np.cos(omega * t + phase)
        return np.array([400.0, 200.0]) * (wanted - q) + np.array([40.0, 15.0]) * (speed - v)

    return controller, size * np.sin(phase), size * omega * np.cos(phase)
