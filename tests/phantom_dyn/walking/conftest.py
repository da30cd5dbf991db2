import numpy as np
import pytest

from phantom_dyn.walking.footsteps import Joystick
from phantom_dyn.walking.walker import talos
from phantom_dyn.walking.walking_reference import walk


@pytest.fixture(scope="session")
def biped():
    return talos()


@pytest.fixture(scope="session")
def joystick():
    """Start, straight on, a turn to the left, straight on, stop in the middle of a step."""
    return Joystick(
        np.array([0.5, 3.0, 6.0, 8.0]),
        np.array([0.15, 0.15, 0.15, 0.0]),
        np.array([0.0, 0.2, 0.0, 0.0]),
        np.array([True, True, True, False]),
    )


@pytest.fixture(scope="session")
def reference(biped, joystick):
    return walk(biped, joystick, duration=10.0)
