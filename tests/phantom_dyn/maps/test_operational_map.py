"""Maps over grids. Oracles: closed forms, round trips through Pinocchio, quantities of single configurations."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.devices import cea
from phantom_dyn.devices import phantom as closed
from phantom_dyn.errors import ParameterError
from phantom_dyn.maps import operational_map as streaming
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.inverse import cloud_of, nearest_branch
from phantom_dyn.maps.map_model import cea_branches, map_model, tip_of
from phantom_dyn.maps.operational_map import operational_map
from phantom_dyn.maps.quantities import felt_at

SECTION = "x=0:0:1,y=-0.2:0.25:46,z=-0.15:0.15:31"


@pytest.fixture(scope="module")
def model(phantom):
    return map_model(phantom)


@pytest.fixture(scope="module")
def section(model):
    return operational_map(model, read_grid(SECTION, model.joint_names), ["manipulability", "apparent_mass_matrix"])


def points_of(result):
    return result.grid.points(0, result.grid.size)


def test_the_map_over_the_tip_is_that_of_the_closed_form(section):
    found = section.values["manipulability"].ravel()
    reached = np.isfinite(found)
    expected = closed.manipulability(closed.inverse_kinematics(points_of(section)[reached]))
    np.testing.assert_allclose(found[reached], expected, rtol=1e-11)


def test_what_is_out_of_reach_is_nan_and_counted(section):
    # Closed form: a point is reached where the published inverse kinematics has a solution.
    reached = np.isfinite(closed.inverse_kinematics(points_of(section))).all(axis=1)
    np.testing.assert_array_equal(np.isfinite(section.values["manipulability"]).ravel(), reached)
    assert section.unreachable == np.sum(~reached) > 0


def test_a_map_over_joints_is_that_of_each_configuration(model):
    # Oracle: the same quantity of single configurations.
    grid = read_grid("q.theta3=-0.4:0.4:3,q.theta1=-1:1:3", model.joint_names)
    found = operational_map(replace(model, posture=np.array([0, 0.3, 0])), grid, ["gravity_force"])
    q = np.array([[theta1, 0.3, theta3] for theta3 in grid.values[0] for theta1 in grid.values[1]])
    expected = felt_at(model, q, ("gravity_force",))[0]["gravity_force"]
    np.testing.assert_array_equal(found.values["gravity_force"].reshape(-1, 3), expected)


def test_a_coordinate_that_the_grid_leaves_out_is_that_of_the_posture(model):
    # Known truth: the posture's tip is the origin.
    grid = read_grid("y=-0.1:0.1:3", model.joint_names)
    q = closed.inverse_kinematics(np.array([[0, y, 0] for y in (-0.1, 0.0, 0.1)]))
    found = operational_map(model, grid, ["manipulability"]).values["manipulability"]
    np.testing.assert_allclose(found, closed.manipulability(q), rtol=1e-11)


def test_configurations_in_which_the_parallelogram_would_fold_are_out_of_reach(model):
    # Known truth: abs(theta3 - theta2) up to pi / 2.
    grid = read_grid("q.theta3=-2:2:5", model.joint_names)
    found = operational_map(model, grid, ["manipulability"])
    assert np.isfinite(found.values["manipulability"]).tolist() == [False, True, True, True, False]
    assert found.unreachable == 2


def test_singular_points_are_nan_and_counted(model):
    # Closed form: theta3 - theta2 = pi / 2 stretches the arm.
    grid = read_grid(f"q.theta3=0:{np.pi / 2!r}:2", model.joint_names)
    found = operational_map(model, grid, ["manipulability", "apparent_mass"])
    assert np.isnan(found.values["apparent_mass"]).tolist() == [False, True]
    assert np.isnan(found.values["manipulability"]).tolist() == [False, True]
    assert (found.singular, found.unreachable) == (1, 0)


@pytest.mark.parametrize("jobs", [1, 2])
def test_blocks_and_processes_change_nothing(model, section, monkeypatch, jobs):
    # Oracle: the map in one block.
    monkeypatch.setattr(streaming, "BLOCK", 200)
    again = operational_map(model, section.grid, list(section.values), jobs=jobs)
    for name, values in section.values.items():
        np.testing.assert_array_equal(again.values[name], values)
    assert (again.unreachable, again.singular) == (section.unreachable, section.singular)


def test_progress_ends_at_the_last_point(model, monkeypatch):
    monkeypatch.setattr(streaming, "BLOCK", 4)
    said: list[int] = []
    operational_map(model, read_grid("x=0:0.01:10", model.joint_names), ["manipulability"], progress=said.append)
    assert said == [4, 8, 10]


def test_the_branches_of_the_cea_branch_all_reach_the_point(rng):
    # Oracle: the device's own closed form.
    p = rng.uniform(-0.35, 0.35, (100, 3))
    for q in cea_branches(p):
        reached = np.isfinite(q).all(axis=1)
        np.testing.assert_allclose(cea.tip_position(q[reached]), p[reached], rtol=0, atol=1e-12)


def test_the_branches_of_the_cea_branch_are_four(rng):
    # Closed form: on either side of the axis of q1, with the elbow on either side.
    q = cea_branches(rng.uniform(0.1, 0.3, (1, 3)))[:, 0]
    apart = np.abs(np.exp(1j * q[:, None]) - np.exp(1j * q[None])).max(axis=2)
    assert (apart[~np.eye(4, dtype=bool)] > 0.1).all()


def test_a_passive_angle_beyond_half_a_turn_is_the_same_angle_a_turn_away():
    # Known truth: q4 = pi / 2 - q5 of the CEA branch leaves its range of half a turn for q5 below -pi / 2.
    model = map_model(load_robot("cea_branch"))
    found = operational_map(model, read_grid("q.q5=-3:-2:2", model.joint_names), ["manipulability"])
    assert found.unreachable == 0


def test_an_active_joint_beyond_its_range_is_out_of_reach(phantom):
    # Known truth: theta1 goes from -pi to pi.
    model = map_model(phantom)
    found = operational_map(model, read_grid("q.theta1=3.1:3.2:2", model.joint_names), ["manipulability"])
    assert found.unreachable == 1


def test_newton_and_the_closed_form_of_the_cea_branch_choose_the_same_configurations(rng):
    # Oracle: all four branches in closed form.
    model = map_model(load_robot("cea_branch"), posture=np.array([0.1, -0.5, 0.9]))
    q = rng.uniform([-1, -1.2, 0.3], [1, -0.2, 1.2], (60, 3))
    points = tip_of(model, q)[0]
    searching = replace(model, branches=None)
    found = nearest_branch(searching, points, cloud_of(searching))
    np.testing.assert_allclose(found, nearest_branch(model, points, None), rtol=0, atol=1e-8)


def test_newton_finds_no_branch_that_is_farther_than_a_known_one(tmp_path, rng):
    # Known truth: the configuration that the point was made from. A UR10 with its wrist held has up to four.
    (tmp_path / "robot.yaml").write_text("lock: [wrist_1_joint, wrist_2_joint, wrist_3_joint]")
    robot = load_robot("example:ur10", config=tmp_path / "robot.yaml")
    for _ in range(3):
        posture = rng.uniform(-1.5, 1.5, 3)
        model = map_model(robot, posture=posture)
        q = posture + rng.uniform(-1.5, 1.5, (100, 3))
        found = nearest_branch(model, tip_of(model, q)[0], cloud_of(model))
        assert (np.linalg.norm(found - posture, axis=1) <= np.linalg.norm(q - posture, axis=1) + 1e-9).all()


def test_another_posture_gives_another_branch():
    # Closed form: with q2 above and below q5 the elbow is on either side.
    robot = load_robot("cea_branch")
    point = np.array([[0.5, 0.0, 0.1]])
    up, down = (
        nearest_branch(map_model(robot, posture=np.array(q)), point, None)[0] for q in ([0.0, -1, 1], [0.0, 1, -1])
    )
    assert up[1] < up[2]
    assert down[1] > down[2]


def test_a_grid_over_the_tip_of_a_six_joint_arm_is_refused():
    model = map_model(load_robot("example:ur10"))
    message = "has 6 active joints, and a tip position does not determine them: give a grid over joints, such as q"
    with pytest.raises(ParameterError, match=message):
        operational_map(model, read_grid("x=0:1:3", model.joint_names), ["manipulability"])


@pytest.fixture
def two_joints(tmp_path):
    """A UR10 of which shoulder and elbow move, in the plane of x and z."""
    held = "shoulder_pan_joint, wrist_1_joint, wrist_2_joint, wrist_3_joint"
    (tmp_path / "robot.yaml").write_text(f"lock: [{held}]")
    return map_model(load_robot("example:ur10", config=tmp_path / "robot.yaml"), posture=np.array([-0.7, 1.2]))


def test_two_joints_have_a_map_over_the_plane_of_the_tip(two_joints):
    # Known truth: the configuration that a corner was made from, and numpy's singular values there.
    tip, J = tip_of(two_joints, np.array([[-0.8, 1.1]]))
    text = ",".join(f"{axis}={tip[0, k]:.17g}:{tip[0, k] + 0.01:.17g}:2" for k, axis in ((0, "x"), (2, "z")))
    found = operational_map(two_joints, read_grid(text, two_joints.joint_names), ["manipulability"])
    sigma = np.linalg.svd(J[0], compute_uv=False)
    assert found.unreachable == 0
    np.testing.assert_allclose(found.values["manipulability"][0, 0], sigma[1] / sigma[0], rtol=1e-7)


def test_a_grid_over_three_axes_of_a_robot_of_two_joints_is_refused(two_joints):
    with pytest.raises(ParameterError, match="moves on a surface: give the two of x, y and z in which it moves"):
        operational_map(two_joints, read_grid("x=0:1:3,y=0:1:3,z=0:1:3", two_joints.joint_names), ["manipulability"])


def test_a_map_over_joints_of_a_six_joint_arm(configurations):
    # Oracle: numpy's singular values of Pinocchio's Jacobian.
    from phantom_dyn.dynamics.kinematics import frame_jacobian

    robot = load_robot("example:ur10")
    model = map_model(robot, posture=np.array([0.0, -1, 1, 0.3, 0.5, 0]))
    grid = read_grid("q.elbow_joint=0.5:1.5:3", model.joint_names)
    q = np.repeat(model.posture[None], 3, axis=0)
    q[:, 2] = grid.values[0]
    sigma = np.linalg.svd(frame_jacobian(robot, q, model.frame, "hybrid")[:, :3], compute_uv=False)
    found = operational_map(model, grid, ["manipulability"]).values["manipulability"]
    np.testing.assert_allclose(found, sigma[:, 2] / sigma[:, 0], rtol=1e-9)


def test_the_map_of_a_chain_that_is_closed_numerically_leaves_out_what_cannot_be_closed(four_bar):
    # Known truth: its crank turns all the way, so that every angle of it can be closed and is mapped.
    model = map_model(four_bar)
    found = operational_map(model, read_grid("q.drive=-1.6:-0.8:5", model.joint_names), ["apparent_mass"])
    assert np.isfinite(found.values["apparent_mass"]).all()
