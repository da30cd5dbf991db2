"""What (18) leaves out. Oracle: the exact force on the tip from inverse dynamics of a known motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics, mass_matrix
from phantom_dyn.dynamics.kinematics import frame_drift, frame_jacobian
from phantom_dyn.errors import ParameterError
from phantom_dyn.maps.quantities import disturbance_force
from phantom_dyn.motion import Motion


@pytest.fixture
def motion(rng):
    q = rng.uniform(-0.6, 0.6, (50, 3))
    return Motion(np.arange(50.0), q, 2 * rng.normal(size=(50, 3)), 20 * rng.normal(size=(50, 3)))


def exact(robot, motion):
    """J, M_op, acceleration of the tip and the force that the joint torques amount to there."""
    J = frame_jacobian(robot, motion.q, "tip", "hybrid")[:, :3]
    back = np.linalg.inv(J)
    mass = np.swapaxes(back, 1, 2) @ mass_matrix(robot, motion.q) @ back
    acceleration = np.einsum("nij,nj->ni", J, motion.a) + frame_drift(robot, motion, "tip")
    return back, mass, acceleration, np.einsum("nji,nj->ni", back, inverse_dynamics(robot, motion))


def test_mass_times_acceleration_and_the_disturbance_are_the_whole_force(phantom, motion):
    _, mass, acceleration, force = exact(phantom, motion)
    rest = force - np.einsum("nij,nj->ni", mass, acceleration)
    np.testing.assert_allclose(disturbance_force(phantom, motion, "tip"), rest, rtol=0, atol=1e-11)


def test_the_printed_equation_20_is_not(phantom, motion):
    back, mass, acceleration, force = exact(phantom, motion)
    rest = force - np.einsum("nij,nj->ni", mass, acceleration)
    still = inverse_dynamics(phantom, Motion(motion.t, motion.q, motion.v, 0 * motion.v))
    printed = still - np.einsum("nij,nj->ni", mass_matrix(phantom, motion.q), motion.a)
    assert np.abs(np.einsum("nji,nj->ni", back, printed) - rest).max() > 0.1


def test_friction_is_no_part_of_it(motion):
    # Oracle: the same robot without friction.
    robot = load_robot("cea_branch")
    smooth = replace(robot, viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))
    shifted = Motion(motion.t, motion.q + np.array([0, -1, 1]), motion.v, motion.a)
    expected = disturbance_force(smooth, shifted, "tip")
    np.testing.assert_allclose(disturbance_force(robot, shifted, "tip"), expected, rtol=0, atol=1e-12)


def test_other_than_three_joints_are_refused():
    robot = load_robot("example:ur10")
    still = Motion(np.zeros(1), *np.zeros((3, 1, 6)))
    with pytest.raises(ParameterError, match="ur10 has 6 active joints, wanted 3"):
        disturbance_force(robot, still, "tool0")
