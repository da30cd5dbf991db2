"""Recordings of a robot along sums of sines."""

from pathlib import Path

import numpy as np

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion


def sines(t: np.ndarray, joints: int, rng: np.random.Generator, *, count: int = 5, size: float = 0.2) -> Motion:
    """Sums of sines of 0.1 to 1 Hz on each joint; fast ones are as small as their speed allows."""
    q, v, a = (np.zeros((len(t), joints)) for _ in range(3))
    for joint in range(joints):
        for hz in rng.uniform(0.1, 1.0, count):
            w, phase, most = 2 * np.pi * hz, rng.uniform(0, 2 * np.pi), size / max(hz, 0.3)
            q[:, joint] += most * np.sin(w * t + phase)
            v[:, joint] += most * w * np.cos(w * t + phase)
            a[:, joint] -= most * w**2 * np.sin(w * t + phase)
    return Motion(t, q, v, a)


def columns_of(t: np.ndarray, joints: tuple[str, ...], q: np.ndarray, tau: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of a log with positions and torques."""
    positions = {f"q.{joint}": q[:, k] for k, joint in enumerate(joints)}
    return {"t": t, **positions, **{f"tau.{joint}": tau[:, k] for k, joint in enumerate(joints)}}


def rubbing_columns(
    robot_file: Path | str, *, seconds: float = 10.0, rate: float = 200.0, seed: int = 1, friction: float = 0.4
) -> dict[str, np.ndarray]:
    """Columns of a recording of a robot that has more Coulomb friction on every joint than its model."""
    robot, rng = load_robot(robot_file), np.random.default_rng(seed)
    motion = sines(np.arange(int(seconds * rate)) / rate, robot.nv, rng)
    tau = inverse_dynamics(robot, motion) + friction * np.sign(motion.v)
    tau += 0.01 * rng.standard_normal(tau.shape)
    return columns_of(motion.t, robot.joint_names, motion.q, tau)
