# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn import load_robot
from phantom_dyn.devices import cea, cea_dynamics
from phantom_dyn.devices import cea as cea_loop
from phantom_dyn.devices.cea import INERTIAL, LinkLengths
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.dynamics.dynamics import mass_matrix as pinocchio_mass_matrix
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion

LENGTHS = LinkLengths(0.37, 0.29, 0.09)  # other than the default, so that no length can stand for another


@pytest.fixture(scope="module")
def robot():
    return load_robot("cea_branch")


def some_motion(rng, samples=40) -> Motion:
    return Motion(np.arange(samples) * 0.01, *rng.uniform(-2.5, 2.5, (3, samples, 3)))


# Geometry


def test_the_loop_closes_with_d8_equal_to_plus_d6(rng):
    for q in rng.uniform(-np.pi, np.pi, (50, 3)):
        distance, turn = cea_loop.closure_error(q, cea_loop.table_1(LENGTHS))
        assert distance < 1e-15
        assert turn < 1e-15


def test_the_loop_misses_closure_by_twice_d6_with_the_printed_d8(rng):
    *rows, last = cea_loop.table_1(LENGTHS)
    printed = (*rows, replace(last, length=-LENGTHS.d6))
    for q in rng.uniform(-np.pi, np.pi, (20, 3)):
        assert cea_loop.closure_error(q, printed)[0] == pytest.approx(2 * LENGTHS.d6)


def test_arm_and_rod_and_lever_and_forearm_stay_parallel(rng):
    # Published: the orientations 2A6 and 3A5 are the identity.
    for q in rng.uniform(-np.pi, np.pi, (20, 3)):
        T = cea_loop.frames(q, cea_loop.table_1(LENGTHS))[:, :3, :3]
        np.testing.assert_allclose(T[2].T @ T[6], np.eye(3), atol=1e-15)
        np.testing.assert_allclose(T[3].T @ T[5], np.eye(3), atol=1e-15)


def test_the_support_of_the_handle_keeps_its_orientation_to_the_shoulder(rng):
    for q in rng.uniform(-np.pi, np.pi, (20, 3)):
        T = cea_loop.frames(q, cea_loop.table_1(LENGTHS))[:, :3, :3]
        np.testing.assert_allclose(T[1].T @ T[4], [[0, -1, 0], [0, 0, 1], [-1, 0, 0]], atol=1e-15)


def test_the_tip_is_the_origin_of_frame_4_of_the_table(rng):
    q = rng.uniform(-np.pi, np.pi, (20, 3))
    table = [cea_loop.frames(row, cea_loop.table_1(LENGTHS))[4][:3, 3] for row in q]
    np.testing.assert_allclose(cea.tip_position(q, LENGTHS), table, atol=1e-15)


def test_the_jacobian_is_the_slope_of_the_tip(rng):
    # Oracle: central differences.
    q, h = rng.uniform(-np.pi, np.pi, (20, 3)), 1e-6
    slope = [(cea.tip_position(q + h * e, LENGTHS) - cea.tip_position(q - h * e, LENGTHS)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(cea.tip_jacobian(q, LENGTHS), np.stack(slope, axis=2), atol=1e-9)


def test_the_tip_of_the_robot_file_is_that_of_the_closed_form(robot, rng):
    # Oracle: Pinocchio.
    motion = some_motion(rng, 10)
    data, tree = robot.model.createData(), tree_motion(robot, motion)
    for q, tip in zip(tree.configuration, cea.tip_position(motion.q), strict=True):
        pin.framesForwardKinematics(robot.model, data, q)
        np.testing.assert_allclose(data.oMf[robot.model.getFrameId("tip")].translation, tip, atol=1e-14)


def test_the_loop_of_the_robot_file_is_closed(robot, rng):
    # Oracle: Pinocchio; the pins of joints 7 and 8 coincide.
    data, tree = robot.model.createData(), tree_motion(robot, some_motion(rng, 10))
    for q in tree.configuration:
        pin.framesForwardKinematics(robot.model, data, q)
        pins = [data.oMf[robot.model.getFrameId(name)].homogeneous[:3] for name in ("pin6", "pin3")]
        # Joint 7 turns the rod's pin by q7 = q3, which a frame fixed on the rod does not have.
        np.testing.assert_allclose(pins[0][:, 3], pins[1][:, 3], atol=1e-15)


def test_the_robot_file_has_the_joints_of_the_source(robot):
    assert (robot.joint_names, robot.passive_names) == (("q1", "q2", "q5"), ("q3", "q4", "q6"))


def test_the_robot_file_is_physically_possible(robot):
    assert robot.warnings == ()
    bodies = [pin.PseudoInertia.FromInertia(body).toMatrix() for body in list(robot.model.inertias)[1:]]
    assert np.linalg.eigvalsh(bodies).min() > 0


def test_passive_angles_are_those_of_the_loops_of_the_robot_file(robot, rng):
    motion = some_motion(rng, 10)
    np.testing.assert_allclose(tree_motion(robot, motion).q[:, [2, 3, 5]], cea.passive_positions(motion.q)[:, :3])


@pytest.mark.parametrize("length", [0.0, -0.1, np.nan])
def test_a_length_that_is_not_positive_is_refused(length):
    with pytest.raises(ParameterError, match=r"The link length d4 is .* m: give a positive length"):
        LinkLengths(d4=length)


# Dynamics


def test_the_closed_form_torque_is_that_of_the_robot_file(robot, rng):
    # Oracle: Pinocchio's inverse dynamics of the tree, projected; the file states no offsets.
    motion = some_motion(rng)
    parameters = np.where([name.startswith("OFF") for name in cea_dynamics.NAMES], 0.0, cea_dynamics.VALUES)
    torque = cea_dynamics.regressor(motion) @ parameters
    np.testing.assert_allclose(torque, inverse_dynamics(robot, motion), atol=1e-11)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (-9.81, 0.0, 0.0), (3.0, -4.0, -8.0)])
def test_gravity_in_any_direction_is_that_of_pinocchio(robot, rng, gravity):
    motion = some_motion(rng)
    inertial = np.where([name[0] in "FO" for name in cea_dynamics.NAMES], 0.0, cea_dynamics.VALUES)
    still = replace(robot, viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))
    still.model.gravity = pin.Motion(np.array(gravity), np.zeros(3))
    torque = cea_dynamics.regressor(motion, gravity=gravity) @ inertial
    np.testing.assert_allclose(torque, inverse_dynamics(still, motion), atol=1e-11)


def test_the_closed_form_mass_matrix_is_that_of_the_robot_file(robot, rng):
    q = some_motion(rng).q
    np.testing.assert_allclose(cea_dynamics.mass_matrix(q), pinocchio_mass_matrix(robot, q), atol=1e-12)


def test_a_column_of_the_regressor_is_the_torque_of_its_parameter(rng):
    # Closed form: offset, friction and gravity of the shoulder at rest.
    motion = Motion(np.zeros(1), np.array([[0.3, 0.1, 0.2]]), np.array([[1.0, -2.0, 0.5]]), np.zeros((1, 3)))
    D = dict(zip(cea_dynamics.NAMES, cea_dynamics.regressor(motion)[0].T, strict=True))
    np.testing.assert_allclose(D["OFF5"], [0, 0, 1])
    np.testing.assert_allclose(D["FV2R"], [0, -2, 0])
    np.testing.assert_allclose(D["FS2"], [0, -1, 0])
    np.testing.assert_allclose(D["MY1R"], [-9.81 * np.sin(0.3), 0, 0])


def test_the_longest_arm_is_632_millimetres():
    assert cea_dynamics.longest_arm() == pytest.approx(0.632, abs=5e-4)


def test_up_to_the_longest_arm_the_mass_matrix_is_positive_definite(rng):
    q = rng.uniform(-np.pi, np.pi, (2000, 3))
    assert np.linalg.eigvalsh(cea_dynamics.mass_matrix(q, lengths=LinkLengths(0.631))).min() > 0


def test_a_longer_arm_is_refused():
    with pytest.raises(ParameterError, match=r"arm of d3 = 0\.64 m .* not positive definite: give less than 0\.632 m"):
        cea_dynamics.mass_matrix(np.zeros((1, 3)), lengths=LinkLengths(0.64))


# Published numbers


def test_table_4_has_16_parameters():
    assert len(INERTIAL) == 16


def test_the_deviation_of_a_negative_value_is_positive():
    # (7) as printed divides by the value itself.
    assert INERTIAL["MX3R"].std == pytest.approx(0.0310 * 0.00413)


def test_viscous_friction_of_table_4_is_15_to_60_per_cent_above_table_3():
    pairs = (("FV1", ["FV1"]), ("FV2R", ["FV2t1", "FV2t2"]), ("FV5R", ["FV5t1", "FV5t3"]))
    for name, tests in pairs:
        mean = np.mean([cea.FRICTION_TESTS[test].value for test in tests])
        assert 1.14 < INERTIAL[name].value / mean < 1.65


@pytest.mark.parametrize(("unit", "total"), [("N m/rad", 1.0), ("N m/deg", 57.2958), ("N m/mrad", 1000.0)])
def test_transmission_and_motor_in_series_have_half_the_stiffness(unit, total):
    # (19) with the printed 2 and 2.
    np.testing.assert_allclose(cea.joint_stiffness(unit), total, rtol=1e-5)


def test_an_unknown_reading_of_the_stiffness_is_refused():
    with pytest.raises(ParameterError, match=r"'N m/grad' is no reading .* take one of N m/rad, N m/deg, N m/mrad"):
        cea.joint_stiffness("N m/grad")


@pytest.mark.parametrize(
    ("unit", "resonances"),
    [("N m/rad", (1.00, 1.31, 1.97)), ("N m/deg", (7.5, 9.9, 14.9)), ("N m/mrad", (31.5, 41.4, 62.4))],
)
def test_the_resonances_of_each_reading_of_the_stiffness(unit, resonances):
    # Closed form with the inertias of Table 4; the source says about 20 Hz.
    stiffness = cea.STIFFNESS_UNITS[unit] * cea.TRANSMISSION_STIFFNESS["K1"].value
    found = [cea.resonance_hz(stiffness, INERTIAL[name].value) for name in ("ZZ1R", "ZZ2R", "ZZ3R")]
    np.testing.assert_allclose(found, resonances, rtol=0.006)


def levers(unit: str) -> np.ndarray:
    """Lever [m] at which a joint has the stiffest and the softest published value."""
    return np.sqrt(cea.joint_stiffness(unit)[0] / np.array(cea.STIFFNESS_RANGE[::-1]))


def test_the_printed_unit_of_the_stiffness_is_impossible():
    # The levers of a joint lie between the link lengths and the reach: 14 to 22 mm is no arm of a 200 mm workspace.
    np.testing.assert_allclose(levers("N m/rad"), [0.0141, 0.0224], rtol=0.01)
    assert levers("N m/rad").max() < 0.2 * min(cea.LENGTHS.d3, cea.LENGTHS.d4)


def test_only_the_reading_in_mrad_is_within_a_factor_of_two_of_the_lever_that_friction_says():
    # 0.12 N m of Coulomb friction are 0.3 to 0.4 N at the tip: a lever of 0.3 to 0.4 m.
    lever = np.mean(0.12 / np.array(cea.COULOMB_RANGE_N))
    assert [unit for unit in cea.STIFFNESS_UNITS if 0.5 < levers(unit).mean() / lever < 2] == ["N m/mrad"]
