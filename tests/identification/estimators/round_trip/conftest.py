"""Closed loops with a known truth: simulated by `phantom_dyn.simulation.simulate`, which the estimators do not use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.signals import process
from identification.regression.base_parameters import BaseParameters
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import mass_matrix, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Controller, Robot
from phantom_dyn.simulation.simulate import Cause, simulate
from places import ROBOTS

PLACES = {
    "two_joints": (str(ROBOTS / "planar2.urdf"), 0.0),
    "ur10": ("example:ur10", 0.4),
    "phantom": ("phantom_1_5", 0.5),
    "cea": ("cea_branch", 0.3),
    "four_bar": (str(ROBOTS / "fourbar.xml"), 0.1),
    "five_bar": (str(ROBOTS / "fivebar.xml"), 0.1),
}
_HELD = 1.0
"""Time at rest before a recording begins [s]."""


@dataclass(frozen=True)
class Case:
    """A robot with friction, what its recording holds, and the friction."""

    robot: Robot
    recording: Recording
    effects: list
    friction: np.ndarray

    @property
    def log(self) -> Log:
        return process(self.recording, self.robot, cutoff_hz=15.0)

    def noisy(self, seed: int, *, torque: float = 0.05, position: float = 1e-5) -> Case:
        """The same with white noise of this share of the torque, and of this size on the position [rad]."""
        rng = np.random.default_rng(seed)
        q = self.recording.q + position * rng.normal(size=self.recording.q.shape)
        size = torque * np.sqrt(np.mean(self.recording.tau**2, axis=0))
        tau = self.recording.tau + size * rng.normal(size=q.shape)
        return replace(self, recording=replace(self.recording, q=q, tau=tau))

    def truth(self, base: BaseParameters) -> np.ndarray:
        return base.values(np.concatenate([standard_parameters(self.robot), self.friction]))


def reference(nv: int, seconds: float, dt: float, middle: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and three sines per joint that start from rest."""
    t = np.arange(round(seconds / dt)) * dt
    w = 2 * np.pi * np.array([0.35, 0.83, 1.57])[:, None] * (1 + 0.13 * np.arange(nv))
    wave = np.array([0.5, 0.3, 0.12])[:, None] * np.sin(w * t[:, None, None] + 0.7 * np.arange(nv))
    start = np.clip(t / 0.5, 0, 1)[:, None] ** 2
    return t, start * wave.sum(axis=1) + middle * np.cos(np.arange(nv))


def with_controllers(robot: Robot, middle: float, bandwidth: float = 2 * np.pi * 4) -> Robot:
    """PD controllers of one bandwidth for the inertia of each joint."""
    inertia = np.diag(mass_matrix(robot, middle * np.cos(np.arange(robot.nv))[None])[0])
    actuators = tuple(
        replace(actuator, controller=Controller("pd", bandwidth**2 * m, 2 * bandwidth * m))
        for actuator, m in zip(robot.actuators, inertia, strict=True)
    )
    return replace(robot, actuators=actuators)


def closed_loop(robot: Robot, middle: float, *, seconds: float, dt: float) -> Case:
    """A recording of a robot with more friction than its model."""
    robot = with_controllers(robot, middle)
    t, wanted = reference(robot.nv, seconds, dt, middle)
    kp, kd = (np.array([getattr(a.controller, name) for a in robot.actuators]) for name in ("kp", "kd"))
    # Friction of a tenth of the torque of inertia, so that it shows and the robot still follows.
    inertia = kp / (2 * np.pi * 4) ** 2
    viscous, coulomb = 0.5 * inertia, 0.8 * inertia
    names = [(name, joint) for joint in robot.joint_names for name in ("viscous_friction", "coulomb_friction")]
    friction = np.column_stack([viscous, coulomb]).ravel()
    if robot.chain is not None and robot.chain.anchors:
        # At rest where the controllers hold the weight: a fall at the start would be all that the states there show.
        held = round(_HELD / dt)
        t, wanted = np.arange(len(t) + held) * dt, np.concatenate([np.repeat(wanted[:1], held, axis=0), wanted])
    causes = [
        Cause(effect_named(name), joint, np.array([value]))
        for (name, joint), value in zip(names, friction, strict=True)
    ]

    def controller(now: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        k = min(int(now / dt), len(t) - 2)
        share = min(now / dt - k, 1.0)
        return kp * ((1 - share) * wanted[k] + share * wanted[k + 1] - q) - kd * v

    moved = simulate(robot, tuple(causes), controller, t, wanted[0])
    kept = slice(len(t) - round(seconds / dt), None)
    recording = Recording("simulated", robot.joint_names, t[kept], moved.q[kept], moved.tau[kept], q_ref=wanted[kept])
    return Case(robot, recording, [(effect_named(name), joint) for name, joint in names], friction)


@pytest.fixture(scope="session")
def case_of() -> Callable[[str], Case]:
    """The closed loop of a robot by its name in ``PLACES``."""
    made: dict[str, Case] = {}

    def case(name: str) -> Case:
        if name not in made:
            source, middle = PLACES[name]
            seconds = {"ur10": 4.0, "four_bar": 12.0, "five_bar": 12.0}.get(name, 6.0)
            made[name] = closed_loop(load_robot(source), middle, seconds=seconds, dt=4e-3 if name == "ur10" else 2e-3)
        return made[name]

    return case
