"""Torques that a model of the weight computed, and joints that only lift. Oracle: Pinocchio, and known truth."""

from __future__ import annotations

import numpy as np
import pytest

import phantom_dyn as dyn
from identification.data.checks.torques.weight_and_friction import computed_from_weight, lifted_less_lowered
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion

T = np.arange(0, 20.0, 0.01)


@pytest.fixture(scope="module")
def arm():
    return dyn.load_robot("example:double_pendulum")


def wander(count: int) -> Motion:
    """A motion of incommensurate sines of each joint."""
    w = 2 * np.pi * np.array([[0.11, 0.37], [0.17, 0.29]])[:count]
    q = (0.5 * np.sin(T[:, None, None] * w)).sum(axis=2)
    v = (0.5 * w * np.cos(T[:, None, None] * w)).sum(axis=2)
    a = (-0.5 * w**2 * np.sin(T[:, None, None] * w)).sum(axis=2)
    return Motion(T, q, v, a)


def still(motion: Motion) -> Motion:
    return Motion(motion.t, motion.q, 0 * motion.v, 0 * motion.a)


def test_a_compensation_is_a_weight_at_each_position(arm, rng):
    motion = wander(2)
    # Of another robot: twice the weight, with the noise of a current sensor.
    tau = 2.0 * inverse_dynamics(arm, still(motion))
    tau += 0.005 * tau.std(axis=0) * rng.standard_normal(tau.shape)
    assert computed_from_weight(arm, motion, tau).all()


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_a_torque_that_moves_the_robot_is_none(arm, speed):
    # Frictionless, exact, and slow: inertia alone tells it.
    m = wander(2)
    motion = Motion(m.t / speed, m.q, speed * m.v, speed**2 * m.a)
    assert not computed_from_weight(arm, motion, inverse_dynamics(arm, motion)).any()


def test_friction_makes_it_no_compensation(arm):
    motion = wander(2)
    tau = inverse_dynamics(arm, still(motion))
    friction = 0.2 * tau.std(axis=0) * np.sign(motion.v)
    assert not computed_from_weight(arm, motion, tau + friction).any()


def test_a_sine_about_the_hanging_posture_is_none(arm):
    # Its acceleration is a weight: there is nothing beside it to tell the two apart.
    w = 2 * np.pi * 0.5
    q = np.column_stack([0.05 * np.sin(w * T), np.zeros_like(T)])
    v = np.column_stack([0.05 * w * np.cos(w * T), np.zeros_like(T)])
    motion = Motion(T, q, v, -(w**2) * q)
    assert not computed_from_weight(arm, motion, inverse_dynamics(arm, motion))[0]


def test_up_alone_lifts_and_up_and_down_does_not(arm):
    up = np.column_stack([0.5 * np.pi * T / T[-1], np.zeros_like(T)])
    speed = np.column_stack([np.full_like(T, 0.5 * np.pi / T[-1]), np.zeros_like(T)])
    motion = Motion(T, up, speed, np.zeros_like(up))
    weight = inverse_dynamics(arm, still(motion))
    away = np.sign(weight[-1, 0])
    assert lifted_less_lowered(arm, motion, weight)[0] == pytest.approx(away)
    both = Motion(T, np.vstack([up[::2], up[::-2]]), np.vstack([speed[::2], -speed[::2]]), np.zeros_like(up))
    assert lifted_less_lowered(arm, both, inverse_dynamics(arm, still(both)))[0] == pytest.approx(0.0, abs=0.01)


def written(tmp_path, arm, motion: Motion, tau: np.ndarray) -> str:
    names = ",".join(f"{kind}.{joint}" for kind in ("q", "tau") for joint in arm.joint_names)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.hstack([motion.t[:, None], motion.q, tau]), delimiter=",", header=f"t,{names}", comments="")
    return str(path)


@pytest.mark.nightly
@pytest.mark.whole
def test_no_load_is_certain_of_a_recorded_compensation(tmp_path, arm, rng):
    # The compensation's model is 1.3 times as heavy as the given one, a hand moves the arm.
    motion = wander(2)
    tau = 1.3 * inverse_dynamics(arm, still(motion))
    tau += 0.002 * tau.std(axis=0) * rng.standard_normal(tau.shape)
    found = dyn.diagnose(arm, written(tmp_path, arm, motion, tau))
    loads = [one for one in found.findings if one.effect in ("payload", "inertial_parameters", "torque_constant")]
    assert loads
    assert max(one.probability for one in loads) <= 0.5
    assert any("gravity compensation" in warning for warning in found.warnings)
