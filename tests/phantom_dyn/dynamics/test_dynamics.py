"""Dynamics and kinematics of robots against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.devices import phantom
from phantom_dyn.dynamics.dynamics import (
    gravity_torque,
    inverse_dynamics,
    link_torque,
    mass_matrix,
    rigid_body_regressor,
    standard_parameters,
)
from phantom_dyn.dynamics.kinematics import frame_jacobian, frame_pose, wrench_torque
from phantom_dyn.errors import LogError, RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

SOURCES = [ROBOTS / "pendulum.urdf", ROBOTS / "arm3.urdf", "emps", "example:ur10", "example:double_pendulum_continuous"]


def some_motion(rng: np.random.Generator, nv: int, samples: int = 10) -> Motion:
    return Motion(np.arange(samples) * 0.01, *rng.normal(size=(3, samples, nv)))


def test_a_pendulum_needs_the_torque_of_the_closed_form(rng):
    # I = 0.1 + 2 * 0.5^2 about the pin; tau = I a + m g l sin q + c v + T sign v.
    motion = some_motion(rng, 1)
    expected = 0.6 * motion.a + 2 * 9.81 * 0.5 * np.sin(motion.q) + 0.3 * motion.v + 0.7 * np.sign(motion.v)
    np.testing.assert_allclose(inverse_dynamics(load_robot(ROBOTS / "pendulum.urdf"), motion), expected, atol=1e-12)


def test_friction_is_zero_at_rest():
    still = Motion(np.zeros(1), *np.zeros((3, 1, 1)))
    assert inverse_dynamics(load_robot(ROBOTS / "pendulum.urdf"), still) == 0


@pytest.mark.parametrize("source", SOURCES)
def test_the_regressor_times_the_parameters_is_rnea_without_armature(source, rng, tmp_path):
    config = tmp_path / "robot.yaml"
    config.write_text(f"joints: {{{load_robot(source).joint_names[0]}: {{rotor_inertia: 0.3}}}}")
    robot = load_robot(source, config=config)
    motion = some_motion(rng, robot.nv)
    q, data = robot.configuration(motion.q), robot.model.createData()
    rnea = np.array([pin.rnea(robot.model, data, q[k], motion.v[k], motion.a[k]) for k in range(len(q))])
    torque = rigid_body_regressor(robot, motion) @ standard_parameters(robot)
    np.testing.assert_allclose(torque, rnea - robot.model.armature * motion.a, atol=1e-9)


def test_the_mass_matrix_is_that_of_pinocchio_with_armature(rng, tmp_path):
    (tmp_path / "c.yaml").write_text("joints: {tilt: {rotor_inertia: 0.3}}")
    robot = load_robot(ROBOTS / "arm3.urdf", config=tmp_path / "c.yaml")
    bare = load_robot(ROBOTS / "arm3.urdf")
    q = rng.normal(size=(1, 3))
    # Pinocchio computes the inverse by another algorithm, and fills it above its diagonal only.
    upper = np.triu(pin.computeMinverse(bare.model, bare.model.createData(), q[0]))
    expected = np.linalg.inv(upper + np.triu(upper, 1).T) + np.diag([0, 0.3, 0])
    np.testing.assert_allclose(mass_matrix(robot, q)[0], expected, atol=1e-10)


def test_a_value_that_is_not_finite_is_refused_with_its_place():
    motion = Motion(np.arange(2.0), np.zeros((2, 1)), np.array([[0], [np.nan]]), np.zeros((2, 1)))
    with pytest.raises(LogError, match="v of joint number 0 is not finite at sample 1"):
        inverse_dynamics(load_robot("emps"), motion)


@pytest.mark.parametrize("source", SOURCES)
def test_the_torque_of_the_links_has_neither_rotors_nor_friction(source, rng):
    robot = load_robot(source)
    motion = some_motion(rng, robot.nv)
    torque = rigid_body_regressor(robot, motion) @ standard_parameters(robot)
    np.testing.assert_allclose(link_torque(robot, motion), torque, atol=1e-9)


def test_gravity_torque_of_a_pendulum_is_that_of_the_closed_form(rng):
    # m g l sin q, and m g l cos q where gravity points sideways.
    robot, q = load_robot(ROBOTS / "pendulum.urdf"), rng.normal(size=(5, 1))
    np.testing.assert_allclose(gravity_torque(robot, q), 9.81 * np.sin(q), atol=1e-12)
    sideways = gravity_torque(robot, q, np.array([-9.81, 0.0, 0.0]))
    np.testing.assert_allclose(np.abs(sideways), 9.81 * np.abs(np.cos(q)), atol=1e-12)


@pytest.mark.parametrize("source", SOURCES)
def test_a_given_gravity_leaves_the_model_as_it_was(source):
    robot = load_robot(source)
    before = robot.model.gravity.linear.copy()
    gravity_torque(robot, np.zeros((1, robot.nv)), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(robot.model.gravity.linear, before)


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


def test_an_unknown_frame_names_the_nearest(robot):
    with pytest.raises(RobotError, match=r"has no frame 'tipp': the frames are .*did you mean tip\?"):
        frame_pose(robot, np.zeros((1, 3)), "tipp")
