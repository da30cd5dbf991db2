# pyright: reportAttributeAccessIssue=false
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.load.base_tilt import INVISIBLE, BaseTilt, axes_across
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.motion import Motion

EFFECT = BaseTilt()
THETA = np.array([0.2, -0.3, 0.0])


def turned(axis: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """Oracle for exp([r]x): Pinocchio's rotation about an axis by an angle."""
    angle = float(np.linalg.norm(axis))
    return pin.AngleAxis(angle, axis / angle).matrix() @ gravity


def test_the_law_is_inverse_dynamics_as_modelled_less_that_under_turned_gravity(arm, operation):
    there = turned(THETA, arm.model.gravity.linear)
    expected = operation.tau - inverse_dynamics(with_gravity(arm, there), operation)
    np.testing.assert_allclose(EFFECT.torque(arm, operation, None, THETA), expected, atol=1e-9)


@pytest.fixture
def on_its_side(arm):
    """The same arm under gravity along y, as the built-in haptic devices have it."""
    return with_gravity(arm, np.array([0.0, -9.81, 0.0]))


def test_a_base_under_gravity_along_y_tilts_about_x_and_z(on_its_side, operation):
    # Closed form: a turn about y changes nothing, so the two angles are roll and yaw.
    swung = Operation.of(on_its_side, operation)
    assert EFFECT.signature(on_its_side, swung, None, (0.0, 0.0)).names == ("roll", "yaw")
    found = EFFECT.from_coefficients(on_its_side, None, np.array([0.1, -0.2]), (0.0, 0.0))
    np.testing.assert_array_equal(found, [0.1, 0.0, -0.2])
    columns = EFFECT.signature(on_its_side, swung, None, (0.1, -0.2)).columns
    law = EFFECT.torque(on_its_side, swung, None, found)
    np.testing.assert_allclose(law, -columns @ [0.1, -0.2], atol=1e-9)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (0.0, -9.81, 0.0), (1.0, -2.0, 3.0), (5.0, 5.0, 5.0)])
def test_the_axes_of_a_tilt_are_across_gravity_and_each_other(gravity):
    axes = axes_across(np.array(gravity))
    np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(axes @ gravity, 0.0, atol=1e-12)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (0.0, -9.81, 0.0), (1.0, -2.0, 3.0)])
def test_a_tilt_of_an_older_file_is_the_same_gravity_and_across_it(arm, gravity):
    # Oracle: Pinocchio's rotations; version 1 wrote R_x(roll) R_y(pitch).
    robot = with_gravity(arm, np.array(gravity))
    read = EFFECT.from_stated(robot, {"roll": 0.2, "pitch": -0.3})
    turn = np.array([read["roll"], read["pitch"], read["yaw"]])
    older = pin.utils.rotate("x", 0.2) @ pin.utils.rotate("y", -0.3) @ gravity
    np.testing.assert_allclose(turned(turn, np.array(gravity)), older, atol=1e-12)
    assert turn @ gravity == pytest.approx(0.0, abs=1e-12)


def test_a_tilt_of_a_newer_file_is_read_as_it_is(arm):
    given = {"roll": 0.2, "pitch": -0.3, "yaw": 0.0}
    assert EFFECT.from_stated(arm, given) == given


def test_the_tangent_is_the_slope_of_the_law(arm, operation):
    columns = EFFECT.signature(arm, operation, None, (0.0, 0.0)).columns
    for axis in (0, 1):
        ends = [EFFECT.torque(arm, operation, None, sign * 1e-6 * np.eye(3)[axis]) for sign in (-1.0, 1.0)]
        np.testing.assert_allclose((ends[1] - ends[0]) / 2e-6, -columns[:, :, axis], atol=1e-6)


def test_roll_of_an_arm_that_turns_about_y_is_left_out(planar):
    # Closed form: gravity turned about x gains a component along the joints' axes, which moves nothing.
    q = np.linspace(-1.0, 1.0, 40)[:, None] * np.ones(2)
    swung = Operation.of(planar, Motion(np.arange(40.0), q, 0 * q, 0 * q))
    (shape,) = EFFECT.shapes(planar, swung, None)
    assert shape == (INVISIBLE, 0.0)
    assert EFFECT.signature(planar, swung, None, shape).names == ("pitch",)
    np.testing.assert_array_equal(EFFECT.from_coefficients(planar, None, np.array([0.1]), shape), [0.0, 0.1, 0.0])
    assert EFFECT.refined(np.array([0.1]), shape) == ((INVISIBLE, 0.1),)
    assert EFFECT.probe(planar, swung, None)[0] == "pitch"


def test_a_robot_without_weight_shows_no_tilt(planar):
    q = np.linspace(-1.0, 1.0, 40)[:, None] * np.ones(2)
    floating = with_gravity(planar, np.zeros(3))
    swung = Operation.of(floating, Motion(np.arange(40.0), q, 0 * q, q))
    assert EFFECT.untestable(floating, swung, None) == "no joint feels gravity turn: a tilt of the base leaves no trace"


def test_wide_postures_can_show_it(arm, operation):
    assert EFFECT.untestable(arm, operation, None) is None


def test_a_base_turns_by_no_more_than_a_right_angle_about_each_axis_that_leaves_a_trace(arm):
    quarter = (-0.5 * np.pi, 0.5 * np.pi)
    assert EFFECT.coefficient_bounds(arm, None, (0.0, 0.0)) == (quarter, quarter)
    assert EFFECT.coefficient_bounds(arm, None, (INVISIBLE, 0.0)) == (quarter,)
    assert [(p.lower, p.upper) for p in EFFECT.parameters(arm, None)] == [quarter] * 3
    assert EFFECT.coefficient_bounds(arm, None, ()) == (quarter, quarter)


@pytest.mark.parametrize("angle", [2e-4, -2e-4, 0.5, -0.5])
def test_a_column_is_the_secant_of_the_law_to_its_angle(arm, operation, angle):
    for axis, theta in enumerate(angle * np.eye(3)[:2]):
        column = EFFECT.signature(arm, operation, None, tuple(theta[:2])).columns[:, :, axis]
        np.testing.assert_allclose(-EFFECT.torque(arm, operation, None, theta) / angle, column, atol=1e-8)


@pytest.mark.parametrize("angle", [0.5e-4, -0.5e-4])
def test_below_a_ten_thousandth_a_column_is_the_tangent(arm, operation, angle):
    near, tangent = (EFFECT.signature(arm, operation, None, (x, x)).columns for x in (angle, 0.0))
    np.testing.assert_array_equal(near[:, :, 1], tangent[:, :, 1])


def test_a_tilt_is_probed_by_the_first_angle_that_leaves_a_trace(arm, operation):
    name, direction = EFFECT.probe(arm, operation, None)
    assert name == "roll"
    np.testing.assert_array_equal(direction, [1.0, 0.0])


@pytest.mark.parametrize(("off", "roll"), [(0.5e-6, INVISIBLE), (2e-6, 0.0)])
def test_a_millionth_of_the_torque_shows_no_tilt(planar, off, roll):
    # Closed form: gravity that is out of the plane by a share leaves that share of its torque per radian of roll.
    q = np.linspace(-1.0, 1.0, 40)[:, None] * np.ones(2)
    leaning = with_gravity(planar, 9.81 * np.array([0.0, off, -1.0]))
    swung = Operation.of(replace(leaning, coulomb_friction=np.zeros(2)), Motion(np.arange(40.0), q, 0 * q, 0 * q))
    assert EFFECT.shapes(swung.robot, swung, None) == ((roll, 0.0),)


def test_few_and_many_postures_show_the_same(arm, operation):
    states = (np.tile(x, (100, 1)) for x in (operation.q, operation.v, operation.a))
    many = Operation.of(arm, Motion(np.arange(4000.0), *states))
    assert EFFECT.shapes(arm, many, None) == EFFECT.shapes(arm, operation, None) == ((0.0, 0.0),)


def test_a_tilt_is_sized_about_an_axis_across_gravity(arm):
    # By hand: across (0, -1, -1) lie x and (0, 1, -1); about it a pitch of 0.2 comes with a yaw of -0.2.
    leaning = with_gravity(arm, np.array([0.0, -5.0, -5.0]))
    assert EFFECT.sized(leaning, None, "roll", 0.3, np.zeros(3)) == pytest.approx((0.3, 0.0, 0.0))
    assert EFFECT.sized(leaning, None, "pitch", 0.2, np.zeros(3)) == pytest.approx((0.0, 0.2, -0.2))
    assert EFFECT.sized(arm, None, "yaw", 0.2, np.zeros(3)) is None


def test_without_gravity_a_base_would_tilt_about_x_and_y():
    np.testing.assert_allclose(axes_across(np.zeros(3)), np.eye(3)[:2])


def test_a_probe_is_one_radian_of_the_named_angle(arm, operation):
    # By hand: under gravity along (0, -1, -3) the second axis is (0, 3, -1) / sqrt(10), whose pitch is the largest.
    leaning = with_gravity(arm, np.array([0.0, -1.0, -3.0]))
    swung = Operation.of(leaning, operation)
    name, direction = EFFECT.probe(leaning, swung, None)
    found = EFFECT.from_coefficients(leaning, None, direction, (0.0, 0.0))
    assert found[("roll", "pitch", "yaw").index(name)] == pytest.approx(1.0)


def test_a_level_base_of_an_older_file_is_level(arm):
    assert EFFECT.from_stated(arm, {"roll": 0.0, "pitch": 0.0}) == {"roll": 0.0, "pitch": 0.0, "yaw": 0.0}
