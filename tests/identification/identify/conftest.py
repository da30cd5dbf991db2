"""Recordings of known truth: robots whose inertias and friction are not those of their files."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.identify.identification import IdentifiedModel
from identification.identify.identify import identify
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def heavier(robot: Robot) -> Robot:
    """Every link a tenth heavier, friction doubled with something more."""
    return replace(
        with_parameters(robot, 0.1 * standard_parameters(robot)),
        viscous_friction=2 * robot.viscous_friction + 0.1,
        coulomb_friction=2 * robot.coulomb_friction + 0.2,
    )


def made_recording(
    robot: Robot,
    *,
    file: str = "log.csv",
    seconds: float = 12.0,
    rate: float = 200.0,
    seed: int = 0,
    noise: float = 0.005,
    still: tuple[str, ...] = (),
) -> Recording:
    """A recording of a robot that moves along sums of sines."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    q, v, a = (np.zeros((len(t), robot.nv)) for _ in range(3))
    for joint, name in enumerate(robot.joint_names):
        for hz in rng.uniform(0.1, 1.2, 5):
            w, phase, size = 2 * np.pi * hz, rng.uniform(0, 2 * np.pi), 0.1 if robot.prismatic[joint] else 0.4
            if name not in still:
                q[:, joint] += size * np.sin(w * t + phase)
                v[:, joint] += size * w * np.cos(w * t + phase)
                a[:, joint] -= size * w**2 * np.sin(w * t + phase)
    tau = inverse_dynamics(robot, Motion(t, q, v, a)) + noise * rng.standard_normal(q.shape)
    return Recording(file, robot.joint_names, t, q, tau)


@pytest.fixture(scope="session")
def recorded() -> Callable[..., Recording]:
    """Makes a recording, see `made_recording`."""
    return made_recording


@pytest.fixture(scope="session")
def truth(arm) -> Robot:
    """The arm as it is, which its file does not know."""
    return heavier(arm)


@pytest.fixture(scope="session")
def found(arm, truth) -> IdentifiedModel:
    """What is identified of the arm."""
    return identify(arm, (made_recording(truth),))
