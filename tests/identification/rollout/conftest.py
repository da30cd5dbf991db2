"""Recordings whose truth is known, cut into windows."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.diagnosis.columns.blocks import split_blocks
from identification.rollout.compare import HORIZONS, Rollout, compare_models
from identification.rollout.rollout_starts import exerted_torque, spread, states_of, windows_in
from identification.rollout.shots import Shot, has_hidden_states, under_control, under_torque
from identification.rollout.simulated_models import model_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, Simulation, simulate

Array = np.ndarray


@dataclass(frozen=True)
class Recorded:
    """A simulated recording, ready for fitting."""

    robot: Robot
    recording: Recording
    log: Log
    cutoff_hz: float
    truth: Simulation

    def shots(self, seconds: float = 0.5, count: int = 12) -> tuple[Shot, ...]:
        blocks = split_blocks((self.log,), self.cutoff_hz)
        every, seen = np.arange(len(blocks)), np.full(len(blocks), -1)
        windows = spread(windows_in((self.log,), blocks, seen, every, seconds=seconds, lead=0.25), count)
        states = states_of(self.log, self.cutoff_hz)
        return tuple(Shot(self.log, states, window) for window in windows)

    def rollout(self, *causes: Cause, controlled: bool = False, seconds: float = 0.5) -> Rollout:
        """Of the given model and of one with ``causes``."""
        given, corrected = model_of(self.robot, ()), model_of(self.robot, causes)
        torque = {m: exerted_torque(m, self.log.motion.t, self.log.tau) for m in (given, corrected)}

        def open_loop(shot, model, start_shift):
            return under_torque(shot, model, torque[model], start_shift)

        def settle(shot, model):
            return shot.with_hidden_start(model, torque[model]) if has_hidden_states(model) else shot

        pair = given, corrected
        shoot = under_control if controlled else open_loop
        horizons = tuple(h for h in (2.0, 1.0, *HORIZONS) if h <= seconds)
        return compare_models(
            self.robot, lambda window: pair, self.shots(seconds), shoot, horizons, settle, controlled=controlled
        )


@pytest.fixture(scope="session")
def ready() -> Callable[[Robot, Recording, Simulation], Recorded]:
    """A recording of a simulation, ready for fitting."""

    def made(robot: Robot, recording: Recording, moved: Simulation) -> Recorded:
        (log,), cutoff_hz = process_all((recording,), robot)
        return Recorded(robot, recording, log, cutoff_hz, moved)

    return made


@pytest.fixture(scope="session")
def record(ready) -> Callable[..., Recorded]:
    """A robot with causes under a position controller, 8 s at 250 Hz with encoder and torque noise."""

    def made(robot: Robot, *causes: Cause, noise: float = 1e-5, kp: float = 300.0, kd: float = 30.0) -> Recorded:
        rng = np.random.default_rng(5)
        t, nv = np.arange(2000) / 250.0, robot.nv
        q, v = np.zeros((len(t), nv)), np.zeros((len(t), nv))
        for j in range(nv):
            for hz in rng.uniform(0.15, 1.1, 4):
                w, phase, size = 2 * np.pi * hz, rng.uniform(0, 2 * np.pi), 0.25 / max(hz, 0.4)
                q[:, j] += size * np.sin(w * t + phase)
                v[:, j] += size * w * np.cos(w * t + phase)
        law = position_control(t, q, 0.0 * v, kp=np.full(nv, kp), kd=np.full(nv, kd))
        moved = simulate(robot, causes, law, t, q[0], v[0])
        readings = moved.q + noise * rng.standard_normal(q.shape)
        tau = moved.tau + 0.01 * rng.standard_normal(q.shape)
        recording = Recording("sim.csv", robot.joint_names, t, readings, tau, q_ref=q)
        return ready(robot, recording, moved)

    return made
