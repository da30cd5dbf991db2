# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.footsteps import Gait, Joystick
from phantom_dyn.walking.pattern import foot_motion, pendulum_motion
from phantom_dyn.walking.walking_reference import walk
from phantom_dyn.walking.whole_body import ComMotion, whole_body_motion


@pytest.fixture(scope="module")
def neighbours(biped, reference):
    """Whole-body motion at one time in a turning swing phase and shortly before and after it."""
    step = 1e-5
    t = 4.43 + step * np.array([-1.0, 0.0, 1.0])
    omega = np.sqrt(9.81 / biped.com_height)
    states = pendulum_motion(reference.phases, t, omega)
    level = np.zeros((3, 1))
    com = ComMotion(
        np.hstack([states.com, level + biped.com_height]),
        np.hstack([states.velocity, level]),
        np.hstack([states.acceleration, level]),
    )
    left, right = (foot_motion(reference.phases, t, side, 0.04) for side in ("left", "right"))
    return step, whole_body_motion(biped, com, left, right)


def test_centre_of_mass_and_soles_are_where_they_were_wanted(biped, reference):
    data = biped.model.createData()
    for k in range(0, len(reference.t), 20):
        com = pin.centerOfMass(biped.model, data, reference.motion.q[k])
        np.testing.assert_allclose(com, [*reference.pendulum.com[k], biped.com_height], atol=1e-9)
        pin.framesForwardKinematics(biped.model, data, reference.motion.q[k])
        for side in ("left", "right"):
            pose, wanted = data.oMf[biped.model.getFrameId(f"{side}_sole")], getattr(reference, side).position[k]
            np.testing.assert_allclose(pose.translation, wanted[:3], atol=1e-9)
            np.testing.assert_allclose(pin.rpy.matrixToRpy(pose.rotation), [0, 0, wanted[3]], atol=1e-9)


def test_velocities_are_the_differences_of_configurations(biped, neighbours):
    # Oracle: central differences on the manifold of configurations.
    step, motion = neighbours
    numeric = pin.difference(biped.model, motion.q[0], motion.q[2]) / (2 * step)
    np.testing.assert_allclose(motion.v[1], numeric, atol=1e-5)


def test_accelerations_are_the_differences_of_velocities(neighbours):
    step, motion = neighbours
    np.testing.assert_allclose(motion.a[1], (motion.v[2] - motion.v[0]) / (2 * step), atol=1e-4)


def test_joints_that_do_not_walk_keep_the_posture(biped, reference):
    walking = [k for k in biped.leg_columns if k >= 6]
    still = np.setdiff1d(np.arange(6, biped.model.nv), walking)
    np.testing.assert_allclose(reference.motion.q[:, still + 1], np.tile(biped.posture[still + 1], (1000, 1)), atol=0)
    np.testing.assert_array_equal(reference.motion.v[:, still], 0.0)


def test_steps_beyond_the_reach_of_the_legs_are_refused(biped):
    gait = Gait(foot_distance=biped.foot_distance, longest_step=2.0)
    one = np.array([0.0])
    with pytest.raises(ParameterError, match="slower or shorter step"):
        walk(biped, Joystick(one, one + 1.2, one, np.array([True])), duration=4.0, gait=gait, rate=20.0)
