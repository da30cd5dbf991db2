"""A robot with two hinges and a slide, and random motions of it."""

from collections.abc import Callable

import numpy as np
import pytest

from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.simulated import Moment, Simulated
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


@pytest.fixture
def operation(arm: Robot, rng: np.random.Generator) -> Operation:
    """Forty random states of the arm, warm or not, under the torque that they need; joint 0 is at rest in the first."""
    q, v, a = rng.uniform(-1.5, 1.5, (3, 40, 3))
    v[0, 0] = 0.0
    warm = rng.uniform(30.0, 50.0, (40, 3))
    return Operation.of(arm, Motion(np.arange(40) / 100.0, q, v, a), temperature=warm)


@pytest.fixture(scope="package")
def smooth(arm: Robot) -> Operation:
    """Four seconds of sines at 500 Hz, in and out of phase, under the torque that they need; its drives warm up."""
    t = np.arange(2000) / 500.0
    w, amplitude = np.array([3.0, 5.0, 4.0]), np.array([0.9, 0.7, 0.2])
    phase = np.outer(t, w) + np.array([0.0, 0.4, 1.1])
    v, a = amplitude * w * np.cos(phase), -amplitude * w**2 * np.sin(phase)
    warm = 30.0 + np.outer(2.0 * t, [1.0, 2.0, 3.0])
    return Operation.of(arm, Motion(t, amplitude * np.sin(phase), v, a), temperature=warm)


@pytest.fixture(scope="package")
def wide(arm: Robot) -> Operation:
    """``tilt`` goes to and fro for 20 s at 250 Hz, over five radians, at several speeds and accelerations."""
    t = np.arange(5000) / 250.0
    states = np.zeros((3, len(t), 3))
    for w, amplitude in ((0.9, 1.5), (2.3, 0.9), (3.7, 0.3)):
        states[0, :, 1] += amplitude * np.sin(w * t)
        states[1, :, 1] += amplitude * w * np.cos(w * t)
        states[2, :, 1] -= amplitude * w**2 * np.sin(w * t)
    return Operation.of(arm, Motion(t, *states))


@pytest.fixture(scope="package")
def torque_in_steps() -> Callable[[Simulated, Operation], np.ndarray]:
    """Torque that a simulation adds when it passes through the states of an operation."""

    def passed(simulated: Simulated, operation: Operation) -> np.ndarray:
        assert simulated.torque is not None
        state, out = simulated.start, []
        for k, dt in enumerate(np.diff(operation.t, append=operation.t[-1] + operation.dt)):
            moment = Moment(float(operation.t[k]), operation.q[k], operation.v[k], operation.transmitted[k])
            state, torque = simulated.torque(state, float(dt), moment)
            out.append(torque)
        return np.array(out)

    return passed


@pytest.fixture(scope="package")
def given_in_steps() -> Callable[[Simulated, np.ndarray, np.ndarray], np.ndarray]:
    """Torque that a drive gives during the steps that begin at ``t``, when it is asked for ``command``."""

    def passed(simulated: Simulated, t: np.ndarray, command: np.ndarray) -> np.ndarray:
        assert simulated.command is not None
        state, out = simulated.start, []
        for dt, tau in zip(np.diff(t, append=2 * t[-1] - t[-2]), command, strict=True):
            state, given = simulated.command(state, float(dt), tau)
            out.append(given)
        return np.array(out)

    return passed
