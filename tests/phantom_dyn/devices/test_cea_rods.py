"""CEA branch: rods, cables and the device of two branches."""

import math

import numpy as np
import pinocchio as pin
import pytest

from identification.regression.base_parameters import BaseParameters, base_parameters_of_matrix
from phantom_dyn.devices.cable_friction import CableFriction, rescaled
from phantom_dyn.devices.cea import LENGTHS, tip_position
from phantom_dyn.devices.cea_two_branches import (
    ACTIVE,
    MOTORS,
    POSTURE,
    Platform,
    Rods,
    branch_with_rods_urdf,
    branch_with_rods_yaml,
    motor_slope,
    shared_torque,
    two_branches_urdf,
    two_branches_yaml,
)
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction, rigid_body_regressor
from phantom_dyn.dynamics.kinematics import frame_pose
from phantom_dyn.errors import ChainError, ParameterError, RobotError
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

ALONG_X1, AWAY = (0.05, 0.0, 0.0), (0.0, 0.05, 0.03)


def branch(folder, arm, forearm) -> Robot:
    rods = Rods(arm, forearm)
    (folder / "robot.urdf").write_text(branch_with_rods_urdf(rods))
    (folder / "robot.yaml").write_text(branch_with_rods_yaml(rods))
    return load_robot(folder / "robot.urdf")


def base(robot: Robot, rng) -> BaseParameters:
    W = rigid_body_regressor(robot, Motion(np.arange(150.0), *rng.uniform(-2.0, 2.0, (3, 150, robot.nv))))
    return base_parameters_of_matrix(W.reshape(-1, W.shape[2]), parameter_names(robot), parameter_units(robot))


@pytest.mark.parametrize(
    ("arm", "forearm", "rank"),
    [
        (None, None, 22),  # 21 of the branch with axis 1 horizontal, and the piece's radial first moment
        (ALONG_X1, None, 23),
        (None, ALONG_X1, 23),
        (ALONG_X1, ALONG_X1, 24),
        ((0.05, 0.0, 0.0), (0.03, 0.0, 0.0), 24),
    ],
)
def test_each_rod_with_its_foot_along_x1_adds_one_parameter(tmp_path, rng, arm, forearm, rank):
    """Printed: "one parameter per rod can be identified"; EE' parallel to X1."""
    assert base(branch(tmp_path, arm, forearm), rng).rank == rank


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), AWAY])
def test_a_rod_that_moves_as_the_arm_does_adds_none(tmp_path, rng, offset):
    """Printed: with the same translational velocity all of it regroups."""
    assert base(branch(tmp_path, offset, offset), rng).rank == 22


def test_what_a_rod_adds_is_its_first_moment_across(tmp_path, rng):
    """Printed: "else, MYR2 can be identified"."""
    found = base(branch(tmp_path, ALONG_X1, None), rng)
    assert "rod2.my" in found.base_names  # without an R: nothing regroups with it
    assert not {"rod2.mx", "rod2.mxR"} & set(found.base_names)


def test_rods_stay_parallel_and_the_piece_keeps_the_direction_of_the_shoulder(tmp_path, rng):
    """Closed form: the elbow of rod and arm are apart by the offset, turned by q1 alone."""
    robot, q = branch(tmp_path, ALONG_X1, ALONG_X1), rng.uniform(-1.0, 1.0, (20, 3))
    elbow = frame_pose(robot, q, "r_piece")[1]
    foot = frame_pose(robot, q, "r_rod3")[1]
    turned = np.stack([np.cos(q[:, 0]), np.sin(q[:, 0]), 0 * q[:, 0]], axis=1)
    np.testing.assert_allclose(foot - elbow, 0.05 * turned, atol=1e-12)
    reach = LENGTHS.d3 * np.cos(q[:, 1])
    np.testing.assert_allclose(np.hypot(elbow[:, 0], elbow[:, 1]), np.abs(reach), atol=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(lambda: Rods(rod_mass=0.0), "rod mass of the rods is 0", id="rods without mass"),
        pytest.param(
            lambda: Rods(arm_offset=(float("nan"), 0.0, 0.0)), "give three lengths", id="a foot that is nowhere"
        ),
        pytest.param(lambda: Platform(length=0.0), "length of the platform is 0", id="a platform without length"),
        pytest.param(
            lambda: CableFriction(3e-3).coulomb(np.array([10.0, 0.0])),
            r"Pretension number 1 is 0 N.* a slack cable drives nothing",
            id="a slack cable",
        ),
        pytest.param(
            lambda: rescaled(0.1, pretension=0.0, new_pretension=1.0),
            "The pretension is 0",
            id="rescaling from nothing",
        ),
        pytest.param(lambda: CableFriction(0.0), "per pretension is 0", id="friction without a ratio"),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


LENGTH = Platform().length


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Robot:
    folder = tmp_path_factory.mktemp("two")
    (folder / "robot.urdf").write_text(two_branches_urdf())
    (folder / "robot.yaml").write_text(two_branches_yaml())
    return load_robot(folder / "robot.urdf")


def path(t: np.ndarray) -> np.ndarray:
    """A smooth motion within reach: both branches together, and the lower one somewhat apart."""
    arm, forearm = (POSTURE[0] + 0.3 * np.sin(2 * t), POSTURE[1] + 0.3 * np.sin(3 * t + 1))
    apart = (0.12 * np.sin(5 * t), 0.12 * np.sin(4 * t + 2))
    return np.stack([arm + apart[0], forearm + apart[1], 0.4 * np.sin(t + 0.5), arm, np.sin(6 * t), forearm], axis=1)


T = np.linspace(0.0, 3.0, 61)


def test_six_joints_position_it_and_nine_follow(robot):
    """Counted: 3 + 2 + 3 - 3 of branches and platform, and the handle."""
    assert robot.joint_names == ACTIVE
    assert robot.nv == 6
    assert {"lower_q1", "tilt", "swing"} < set(robot.passive_names)


def test_both_loops_and_the_platform_close(robot):
    """Closed form: the tips of both branches, each by the equations of one, are a platform apart."""
    q = path(T)
    names = list(robot.model.names)[1:]
    tree = robot.configuration(q)
    angle = {name: tree[:, names.index(name)] for name in names}
    tips = []
    for side, height in (("upper", 0.5), ("lower", -0.5)):
        active = np.stack([angle[f"{side}_{joint}"] for joint in ("q1", "q2", "q5")], axis=1)
        tips.append(tip_position(active) + np.array([0.0, height * LENGTH, 0.0]))
    np.testing.assert_allclose(np.linalg.norm(tips[0] - tips[1], axis=1), LENGTH, atol=1e-9)
    np.testing.assert_allclose(frame_pose(robot, q, "tip")[1], 0.5 * (tips[0] + tips[1]), atol=1e-9)


def test_the_handle_turns_about_the_platform(robot):
    q = np.tile(POSTURE, (2, 1))
    q[1, ACTIVE.index("handle")] = 0.7
    (first, second), (here, there) = frame_pose(robot, q, "tip")
    np.testing.assert_allclose(here, there, atol=1e-12)
    np.testing.assert_allclose(first.T @ second, pin.utils.rotate("z", 0.7), atol=1e-12)


def test_a_platform_that_would_have_to_stretch_is_refused(robot):
    q = np.tile(POSTURE, (2, 1))
    q[1, 0] += 1.0
    with pytest.raises(ChainError, match=r"cannot be closed at sample 1"):
        robot.configuration(q)


def test_slope_of_the_motors_is_that_of_finite_differences(robot):
    q, step = path(T[20:21]), 1e-6
    names = list(robot.model.names)[1:]
    rows = [names.index(name) for name in MOTORS]
    moved = np.concatenate([q + step * np.eye(6), q - step * np.eye(6)])
    around = np.concatenate([robot.configuration(np.vstack([path(T[:21]), one]))[-1:, rows] for one in moved])
    np.testing.assert_allclose(
        motor_slope(robot, path(T[:21]))[-1], ((around[:6] - around[6:]) / (2 * step)).T, atol=1e-6
    )


def test_torque_does_the_work_that_the_energy_of_the_bodies_gains(robot):
    """Oracle: kinetic and potential energy of the open tree by Pinocchio, differentiated along the motion."""
    t = np.linspace(0.0, 1.0, 2001)
    q = path(t)
    v, a = np.gradient(q, t, axis=0, edge_order=2), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    motion = Motion(t, q, v, a)
    tau = inverse_dynamics(robot, motion) - modelled_friction(robot, motion)
    tree, data = robot.configuration(q), robot.model.createData()
    rate = np.gradient(tree, t, axis=0, edge_order=2)
    energy = [
        pin.computeKineticEnergy(robot.model, data, x, w) + pin.computePotentialEnergy(robot.model, data, x)
        for x, w in zip(tree, rate, strict=True)
    ]
    power = np.gradient(np.array(energy), t)
    inner = slice(5, -5)
    np.testing.assert_allclose((tau * v).sum(axis=1)[inner], power[inner], atol=2e-4 * np.abs(power).max())


def test_seven_motors_share_the_torque_of_six_with_the_least_squares(robot, rng):
    slope, tau = motor_slope(robot, path(T)), rng.normal(size=(len(T), 6))
    shared = shared_torque(slope, tau)
    np.testing.assert_allclose(np.einsum("nij,ni->nj", slope, shared), tau, atol=1e-10)
    idle = np.linalg.svd(np.swapaxes(slope, 1, 2))[2][:, -1]  # what the motors can do against each other
    np.testing.assert_allclose((shared * idle).sum(axis=1), 0.0, atol=1e-10)


def test_both_branches_have_their_21_base_parameters_and_the_platform_sixteen(robot, rng):
    """Known: 21 of one branch with axis 1 horizontal. What regroups of the platform goes by its length squared."""
    q = path(np.linspace(0.0, 40.0, 400))
    W = rigid_body_regressor(robot, Motion(np.arange(400.0), q, *rng.normal(size=(2, 400, 6))))
    base = base_parameters_of_matrix(W.reshape(-1, W.shape[2]), parameter_names(robot), parameter_units(robot))
    branches = [name for name in base.base_names if name.startswith(("upper_", "lower_"))]
    assert (base.rank, len(branches)) == (58, 42)
    row = base.names.index("lower_link1.Izz")
    column = base.dependent.index(base.names.index("platform.Iyy"))
    grouped = base.grouping[base.independent.index(row), column]
    assert grouped == pytest.approx((LENGTHS.d3**2 + LENGTHS.d4**2) / LENGTH**2, rel=1e-6)


def test_another_robot_has_no_such_motors():
    with pytest.raises(RobotError, match="give the device of two branches"):
        motor_slope(load_robot("cea_branch"), np.zeros((1, 6)))


@pytest.mark.whole  # past the check of shapes, as a caller is
def test_torques_and_slopes_of_different_length_are_refused():
    with pytest.raises(ParameterError, match="give one of each per sample"):
        shared_torque(np.zeros((2, 7, 6)), np.zeros((3, 6)))


def test_the_posture_is_that_of_the_published_figures():
    assert [round(math.degrees(angle)) for angle in POSTURE] == [-15, -105, 0, -15, 0, -105]


PULLED = np.array([20.0, 40.0, 80.0])


def test_coulomb_friction_is_linear_in_the_pretension():
    np.testing.assert_allclose(CableFriction(3e-3).coulomb(PULLED), [0.06, 0.12, 0.24], rtol=1e-12)


def test_the_published_torque_halves_with_the_pretension():
    """Table 3: 0.120 N m; section V.B: linear in the pretension."""
    assert rescaled(0.120, pretension=40.0, new_pretension=20.0) == pytest.approx(0.060, rel=1e-12)
