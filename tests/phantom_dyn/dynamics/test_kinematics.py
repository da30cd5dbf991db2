"""Kinematics through Pinocchio. Oracles: the PHANToM's closed forms, finite differences, round trips."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.devices import phantom
from phantom_dyn.dynamics.kinematics import frame_jacobian, frame_pose, wrench_torque
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.maps.inverse import inverse_kinematics
from places import ROBOTS


@pytest.fixture(scope="module")
def robot():
    return load_robot("phantom_1_5")


@pytest.fixture
def q(rng):
    q = rng.uniform(-1.2, 1.2, (200, 3))
    reach = 0.215 * np.cos(q[:, 1]) + 0.17 * np.sin(q[:, 2])
    return q[(np.abs(q[:, 2] - q[:, 1]) < 1.5) & (reach > 0.01)]


def test_the_tip_of_the_phantom_is_that_of_its_closed_form(robot, q):
    rotation, position = frame_pose(robot, q, "tip")
    np.testing.assert_allclose(position, phantom.tip_position(q), rtol=0, atol=1e-14)
    np.testing.assert_allclose(rotation, phantom.tip_rotation(q), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("axes", "closed"), [("body", phantom.body_jacobian), ("hybrid", phantom.hybrid_jacobian)], ids=["body", "hybrid"]
)
def test_the_jacobian_of_the_phantom_is_that_of_its_closed_form(robot, q, axes, closed):
    np.testing.assert_allclose(frame_jacobian(robot, q, "tip", axes), closed(q), rtol=0, atol=1e-14)


def test_the_torque_of_a_wrench_is_that_of_the_closed_form(robot, q, rng):
    wrench = rng.normal(size=(len(q), 6))
    expected = phantom.wrench_torque(q, wrench)
    np.testing.assert_allclose(wrench_torque(robot, q, wrench, "tip"), expected, rtol=0, atol=1e-14)


def test_the_parallel_link_ends_on_the_forearm(robot, q):
    # Known truth: its pin meets the forearm l3 below the elbow.
    forearm, elbow = frame_pose(robot, q, "forearm")
    link, pin = frame_pose(robot, q, "parallel_link")
    np.testing.assert_allclose(elbow + forearm @ [0, -0.0325, 0], pin + link @ [0, 0, 0.215], rtol=0, atol=1e-14)


def test_inverse_kinematics_finds_the_closed_form_of_the_phantom(robot, q):
    found = inverse_kinematics(robot, phantom.tip_position(q), "tip", np.zeros(3))
    np.testing.assert_allclose(found, q, rtol=0, atol=1e-9)


def test_inverse_kinematics_of_an_arm_with_a_linear_joint_brings_the_tip_there(rng):
    # Round trip through Pinocchio's forward kinematics.
    robot = load_robot(ROBOTS / "arm3.urdf")
    limits = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    q = rng.uniform(np.maximum(limits[0], -1), np.minimum(limits[1], 1), (50, 3))
    frame = robot.model.frames[-1].name
    _, points = frame_pose(robot, q, frame)
    found = inverse_kinematics(robot, points, frame, np.zeros(3))
    np.testing.assert_allclose(frame_pose(robot, found, frame)[1], points, rtol=0, atol=1e-9)


def test_of_several_branches_the_nearest_is_taken(robot, q):
    # Known truth: no other solution is nearer than the configuration itself.
    near = q[0] + 0.05
    (found,) = inverse_kinematics(robot, phantom.tip_position(q[:1]), "tip", near)
    np.testing.assert_allclose(found, q[0], rtol=0, atol=1e-9)


def test_inverse_kinematics_of_other_than_three_joints_is_refused():
    robot = load_robot("example:ur10")
    with pytest.raises(ParameterError, match="ur10 has 6 active joints, wanted 3: a tip position fixes no others"):
        inverse_kinematics(robot, np.zeros((1, 3)), "tool0", np.zeros(6))


def test_an_unknown_frame_names_the_nearest(robot):
    with pytest.raises(RobotError, match=r"has no frame 'tipp': the frames are .*did you mean tip\?"):
        frame_pose(robot, np.zeros((1, 3)), "tipp")
