"""PHANToM: closed forms of kinematics and dynamics against its model file."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

from phantom_dyn.devices import phantom
from phantom_dyn.devices import phantom as closed
from phantom_dyn.devices.phantom import PHANTOM_1_5
from phantom_dyn.dynamics.dynamics import inverse_dynamics, mass_matrix
from phantom_dyn.model.inertia import payload_body
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

L1, L2 = 0.215, 0.170


@pytest.fixture
def q(rng):
    """Random joint angles in the assembly that is possible."""
    q = rng.uniform(-1.5, 1.5, (4000, 3))
    reach = L1 * np.cos(q[:, 1]) + L2 * np.sin(q[:, 2])
    return q[(np.abs(q[:, 2] - q[:, 1]) < np.pi / 2 - 1e-3) & (reach > 1e-3)]


def hat(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def turn(axis, point, angle):
    """Exponential of the twist of a rotation about ``axis`` through ``point``, as in section 2.1."""
    twist = np.zeros((4, 4))
    twist[:3, :3], twist[:3, 3] = hat(axis), -np.cross(axis, point)
    return expm(twist * angle)


def test_the_tip_is_where_the_product_of_exponentials_puts_it(q):
    y, x, base, shoulder = np.eye(3)[1], -np.eye(3)[0], [0, 0, -L1], [0, L2, -L1]
    for row, tip, rotation in zip(q[:300], phantom.tip_position(q), phantom.tip_rotation(q), strict=False):
        first = turn(y, base, row[0])
        elbow = first @ turn(x, shoulder, row[1]) @ [0, L2, 0, 1]
        R = first[:3, :3] @ turn(x, [0, 0, 0], row[2])[:3, :3]
        np.testing.assert_allclose(rotation, R, rtol=0, atol=1e-14)
        np.testing.assert_allclose(tip, elbow[:3] + R @ [0, -L2, 0], rtol=0, atol=1e-14)


def test_inverse_kinematics_gives_back_the_angles(q):
    # Round trip; the limit is that of acos near a stretched arm.
    np.testing.assert_allclose(phantom.inverse_kinematics(phantom.tip_position(q)), q, rtol=0, atol=1e-11)


def test_outside_the_possible_assembly_the_published_inverse_gives_the_other_one():
    # Closed form: the elbow folded to the other side reaches the same point.
    folded = np.array([[0.2, -0.3, -0.3 + 1.8]])
    back = phantom.inverse_kinematics(phantom.tip_position(folded))
    np.testing.assert_allclose(phantom.tip_position(back), phantom.tip_position(folded), rtol=0, atol=1e-15)
    assert abs(back[0, 2] - back[0, 1]) < np.pi / 2
    assert back[0, 2] - back[0, 1] == pytest.approx(np.pi - 1.8)


def test_other_sizes_of_the_family_have_their_own_kinematics(q):
    # Round trip with other lengths.
    longer = replace(PHANTOM_1_5, l1=0.4, l2=0.45)
    kept = q[(0.4 * np.cos(q[:, 1]) + 0.45 * np.sin(q[:, 2])) > 1e-3]
    back = phantom.inverse_kinematics(phantom.tip_position(kept, longer), longer)
    np.testing.assert_allclose(back, kept, rtol=0, atol=1e-11)


def test_a_point_out_of_reach_has_no_angles():
    # Closed form: the shoulder is at (0, l2, -l1), and the stretched arm ends l1 + l2 from it.
    too_far = [[0, L2, -L1 + L1 + L2 + 1e-6]]
    assert np.isnan(phantom.inverse_kinematics(np.array(too_far))).all()


@pytest.mark.parametrize("degrees", [-13.3, -6.0, 0.0, 76.7, 83.0, 90.0])
def test_the_manipulability_is_34_43_on_both_stretches_of_its_curve(degrees):
    # Closed form: with theta2 = theta3 the singular values are l1, l2 and one between them.
    angle = np.radians(degrees)
    assert phantom.manipulability(np.array([[0.3, angle, angle]]))[0] == pytest.approx(34 / 43, abs=1e-14)


@pytest.mark.parametrize("degrees", [-13.4, 0.1, 40.0, 76.6, 90.1])
def test_the_manipulability_is_smaller_beside_its_curve(degrees):
    # Closed form: l1 cos(theta) + l2 sin(theta) leaves the interval from l2 to l1.
    angle = np.radians(degrees)
    assert phantom.manipulability(np.array([[0.3, angle, angle]]))[0] < 34 / 43 - 1e-5


def test_no_configuration_is_more_manipulable_than_34_43(q):
    # Closed form: the ratio of the two lengths.
    assert phantom.manipulability(q).max() <= 34 / 43 + 1e-14


COUPLING = 0.215 * (0.170 * 0.0202 + 0.0325 * 0.0249)

V = np.array([[1.0, 2.0, 3.0]])


def row(*angles):
    return np.array([angles])


@pytest.fixture(scope="module")
def robot():
    return load_robot("phantom_1_5")


@pytest.fixture
def states(rng):
    """Positions, velocities and accelerations of 300 samples."""
    return rng.uniform(-1.2, 1.2, (300, 3)), 5 * rng.normal(size=(300, 3)), 50 * rng.normal(size=(300, 3))


def by_christoffel(q, v):
    """C of one state from central differences of M."""
    step = 1e-5
    dM = [
        (closed.mass_matrix(q + step * e) - closed.mass_matrix(q - step * e))[0] / (2 * step)
        for e in np.eye(3)[:, None, :]
    ]
    dM = np.array(dM)  # derivative, row, column
    symbols = (np.moveaxis(dM, 0, 2) + np.moveaxis(dM, 0, 1) - dM) / 2
    return symbols @ v[0]


@pytest.mark.parametrize(
    ("angles", "m11", "m23", "gravity"),
    [
        ((0.3, 0.4, -0.5), 3.0071654408698662e-3, -3.5731408024725807e-4, (0, -1.5011488646e-2, 3.5360131135e-2)),
        ((0.2, 0.3, 0.4), 3.8338255451567105e-3, 4.553895060756527e-5, (0, -1.5570112027e-2, -2.8721631498e-2)),
    ],
)
def test_mass_and_gravity_at_two_reference_configurations(angles, m11, m23, gravity):
    # Published formulas evaluated symbolically.
    M = closed.mass_matrix(row(*angles))[0]
    assert (M[0, 0], M[1, 2], M[2, 1]) == pytest.approx((m11, m23, m23), rel=1e-12)
    np.testing.assert_allclose(closed.gravity_torque(row(*angles))[0], gravity, rtol=0, atol=1e-12)


def test_the_mass_matrix_is_positive_definite_and_between_its_published_bounds(rng):
    # Symbolic bounds of the eigenvalues for upper arm and forearm within 1.2 rad.
    q = rng.uniform(-1.2, 1.2, (20000, 3))
    q = q[np.abs(q[:, 2] - q[:, 1]) < np.pi / 2]
    values = np.linalg.eigvalsh(closed.mass_matrix(q))
    assert 8.035e-4 <= values.min() < 8.1e-4
    assert 5.0e-3 < values.max() <= 5.104e-3


def test_the_coriolis_matrix_is_the_christoffel_matrix(states):
    # Finite differences of M.
    q, v, _ = states
    for k in range(50):
        C = closed.coriolis_matrix(q[k : k + 1], v[k : k + 1])[0]
        np.testing.assert_allclose(C, by_christoffel(q[k : k + 1], v[k : k + 1]), rtol=0, atol=1e-10)


def _asymmetry(q, v, C):
    """What is symmetric in dM/dt - 2 C, with dM/dt by finite differences."""
    step = 1e-5
    rate = (closed.mass_matrix(q + step * v) - closed.mass_matrix(q - step * v)) / (2 * step)
    skew = rate - 2 * C
    return skew + np.swapaxes(skew, 1, 2)


def test_with_the_printed_sign_of_c32_it_is_not_skew_and_the_torque_is_wrong():
    # Closed form of both errors: 2 P cos(theta2 - theta3) v2 in C, P cos(theta2 - theta3) v2^2 in the torque.
    q = row(0.3, 0.4, 0.4)
    printed = closed.coriolis_matrix(q, V)
    printed[0, 2, 1] *= -1
    assert _asymmetry(q, V, printed)[0, 1, 2] == pytest.approx(-2 * COUPLING * V[0, 1], rel=1e-6)
    error = (closed.coriolis_matrix(q, V)[0] - printed[0]) @ V[0]
    assert error[2] == pytest.approx(-9.123e-4 * V[0, 1] ** 2, rel=1e-4)


def test_the_closed_form_mass_matrix_is_the_projected_one_of_pinocchio(robot, states):
    q = states[0]
    np.testing.assert_allclose(mass_matrix(robot, q), closed.mass_matrix(q), rtol=0, atol=1e-14)


def test_the_closed_form_torque_is_the_projected_one_of_pinocchio(robot, states):
    q, v, a = states
    M, C = closed.mass_matrix(q), closed.coriolis_matrix(q, v)
    expected = np.einsum("nij,nj->ni", M, a) + np.einsum("nij,nj->ni", C, v) + closed.gravity_torque(q)
    tau = inverse_dynamics(robot, Motion(np.arange(len(q)) * 1.0, q, v, a))
    np.testing.assert_allclose(tau, expected, rtol=0, atol=1e-13)


def test_its_joints_are_those_of_the_contract(robot):
    assert robot.joint_names == ("theta1", "theta2", "theta3")
    assert robot.passive_names == ("elbow", "crank")


def test_the_tree_is_built_depth_first(robot):
    # Pinocchio's rule: a subtree has consecutive joints; otherwise its mass matrix is silently wrong.
    assert tuple(robot.model.names)[1:] == ("theta1", "theta2", "elbow", "theta3", "crank")


def _rebuilt(tree, order, parents):
    """Mass matrix on the active joints, without rotors, of the same links with their joints added in another order."""
    model = pin.Model()
    for old, parent in zip(order, parents, strict=True):
        kind = pin.JointModelRY() if old == 1 else pin.JointModelRevoluteUnaligned(np.array([-1.0, 0, 0]))
        new = model.addJoint(parent, kind, tree.jointPlacements[old], str(old))
        model.appendBodyToJoint(new, tree.inertias[old], pin.SE3.Identity())
    S = np.array([[1, 0, 0], [0, 1, 0], [0, -1, 1], [0, 0, 1], [0, 1, -1]])[np.array(order) - 1]
    upper = np.triu(pin.crba(model, model.createData(), S @ np.array([0.3, 0.4, -0.5])))
    return S.T @ (upper + np.triu(upper, 1).T) @ S


@pytest.mark.parametrize(
    ("order", "parents", "right"),
    [((1, 2, 3, 4, 5), (0, 1, 2, 1, 4), True), ((1, 2, 4, 5, 3), (0, 1, 1, 3, 2), False)],
    ids=["depth first", "parallel link before forearm"],
)
def test_pinocchio_computes_the_mass_matrix_of_joints_that_were_added_depth_first_only(robot, order, parents, right):
    # Known trap, against the closed form: in the other order it is wrong without a complaint.
    rotors = np.diag([0, PHANTOM_1_5.rotor_inertia, PHANTOM_1_5.rotor_inertia])
    error = _rebuilt(robot.model, order, parents) + rotors - closed.mass_matrix(row(0.3, 0.4, -0.5))[0]
    assert bool(np.abs(error).max() < 1e-15) is right


def test_every_link_can_exist(robot):
    # Triangle inequality; loading warns of links that break it.
    assert robot.warnings == ()


def test_the_published_slack_of_both_links_with_the_rotor_taken_out():
    # Symbolic: 3.98e-6 kg m2 on the tighter one, for a rotor of 1.45325e-4 at the joint.
    slack = [sum(m) - 2 * max(m) for m in (PHANTOM_1_5.link_inertia_be, PHANTOM_1_5.link_inertia_df)]
    assert min(slack) == pytest.approx(3.98e-6, abs=0.01e-6)


@pytest.mark.parametrize(("link", "excess"), [("link_inertia_be", 4.39e-5), ("link_inertia_df", 2.35e-5)])
def test_the_printed_inertias_with_the_rotor_in_the_link_break_the_triangle_inequality(link, excess):
    # Published values: I_xx exceeds I_yy + I_zz.
    x, y, z = getattr(replace(PHANTOM_1_5, rotor_inertia=0.0), link)
    assert x - y - z == pytest.approx(excess, rel=2e-3)


@pytest.mark.parametrize(
    ("link", "least", "most"),
    [("link_inertia_be", 3.263e-7, 1.2046e-6), ("link_inertia_df", 1.747e-7, 1.1095e-6)],
    ids=["BE", "DF"],
)
def test_each_link_is_a_possible_body_for_its_own_range_of_the_rotor_only(link, least, most):
    # Symbolic: range of the rotor's moment on the motor's side [kg m2]; both links from 3.263e-7 to 1.1095e-6.
    def possible(rotor):
        moments = getattr(replace(PHANTOM_1_5, rotor_inertia=rotor * 11.6**2), link)
        return 2 * max(moments) <= sum(moments)

    tried = [possible(rotor) for rotor in (0.999 * least, 1.001 * least, 0.999 * most, 1.001 * most)]
    assert tried == [False, True, True, False]


def test_the_rotor_at_the_joint_and_the_links_without_it():
    # Published values less the rotor and less m l^2, in 1e-4 kg m2.
    assert PHANTOM_1_5.rotor_inertia == pytest.approx(1.45325e-4, rel=1e-5)
    np.testing.assert_allclose(PHANTOM_1_5.link_inertia_be, [6.4421e-4, 6.8653e-4, 0.591e-4], rtol=1e-5)
    np.testing.assert_allclose(PHANTOM_1_5.link_inertia_df, [0.36324e-4, 0.629e-4, 0.95249e-4], rtol=1e-5)


def test_forearm_and_parallel_link_are_thin_rods_about_their_middle():
    # Closed form: m l^2 / 12.
    assert PHANTOM_1_5.inertia_a[0] == pytest.approx(0.0202 * 0.170**2 / 12, rel=2e-4)
    assert PHANTOM_1_5.inertia_c[0] == pytest.approx(0.0249 * 0.215**2 / 12, rel=2e-4)


@pytest.mark.parametrize(("entry", "more", "share"), [(1, 3.195e-4, 0.13), (2, 5.294e-4, 0.57)], ids=["M22", "M33"])
def test_moments_about_the_centre_of_mass_would_raise_the_published_mass_matrix(entry, more, share):
    # Parallel axes: m_be l5^2 and m_df l6^2, which the published M does not have.
    shift = (PHANTOM_1_5.m_be * PHANTOM_1_5.l5**2, PHANTOM_1_5.m_df * PHANTOM_1_5.l6**2)[entry - 1]
    M = closed.mass_matrix(np.zeros((1, 3)))[0, entry, entry]
    assert shift == pytest.approx(more, rel=1e-3)
    assert shift / M == pytest.approx(share, abs=0.01)


def test_a_payload_of_the_built_in_sits_on_the_forearm_that_carries_the_tip():
    # Oracle: the URDF, whose fixed joint tip_mount hangs the tip on the forearm, the child of the joint elbow.
    robot = load_robot("phantom_1_5")
    assert robot.payload_frame == "tip"
    assert robot.model.names[payload_body(robot)] == "elbow"
