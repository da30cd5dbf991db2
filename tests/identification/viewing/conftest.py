"""A recording of a robot that has Coulomb friction on its elbow, and whose model has none there."""

from dataclasses import dataclass

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.diagnosis.columns.terms import KnownEffect
from identification.rollout.rollout_starts import States, states_of
from identification.viewing.corrections import Correction
from identification.viewing.replay import Replay, replay_of
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate

TORQUE = 0.3
LACKING = KnownEffect("coulomb_friction", "elbow", (TORQUE,))


@dataclass(frozen=True)
class Rubbing:
    """The recording, ready for fitting."""

    robot: Robot
    recording: Recording
    log: Log
    states: States
    cutoff_hz: float


@pytest.fixture(scope="session")
def rubbing(planar2) -> Rubbing:
    """10 s at 200 Hz under a position controller, with the noise of a fine encoder; known truth."""
    t = np.arange(2000) / 200.0
    size, pace = np.array([0.5, 0.7]), 2 * np.pi * np.array([0.4, 0.6])
    q = size * np.sin(np.outer(t, pace))
    law = position_control(t, q, size * pace * np.cos(np.outer(t, pace)), kp=np.full(2, 200.0), kd=np.full(2, 20.0))
    cause = Cause(effect_named(LACKING.effect), LACKING.joint, np.array(LACKING.theta))
    moved = simulate(planar2, (cause,), law, t, q[0], size * pace)
    readings = moved.q + 1e-6 * np.random.default_rng(3).standard_normal(q.shape)
    recording = Recording("swing.csv", planar2.joint_names, t, readings, moved.tau, q_ref=q)
    (log,), cutoff_hz = process_all((recording,), planar2)
    return Rubbing(planar2, recording, log, states_of(log, cutoff_hz), cutoff_hz)


@pytest.fixture(scope="session")
def replay(rubbing) -> Replay:
    """The recording beside the given model, and beside the one that has the friction."""
    return replay_of(rubbing.robot, rubbing.recording, correction=Correction((LACKING,)))


@pytest.fixture(scope="session")
def lacking() -> KnownEffect:
    """What the model lacks."""
    return LACKING
