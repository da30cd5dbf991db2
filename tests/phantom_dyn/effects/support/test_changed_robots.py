"""Robots as effects change them: branches, displaced links, rows."""

import re

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics, link_torque
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.friction.position_dependent_friction import predicts_held_out
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_friction, with_gravity, with_parameters, with_rotor_inertia
from phantom_dyn.effects.support.displaced import (
    change_by_link,
    change_by_reading,
    displaced,
    exact_change_by_link,
    exact_change_by_reading,
)
from phantom_dyn.effects.support.rows import branch_rows, moving_average, never_reverses, secant, turning_points
from phantom_dyn.errors import RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot_files import examples_folder, find_example
from phantom_dyn.motion import Motion


@pytest.fixture(scope="module")
def humanoid(tmp_path_factory):
    # Without the fingers that follow others: in a closed chain all rows may depend on any joint.
    text = find_example("talos_data/talos_reduced", examples_folder()).read_text()
    file = tmp_path_factory.mktemp("humanoid") / "talos.urdf"
    file.write_text(re.sub(r"<mimic [^>]*/>", "", text))
    return load_robot(file)


@pytest.mark.parametrize("joint", ["leg_left_1_joint", "leg_right_6_joint", "torso_2_joint", "arm_left_4_joint"])
def test_only_joints_before_and_behind_a_joint_feel_where_it_is(humanoid, joint, rng):
    model = humanoid.model.copy()
    data = model.createData()
    by_position, *_ = pin.computeRNEADerivatives(
        model, data, pin.randomConfiguration(model), rng.normal(size=model.nv), rng.normal(size=model.nv)
    )
    column = np.abs(by_position[:, humanoid.joint_names.index(joint)])
    felt = set(np.flatnonzero(column > 1e-9 * column.max()).tolist())
    assert felt <= set(branch_rows(humanoid, joint))
    assert len(branch_rows(humanoid, joint)) < humanoid.nv


def test_in_a_closed_chain_all_joints_feel_it():
    phantom = load_robot("phantom_1_5")
    assert branch_rows(phantom, phantom.joint_names[0]) == (0, 1, 2)


def test_in_a_serial_arm_all_joints_feel_it(planar):
    assert branch_rows(planar, "elbow") == (0, 1)


@pytest.mark.parametrize("more", [0.3, -50.0])
def test_friction_adds_to_that_of_the_model_and_is_never_negative(arm, more):
    changed = with_friction(arm, "tilt", viscous=more, coulomb=2.0 * more)
    viscous, coulomb = arm.viscous_friction, arm.coulomb_friction
    np.testing.assert_allclose(changed.viscous_friction, [viscous[0], max(viscous[1] + more, 0.0), viscous[2]])
    np.testing.assert_allclose(changed.coulomb_friction, [coulomb[0], max(coulomb[1] + 2 * more, 0.0), coulomb[2]])


def test_friction_that_is_not_given_stays(planar):
    changed = with_friction(planar, "elbow", viscous=0.25)
    np.testing.assert_array_equal(changed.coulomb_friction, planar.coulomb_friction)
    assert changed.viscous_friction[1] == planar.viscous_friction[1] + 0.25


def test_a_rotor_adds_to_the_armature(planar):
    changed = with_rotor_inertia(planar, "elbow", 0.25)
    np.testing.assert_allclose(changed.rotor_inertia - planar.rotor_inertia, [0.0, 0.25])
    assert with_rotor_inertia(planar, "elbow", -9.0).rotor_inertia[1] == 0.0


def test_parameters_change_body_by_body(arm):
    change = np.zeros(30)
    change[10:20] = [0.5, 0.01, 0.02, 0.03, 0.1, 0.001, 0.1, 0.002, 0.003, 0.1]
    changed = with_parameters(arm, change)
    for body in (1, 2, 3):
        found = changed.model.inertias[body].toDynamicParameters() - arm.model.inertias[body].toDynamicParameters()
        np.testing.assert_allclose(found, change[10 * (body - 1) : 10 * body], atol=1e-12)


@pytest.mark.parametrize(("left", "refused"), [(0.0, True), (-0.1, True), (1e-3, False)])
def test_a_link_that_weighs_nothing_is_refused(arm, left, refused):
    mass = arm.model.inertias[2].mass
    change = np.zeros(30)
    change[10] = left - mass
    if refused:
        with pytest.raises(RobotError, match=r"The link of tilt would weigh .* kg: give more\."):
            with_parameters(arm, change)
    else:
        assert with_parameters(arm, change).model.inertias[2].mass == pytest.approx(left)


def test_gravity_is_the_given_one(arm):
    np.testing.assert_array_equal(with_gravity(arm, np.array([1.0, 2.0, 3.0])).model.gravity.linear, [1.0, 2.0, 3.0])
    assert not with_gravity(arm, np.ones(3)).model.gravity.angular.any()


STEP = 1e-6


@pytest.fixture
def moving(planar, rng):
    q, v, a = rng.uniform(-1.5, 1.5, (3, 30, 2))
    return Operation.of(planar, Motion(np.arange(30.0), q, v, a))


@pytest.fixture
def shifts(rng):
    return rng.normal(size=(3, 30))


def slope(torque, robot, motion, shifts):
    """Central finite difference of a torque along a shift of the elbow."""
    ends = [torque(robot, displaced(motion, 1, *(sign * STEP * shifts))) for sign in (-1.0, 1.0)]
    return (ends[1] - ends[0]) / (2 * STEP)


def test_a_reading_moves_rotor_friction_and_link(planar, moving, shifts):
    expected = slope(inverse_dynamics, planar, moving, shifts)
    np.testing.assert_allclose(change_by_reading(moving, 1, *shifts), expected, atol=1e-6)


def test_a_link_moves_without_rotor_and_friction(planar, moving, shifts):
    expected = slope(link_torque, planar, moving, shifts)
    np.testing.assert_allclose(change_by_link(moving, 1, *shifts), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("exact", "first_order"), [(exact_change_by_link, change_by_link), (exact_change_by_reading, change_by_reading)]
)
def test_the_exact_change_is_that_of_first_order_for_small_shifts(planar, moving, shifts, exact, first_order):
    change = exact(planar, moving, 1, *(STEP * shifts)) / STEP
    np.testing.assert_allclose(change, first_order(moving, 1, *shifts), atol=1e-4)


def test_the_load_of_a_link_is_the_torque_without_rotor_and_friction(planar, moving):
    np.testing.assert_allclose(moving.transmitted[:, 1], link_torque(planar, moving)[:, 1], atol=1e-10)


@pytest.mark.parametrize(
    ("name", "joint", "theta"),
    [
        ("encoder_offset", "tilt", [0.3]),
        ("encoder_eccentricity", "tilt", [0.05, 0.4, 1.0]),
        ("base_tilt", None, [0.2, -0.1, 0.0]),
    ],
)
def test_what_displaces_links_changes_the_torque_by_that_of_the_true_motion(arm, smooth, name, joint, theta):
    # Oracle: inverse dynamics, of the readings by the model and of the true motion in the true gravity.
    effect, theta = effect_named(name), np.array(theta)
    there = inverse_dynamics(*effect.true_motion(arm, smooth, joint, theta))
    expected = there - inverse_dynamics(arm, smooth)
    np.testing.assert_allclose(effect.torque(arm, smooth, joint, theta), -expected, atol=1e-9)
    assert np.abs(expected).max() > 0.01
    assert effect.displaces


@pytest.mark.parametrize(
    "effect", [effect for effect in EFFECTS if not effect.displaces], ids=lambda effect: effect.name
)
def test_other_effects_leave_the_links_where_they_are_read(arm, smooth, effect):
    assert effect.true_motion(arm, smooth, None, np.zeros(1)) == (arm, smooth)


@pytest.mark.parametrize(("size", "asked"), [(0.0, False), (0.15, False), (0.6, True), (2.0, True)])
def test_columns_are_asked_for_where_they_foresee_a_tenth_of_what_is_left(rng, size, asked):
    # Known truth: a cause with size^2 / (1 + size^2) of the squares, beside one that plain columns explain.
    plain, columns, noise = rng.normal(size=(4000, 2)), rng.normal(size=(4000, 3)), rng.normal(size=4000)
    torque = plain @ [3.0, -5.0] + size * columns[:, 0] + noise
    assert predicts_held_out(torque, plain, columns) is asked


def test_what_happens_in_one_block_alone_is_not_foreseen(rng):
    # Known truth: a cause that acts in the first eighth of the time.
    columns = rng.normal(size=(4000, 1))
    torque = rng.normal(size=4000) + 5.0 * columns[:, 0] * (np.arange(4000) < 500)
    assert not predicts_held_out(torque, np.ones((4000, 1)), columns)


@pytest.mark.parametrize(("seconds", "samples"), [(0.01, 5), (0.004, 3), (0.02, 11), (0.001, 1)])
def test_a_moving_average_takes_an_odd_number_of_samples_about_each(seconds, samples):
    # Closed form at 2 ms: an impulse is spread evenly over the window.
    impulse = np.zeros(41)
    impulse[20] = 1.0
    expected = np.where(np.abs(np.arange(41) - 20) <= samples // 2, 1.0 / samples, 0.0)
    np.testing.assert_allclose(moving_average(impulse, 0.002, seconds), expected, atol=1e-15)


def swinging(arm, v: np.ndarray) -> Operation:
    states = np.zeros((3, len(v), 3))
    states[1, :, 1] = v
    return Operation.of(arm, Motion(np.arange(len(v)) / 100.0, *states))


def test_a_joint_turns_where_its_speed_has_reversed(arm):
    # Closed form: cos(x) has reversed once |cos| is beyond a fiftieth of the top again, behind pi/2 and 3 pi/2.
    x = np.arange(0.0, 2.0 * np.pi, 0.01)
    v = np.cos(x)
    expected = [np.flatnonzero((x > k * np.pi) & (np.abs(v) > 0.02))[0] for k in (0.5, 1.5)]
    np.testing.assert_array_equal(turning_points(swinging(arm, v), 1), expected)


def test_a_speed_that_trembles_about_zero_turns_nowhere(arm):
    # Speeds below a fiftieth of the top one count as none.
    v = np.concatenate([np.ones(50), 0.01 * np.tile([1.0, -1.0], 25), np.ones(50)])
    assert len(turning_points(swinging(arm, v), 1)) == 0


def test_the_next_shape_of_a_law_is_its_estimate_unless_that_is_rounding():
    assert [secant(x, 1e-4) for x in (0.3, -0.3, 1e-5, -1e-5)] == [((0.3,),), ((-0.3,),), ((1e-4,),), ((1e-4,),)]


def test_an_estimate_at_the_least_is_taken_as_it_is():
    assert secant(1e-4, 1e-4) == ((1e-4,),)


@pytest.mark.parametrize(("dt", "samples"), [(0.0, 7), (0.002, 3), (1.0, 7)])
def test_a_moving_average_of_a_constant_is_that_constant(dt, samples):
    np.testing.assert_allclose(moving_average(np.full(samples, 2.5), dt, 0.01), 2.5)


def test_beyond_its_ends_a_moving_average_sees_the_last_samples():
    # By hand: three samples about each, the first and the last one twice.
    np.testing.assert_allclose(moving_average(np.array([0.0, 3.0, 6.0, 0.0]), 0.002, 0.004), [1.0, 3.0, 3.0, 2.0])


def test_a_joint_at_rest_never_reverses(arm):
    still = swinging(arm, 1e-10 * np.tile([1.0, -1.0], 40))
    assert never_reverses(arm, still, "tilt") == "tilt never reverses: its friction looks like a constant torque"


@pytest.mark.parametrize(("share", "turns"), [(0.019, 0), (0.021, 2)])
def test_a_speed_counts_from_a_fiftieth_of_the_top_speed_on(arm, share, turns):
    # By hand: forwards, slowly backwards, forwards; one in a hundred samples may be faster than the top.
    v = np.concatenate([np.ones(100), -share * np.ones(50), np.ones(100), [50.0]])
    assert len(turning_points(swinging(arm, v), 1)) == turns
