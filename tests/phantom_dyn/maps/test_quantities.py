"""Quantities at the tip. Oracles: published values, closed forms, independent formulas over Pinocchio."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.devices import phantom as closed
from phantom_dyn.dynamics.dynamics import gravity_torque, mass_matrix
from phantom_dyn.dynamics.kinematics import frame_jacobian
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.quantities import QUANTITIES, felt_at, require_quantities
from places import ROBOTS

ORIGIN = np.zeros((1, 3))


def felt(model, q, name):
    return felt_at(model, q, (name,))[0][name]


def test_the_apparent_mass_of_the_phantom_at_its_origin(phantom):
    # Published parameters: M11/l1^2, M22/l1^2, M33/l2^2 in kg.
    mass = felt(map_model(phantom), ORIGIN, "apparent_mass_matrix")[0]
    np.testing.assert_allclose(mass, np.diag([0.077306, 0.052491, 0.032245]), rtol=0, atol=5e-7)


def test_the_apparent_mass_is_the_largest_singular_value(phantom, configurations):
    # Oracle: numpy's singular values.
    q, model = configurations(phantom), map_model(phantom)
    expected = np.linalg.norm(felt(model, q, "apparent_mass_matrix"), ord=2, axis=(1, 2))
    np.testing.assert_allclose(felt(model, q, "apparent_mass"), expected, rtol=1e-12)


def test_the_manipulability_of_the_phantom_is_that_of_its_closed_form(phantom, configurations):
    q = configurations(phantom)
    expected = closed.manipulability(q)
    np.testing.assert_allclose(felt(map_model(phantom), q, "manipulability"), expected, rtol=1e-12)


def test_the_force_that_holds_the_weight_is_that_of_the_closed_form(phantom, configurations):
    q = configurations(phantom)
    J = closed.hybrid_jacobian(q)[:, :3]
    expected = np.linalg.solve(np.swapaxes(J, 1, 2), closed.gravity_torque(q)[..., None])[..., 0]
    np.testing.assert_allclose(felt(map_model(phantom), q, "gravity_force"), expected, rtol=0, atol=1e-12)


def test_stiffness_and_viscous_friction_are_those_of_the_joints_seen_through_the_jacobian(arm, configurations):
    # Closed form: K_op = J^-T K J^-1, and the same for friction.
    q = configurations(arm)
    K, c = np.array([3.0, 4.0, 500.0]), np.array([0.1, 0.2, 5.0])
    model = map_model(replace(arm, viscous_friction=c), stiffness=K)
    J = frame_jacobian(arm, q, model.frame, "hybrid")[:, :3]
    for name, joint in (("stiffness", K), ("viscous_friction", c)):
        back = np.linalg.inv(J)
        expected = np.swapaxes(back, 1, 2) @ np.diag(joint) @ back
        np.testing.assert_allclose(felt(model, q, name), expected, rtol=1e-9)


def test_coulomb_friction_is_the_force_that_the_joint_torques_make(arm, configurations):
    # Virtual work: the columns through J^T give each joint's torque alone.
    q, T = configurations(arm), np.array([0.3, 0.2, 4.0])
    model = map_model(replace(arm, coulomb_friction=T))
    J = frame_jacobian(arm, q, model.frame, "hybrid")[:, :3]
    torque = np.swapaxes(J, 1, 2) @ felt(model, q, "coulomb_friction")
    np.testing.assert_allclose(torque, np.broadcast_to(np.diag(T), torque.shape), rtol=0, atol=1e-12)


def test_the_largest_force_of_coulomb_friction_is_the_largest_singular_value(arm, configurations):
    # Oracle: numpy's singular values.
    q = configurations(arm)
    model = map_model(replace(arm, coulomb_friction=np.array([0.3, 0.2, 4.0])))
    sigma = np.linalg.svd(felt(model, q, "coulomb_friction"), compute_uv=False)
    np.testing.assert_allclose(felt(model, q, "coulomb_force"), sigma[:, 0], rtol=1e-9)


def test_friction_of_a_passive_joint_reaches_the_active_ones(phantom, configurations):
    # Closed form: the elbow turns by theta3 - theta2, so that c shows as c [[1, -1], [-1, 1]] on theta2 and theta3.
    q = configurations(phantom)
    chain = replace(phantom.chain, viscous_friction=np.array([0.01, 0.0]), coulomb_friction=np.array([0.02, 0.0]))
    model = map_model(replace(phantom, chain=chain))
    J = closed.hybrid_jacobian(q)[:, :3]
    joint = np.swapaxes(J, 1, 2) @ felt(model, q, "viscous_friction") @ J
    expected = 0.01 * np.array([[0, 0, 0], [0, 1, -1], [0, -1, 1]])
    np.testing.assert_allclose(joint, np.broadcast_to(expected, joint.shape), rtol=0, atol=1e-11)
    worst = np.swapaxes(J, 1, 2) @ felt(model, q, "coulomb_friction")
    np.testing.assert_allclose(
        worst, np.broadcast_to(np.diag([0, 0.02, 0.02]), worst.shape), rtol=0, atol=1e-11
    )  # near a singularity


def test_the_apparent_mass_of_a_redundant_arm_is_the_inverse_of_its_mobility(configurations):
    # Khatib: (J M^-1 J^T)^-1.
    robot = load_robot("example:panda")
    q, model = configurations(robot), map_model(robot)
    J, M = frame_jacobian(robot, q, model.frame, "hybrid")[:, :3], mass_matrix(robot, q)
    expected = np.linalg.inv(J @ np.linalg.solve(M, np.swapaxes(J, 1, 2)))
    np.testing.assert_allclose(felt(model, q, "apparent_mass_matrix"), expected, rtol=1e-8, atol=1e-10)


def test_the_stiffness_of_a_redundant_arm_is_the_inverse_of_its_compliance(configurations):
    # Compliances of joints in series add: (J K^-1 J^T)^-1.
    robot = load_robot("example:ur10")
    K = np.array([900.0, 800.0, 700.0, 60.0, 50.0, 40.0])
    q, model = configurations(robot), map_model(robot, stiffness=K)
    J = frame_jacobian(robot, q, model.frame, "hybrid")[:, :3]
    expected = np.linalg.inv(J / K @ np.swapaxes(J, 1, 2))
    np.testing.assert_allclose(felt(model, q, "stiffness"), expected, rtol=1e-8, atol=1e-6)


def test_the_weight_of_a_redundant_arm_felt_at_the_tip_is_what_stops_it_from_accelerating(configurations):
    # Known truth: released against this force, the tip does not accelerate.
    robot = load_robot("example:panda")
    q, model = configurations(robot), map_model(robot)
    J, M = frame_jacobian(robot, q, model.frame, "hybrid")[:, :3], mass_matrix(robot, q)
    force = felt(model, q, "gravity_force")
    a = np.linalg.solve(M, (np.einsum("nij,ni->nj", J, force) - gravity_torque(robot, q))[..., None])
    np.testing.assert_allclose((J @ a)[..., 0], 0, atol=1e-8)


def test_a_stretched_arm_is_singular(phantom):
    # Closed form: theta3 = theta2 + pi/2 stretches it, and cos(theta2 - theta3) in J vanishes.
    values, singular = felt_at(map_model(phantom), np.array([[0.1, 0.2, 0.2 + np.pi / 2]]), ("apparent_mass",))
    assert singular.tolist() == [True]
    assert np.isnan(values["apparent_mass"]).all()


def test_a_tip_on_the_axis_of_the_first_joint_is_singular(phantom):
    # Closed form: l1 cos(theta2) + l2 sin(theta3) = 0.
    q = np.array([[0.0, 0.5, -np.arcsin(0.215 * np.cos(0.5) / 0.17 * 0.9)]])
    q[0, 1] = np.arccos(-0.17 * np.sin(q[0, 2]) / 0.215)
    assert felt_at(map_model(phantom), q, ("manipulability",))[1].tolist() == [True]


def test_the_stiffness_of_the_cea_branch_is_the_published_one_in_the_reading_that_is_possible():
    # Published: 1 N m/rad in series, read in N m/mrad.
    model = map_model(load_robot("cea_branch"))
    assert model.stiffness.tolist() == pytest.approx([1000.0] * 3)
    assert "N m/mrad" in model.stiffness_note


def test_the_gains_of_position_controllers_count_as_stiffness(tmp_path):
    # Known truth: kp of robot.yaml.
    (tmp_path / "robot.urdf").write_text((ROBOTS / "arm3.urdf").read_text())
    gains = {"turn": 1.0, "tilt": 2.0, "slide": 3.0}
    rows = "".join(f"  {joint}: {{controller: {{kind: pd, kp: {kp}}}}}\n" for joint, kp in gains.items())
    (tmp_path / "robot.yaml").write_text(f"joints:\n{rows}")
    assert map_model(load_robot(tmp_path / "robot.urdf")).stiffness.tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda phantom: require_quantities(("stiffness",), map_model(phantom)),
            "Nothing states how stiff the joints of phantom_1_5 are",
            id="without a stated stiffness that quantity",
        ),
        pytest.param(
            lambda phantom: require_quantities(("aparent_mass",), map_model(phantom)),
            r"Unknown quantity 'aparent_mass'.*did you mean apparent_mass\?",
            id="an unknown quantity names the nearest",
        ),
        pytest.param(
            lambda phantom: map_model(phantom, stiffness=np.array([1.0, 2.0])),
            "does not fit phantom_1_5: give one number above 0 for each of theta1",
            id="a stiffness of another number of joints",
        ),
        pytest.param(
            lambda phantom: map_model(phantom, posture=np.array([0, np.nan, 0])),
            "does not fit phantom_1_5: give one number for each of theta1",
            id="a posture that is not finite",
        ),
    ],
)
def test_what_cannot_be_is_refused(phantom, call, message):
    with pytest.raises(ParameterError, match=message):
        call(phantom)


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        ("tipp", r"has no frame 'tipp'.*did you mean tip\?"),
        ("base", "The frame 'base' of phantom_1_5 does not move"),
    ],
)
def test_a_frame_that_is_unknown_or_does_not_move_is_refused(phantom, frame, said):
    with pytest.raises(RobotError, match=said):
        map_model(phantom, frame=frame)


def test_the_quantities_are_those_of_the_contract():
    assert set(QUANTITIES) == {
        "manipulability",
        "apparent_mass",
        "apparent_mass_matrix",
        "stiffness",
        "viscous_friction",
        "coulomb_friction",
        "coulomb_force",
        "gravity_force",
    }
