"""CEA robot: model, operational space, rods and published values."""

# pyright: reportAttributeAccessIssue=false
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.devices import cea, cea_dynamics
from phantom_dyn.devices import cea as cea_loop
from phantom_dyn.devices.cea import INERTIAL, LinkLengths
from phantom_dyn.devices.cea_dynamics import felt, nearest_posture
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.dynamics.dynamics import mass_matrix as pinocchio_mass_matrix
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.errors import ParameterError
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.quantities import felt_at
from phantom_dyn.model.loading import load_robot
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
    with pytest.raises(ParameterError, match=r"The link length d4 is .*: give a number above 0"):
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
    with pytest.raises(
        ParameterError, match=r"'N m/grad' is no unit of the stiffness .* take one of N m/rad, N m/deg, N m/mrad"
    ):
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


ELBOW = np.deg2rad([[0.0, -45.0, 45.0]])  # right angle, as far out as up


def at(q2: float, q5: float) -> np.ndarray:
    return np.deg2rad([[0.0, q2, q5]])


def test_what_is_felt_is_that_of_the_map_of_the_robot_file(rng):
    # Oracle: phantom_dyn.maps, which knows the robot file and not these closed forms.
    q = rng.uniform(-np.pi, np.pi, (200, 3))
    model = map_model(load_robot("cea_branch"), stiffness=np.full(3, 450.0))
    values, singular = felt_at(model, q, ("apparent_mass", "coulomb_friction", "stiffness"))
    found = felt(q)
    assert not singular.any()
    np.testing.assert_allclose(found.mass, values["apparent_mass"], rtol=1e-8)
    np.testing.assert_allclose(found.coulomb, np.linalg.norm(values["coulomb_friction"], 2, axis=(1, 2)), rtol=1e-8)
    np.testing.assert_allclose(found.stiffness, np.diagonal(values["stiffness"], axis1=1, axis2=2), rtol=1e-8)


def test_at_a_right_angle_levers_are_links_and_reach():
    # Closed form: the links are the levers of q2 and q5, the reach that of q1.
    found = felt(ELBOW, lengths=LinkLengths(0.4, 0.4), stiffness=1000.0)
    assert found.coulomb[0] == pytest.approx(cea.COULOMB_FRICTION[1] / 0.4)
    np.testing.assert_allclose(found.stiffness[0], [1000 / 0.4**2, 1000 / 0.32, 1000 / 0.4**2])


@pytest.mark.parametrize(
    ("length", "mass", "coulomb"),
    [(0.40, 0.18, 0.310), (0.20, 0.74, 0.62)],
)
def test_equal_links_at_a_right_angle_match_mass_or_friction_but_not_both(length, mass, coulomb):
    # Known values for this posture; published are up to 0.65 kg and 0.3 to 0.4 N.
    found = felt(ELBOW, lengths=LinkLengths(length, length))
    assert found.mass[0] == pytest.approx(mass, rel=0.03)
    assert found.coulomb[0] == pytest.approx(coulomb, rel=0.005)


@pytest.mark.parametrize(
    ("lengths", "posture", "mass", "coulomb", "stiffest", "softest"),
    [
        (LinkLengths(0.400, 0.311), (-5, -111), 0.605, 0.410, 5438, 2695),
        (LinkLengths(0.592, 0.310), (-148, -50), 0.650, 0.392, 4975, 2118),
        (LinkLengths(0.479, 0.334), (170, 59), 0.650, 0.396, 5665, 1992),
    ],
    ids=["default", "longest", "between"],
)
def test_links_of_400_to_592_mm_have_the_published_sizes(lengths, posture, mass, coulomb, stiffest, softest):
    # Known fits to 0.65 kg, 0.3 to 0.4 N and 2000 to 5000 N/m, postures to a degree: 2 %.
    found = felt(at(*posture), lengths=lengths, stiffness=500.0 if lengths.d3 == 0.479 else 450.0)
    assert found.mass[0] == pytest.approx(mass, rel=0.02)
    assert found.coulomb[0] == pytest.approx(coulomb, rel=0.02)
    assert found.stiffness.max() == pytest.approx(stiffest, rel=0.02)
    assert found.stiffness.min() == pytest.approx(softest, rel=0.02)


def test_the_default_lengths_meet_the_published_ranges_at_the_nearest_posture():
    # Published: at most 0.65 kg, 0.3 to 0.4 N, 2000 to 5000 N/m.
    q, found = nearest_posture()
    np.testing.assert_allclose(np.rad2deg(q), [0, -15, -105], atol=1e-9)
    assert 0.45 < found.mass[0] < 0.65
    assert cea.COULOMB_RANGE_N[0] < found.coulomb[0] < cea.COULOMB_RANGE_N[1]
    assert found.stiffness.min() > cea.STIFFNESS_RANGE[0]
    assert found.stiffness.max() < cea.STIFFNESS_RANGE[1]


@pytest.mark.parametrize("lengths", [(0.35, 0.30), (0.40, 0.40), (0.479, 0.334), (0.592, 0.310)])
def test_other_lengths_meet_the_published_ranges_too(lengths):
    # So the lengths do not follow from what is published.
    _, found = nearest_posture(lengths=LinkLengths(*lengths))
    assert found.mass[0] < cea.MASS_RANGE_KG[1]
    assert cea.COULOMB_RANGE_N[0] < found.coulomb[0] < cea.COULOMB_RANGE_N[1]
    assert found.stiffness.min() > cea.STIFFNESS_RANGE[0]
    assert found.stiffness.max() < cea.STIFFNESS_RANGE[1]


@pytest.mark.parametrize("lengths", [(0.20, 0.20), (0.25, 0.25)])
def test_short_links_have_more_friction_than_published_everywhere(lengths):
    _, found = nearest_posture(lengths=LinkLengths(*lengths))
    assert found.coulomb[0] > 1.2 * cea.COULOMB_RANGE_N[1]


def test_the_printed_unit_makes_the_tip_a_thousand_times_too_soft():
    # Published: 2000 to 5000 N/m; K_tot is 1 N m/rad as printed.
    q, _ = nearest_posture()
    assert felt(q[None], stiffness=float(cea.joint_stiffness("N m/rad")[0])).stiffness.max() < 20


def test_the_reading_in_mrad_is_within_a_factor_of_about_two():
    q, _ = nearest_posture()
    stiffness = felt(q[None], stiffness=float(cea.joint_stiffness()[0])).stiffness
    assert stiffness.max() < 2.3 * cea.STIFFNESS_RANGE[1]
    assert stiffness.min() > cea.STIFFNESS_RANGE[0]


def test_a_stretched_arm_is_singular():
    found = felt(at(30, 30))
    assert np.isnan(found.mass[0])
    assert np.isnan(found.coulomb[0])
    assert np.isnan(found.stiffness).all()
