"""Recordings of known truth for the checks: smooth multi-sine motion whose torque comes from Pinocchio."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.data.recording import Recording
from phantom_dyn.array_types import read_only
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def multi_sine(t: np.ndarray, nv: int, seed: int, amplitude: float = 0.9) -> Motion:
    """Five sines from 0.1 to 2 Hz a joint, with their exact derivatives."""
    rng = np.random.default_rng(seed)
    q, v, a = (np.zeros((len(t), nv)) for _ in range(3))
    for j in range(nv):
        for f in rng.uniform(0.1, 2.0, 5):
            w, p, size = 2 * np.pi * f, rng.uniform(0, 2 * np.pi), amplitude / 5 / max(f, 0.5)
            q[:, j] += size * np.sin(w * t + p)
            v[:, j] += size * w * np.cos(w * t + p)
            a[:, j] -= size * w**2 * np.sin(w * t + p)
    return Motion(t, q, v, a)


@pytest.fixture
def clean(arm: Robot, rng: np.random.Generator) -> Callable[..., Recording]:
    """Builds a recording of the arm with friction that the model lacks, sensor noise and an encoder."""

    def build(
        *, seconds: float = 20.0, rate: float = 500.0, late: float = 0.0, friction: float = 1.3, seed: int = 1,
        noise: float = 0.01, robot: Robot | None = None,
    ) -> Recording:  # fmt: skip
        robot = arm if robot is None else robot
        t = np.arange(int(seconds * rate)) / rate
        motion = multi_sine(t, robot.nv, seed)
        # A torque that is late by d was needed d earlier than its time stamp.
        tau = inverse_dynamics(robot, multi_sine(t - late, robot.nv, seed))
        v = multi_sine(t - late, robot.nv, seed).v
        tau = tau + (friction - 1) * (v * robot.viscous_friction + np.sign(v) * robot.coulomb_friction)
        tau += noise * tau.std(axis=0) * rng.standard_normal(tau.shape)
        q = np.round(motion.q / 1e-5) * 1e-5
        return Recording("clean.csv", robot.joint_names, *(read_only(x) for x in (t, q, tau)), v=read_only(motion.v))

    return build


@pytest.fixture
def recording(clean: Callable[..., Recording]) -> Recording:
    """Of the arm, 20 s at 500 Hz."""
    return clean()


LIFT = """<robot name="lift"><link name="base"/><link name="cart"><inertial><origin xyz="0 0 0.1"/><mass value="5"/>
<inertia ixx="0.2" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="fork"><inertial>
<origin xyz="0.1 0 0"/><mass value="2"/><inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="500" velocity="5"/><dynamics damping="10" friction="4"/></joint>
<joint name="hoist" type="prismatic"><parent link="cart"/><child link="fork"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="500" velocity="5"/><dynamics damping="8" friction="5"/></joint></robot>"""


@pytest.fixture
def lift(tmp_path: Path) -> Robot:
    """A cart on a rail with a hoist, whose weight is the same everywhere."""
    (tmp_path / "lift.urdf").write_text(LIFT)
    return load_robot(tmp_path / "lift.urdf")


@pytest.fixture
def planar_log(clean: Callable[..., Recording], planar2: Robot) -> Recording:
    """The same of the planar arm."""
    return clean(robot=planar2)


@pytest.fixture
def changed() -> Callable[..., Recording]:
    """Copies a recording with some of its arrays replaced."""

    def change(recording: Recording, **arrays: np.ndarray) -> Recording:
        return replace(recording, **{name: read_only(array) for name, array in arrays.items()})

    return change
