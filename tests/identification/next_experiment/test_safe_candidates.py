from __future__ import annotations

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.signals import low_pass
from identification.next_experiment.candidates import candidates, design_of, exciting, safe_limits
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

KINDS = {"Fourier series", "triangles and sines", "slow triangles", "holds with small reversals"}


def swinging(robot: Robot, reach: float = 0.5) -> Log:
    """Every joint swings as a sine of 0.5 Hz about zero."""
    t, w = np.arange(2000) / 200.0, np.pi * np.ones(robot.nv)
    angle = t[:, None] * w
    motion = Motion(t, reach * np.sin(angle), reach * w * np.cos(angle), -reach * w**2 * np.sin(angle))
    tau = inverse_dynamics(robot, motion)
    return Log("swing.csv", robot.joint_names, motion, tau, low_pass(20.0, 200.0), np.ones(len(t), dtype=bool))


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot(ROBOTS / "planar2.urdf")


def test_limits_are_not_much_wider_than_what_was_recorded(arm):
    # Closed form: half of the range beyond either end, and twice the speed.
    limits = safe_limits(arm, (swinging(arm, 0.5),))
    np.testing.assert_allclose(limits.upper, 1.0, rtol=1e-3)
    np.testing.assert_allclose(limits.lower, -1.0, rtol=1e-3)
    np.testing.assert_allclose(limits.velocity, 2.0 * 0.5 * np.pi, rtol=1e-3)


def test_a_stated_torque_limit_that_is_lower_is_kept(arm):
    from dataclasses import replace

    weak = replace(arm, actuators=tuple(replace(drive, torque_limit=0.9) for drive in arm.actuators))
    np.testing.assert_array_equal(safe_limits(weak, (swinging(arm),)).torque, 0.9)


def test_every_candidate_keeps_position_speed_and_torque_between_its_samples_too(arm, rng):
    # Oracle: inverse dynamics of the motion at ten times the rate it was designed at.
    limits = safe_limits(arm, (swinging(arm),))
    drawn = candidates(design_of(arm, limits), duration=8.0, count=16, rng=rng)
    assert {one.kind for one in drawn} == KINDS
    for one in (*drawn, exciting(design_of(arm, limits), 8.0, rng)):
        motion = one.motion(500.0)
        assert (motion.q < limits.upper + 0.01).all()
        assert (motion.q > limits.lower - 0.01).all()
        assert (np.abs(motion.v) < 1.02 * limits.velocity).all()
        assert (np.abs(inverse_dynamics(arm, motion)) < 1.05 * limits.torque).all()
        np.testing.assert_allclose(motion.v[[0, -1]], 0.0, atol=1e-9)


def test_the_exciting_motion_tells_more_of_the_inertial_parameters_than_any_random_one(arm, rng):
    # Oracle: the volume of their uncertainty, from the regressor of each motion.
    limits = safe_limits(arm, (swinging(arm),))
    problem = design_of(arm, limits)

    def told(one):
        return np.linalg.slogdet(problem.information(problem.regressor(one.motion(100.0))))[1]

    best = exciting(problem, 8.0, rng)
    assert told(best) > max(told(one) for one in candidates(problem, duration=8.0, count=16, rng=rng))


def test_the_same_seed_draws_the_same_motions(arm):
    limits = safe_limits(arm, (swinging(arm),))
    one, other = (
        candidates(design_of(arm, limits), duration=8.0, count=2, rng=np.random.default_rng(1)) for _ in range(2)
    )
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.weights, b.weights)
