"""A robot with two hinges and a slide, and random motions of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

ROBOTS = Path(__file__).resolve().parents[2] / "robots"


@pytest.fixture(scope="package")
def arm() -> Robot:
    """Joints turn and tilt (hinges) and slide (linear), all with modelled friction."""
    return load_robot(ROBOTS / "arm3.urdf")


@pytest.fixture
def operation(arm: Robot, rng: np.random.Generator) -> Operation:
    """Forty random states of the arm under the torque that they need; joint 0 is at rest in the first."""
    q, v, a = rng.uniform(-1.5, 1.5, (3, 40, 3))
    v[0, 0] = 0.0
    return Operation.of(arm, Motion(np.arange(40) / 100.0, q, v, a))
