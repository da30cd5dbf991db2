"""Robots with other inertias and friction than their files state, and motions to compare torques on."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def changed_robot(robot: Robot, share: float = 0.05) -> Robot:
    """Every parameter larger by a share, and more friction on every joint, each joint by its own amount."""
    more = 0.3 + 0.1 * np.arange(robot.nv)
    return replace(
        with_parameters(robot, share * standard_parameters(robot)),
        viscous_friction=robot.viscous_friction + more,
        coulomb_friction=robot.coulomb_friction + 2 * more,
    )


def random_motion(robot: Robot, seed: int = 0, size: float = 0.1) -> Motion:
    """Fifty unrelated samples near the zero position."""
    q, v, a = np.random.default_rng(seed).standard_normal((3, 50, robot.nv))
    return Motion(np.arange(50.0), size * q, v, a)


@pytest.fixture(scope="session")
def changed() -> Callable[..., Robot]:
    """Makes a robot with other parameters, see `changed_robot`."""
    return changed_robot


@pytest.fixture(scope="session")
def some() -> Callable[..., Motion]:
    """Makes a motion, see `random_motion`."""
    return random_motion
