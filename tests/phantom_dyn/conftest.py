"""A planar arm with rotors that swings under a controller, for tests of simulations."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS


def with_rotors(robot: Robot, inertias: list[float]) -> Robot:
    model = robot.model.copy()
    model.armature = np.array(inertias)
    return replace(robot, model=model)


@pytest.fixture(scope="session")
def planar() -> Robot:
    """Joints shoulder and elbow, both about y, hanging, with friction and rotors; torque follows the controller."""
    return with_rotors(load_robot(ROBOTS / "planar2.urdf"), [0.3, 0.1])


@pytest.fixture(scope="session")
def frictionless(planar: Robot) -> Robot:
    """The same without friction."""
    return replace(planar, viscous_friction=np.zeros(2), coulomb_friction=np.zeros(2))


@pytest.fixture(scope="session")
def pendulum() -> Robot:
    """A rod of 0.6 kg m^2 about its pin, 2 kg at 0.5 m below it, with friction."""
    return load_robot(ROBOTS / "pendulum.urdf")


@pytest.fixture(scope="session")
def arm() -> Robot:
    """Joints turn and tilt (hinges) and slide (linear), with modelled friction."""
    return load_robot(ROBOTS / "arm3.urdf")


@pytest.fixture(scope="session")
def swinging() -> tuple[Callable, np.ndarray, np.ndarray]:
    """A controller that swings both joints of the arm, and positions and velocities at time zero."""
    size, omega, phase = np.array([0.7, 0.9]), np.array([4.0, 6.5]), np.array([0.3, 1.2])

    def controller(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        wanted, speed = size * np.sin(omega * t + phase), size * omega * np.cos(omega * t + phase)
        return np.array([400.0, 200.0]) * (wanted - q) + np.array([40.0, 15.0]) * (speed - v)

    return controller, size * np.sin(phase), size * omega * np.cos(phase)
