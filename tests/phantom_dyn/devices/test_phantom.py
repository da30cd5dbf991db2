"""PHANToM 1.5: kinematics. Oracles: product of exponentials, finite differences, round trip, published values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from phantom_dyn.devices import phantom
from phantom_dyn.devices.phantom import PHANTOM_1_5

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


def test_the_tip_is_at_the_origin_in_the_zero_configuration():
    # Published: the origin of the frame of figure 1.
    np.testing.assert_allclose(phantom.tip_position(np.zeros((1, 3))), 0, atol=1e-16)


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


def test_the_body_jacobian_is_the_derivative_of_the_pose(q):
    # Finite differences of position and rotation, in the body's axes.
    step, J = 1e-6, phantom.body_jacobian(q)
    R = phantom.tip_rotation(q)
    for joint in range(3):
        shift = step * np.eye(3)[joint]
        dp = (phantom.tip_position(q + shift) - phantom.tip_position(q - shift)) / (2 * step)
        dR = (phantom.tip_rotation(q + shift) - phantom.tip_rotation(q - shift)) / (2 * step)
        w = np.einsum("nji,njk->nik", R, dR)
        body = np.column_stack([np.einsum("nji,nj->ni", R, dp), w[:, 2, 1], w[:, 0, 2], w[:, 1, 0]])
        np.testing.assert_allclose(J[:, :, joint], body, rtol=0, atol=1e-9)


def test_the_translational_jacobian_at_the_origin_is_l1_l1_l2():
    # Published lengths.
    J = phantom.body_jacobian(np.zeros((1, 3)))[0, :3]
    np.testing.assert_allclose(J, np.diag([0.215, 0.215, 0.170]), rtol=0, atol=1e-16)


def test_the_hybrid_jacobian_gives_the_velocity_of_the_tip(q, rng):
    # Finite differences.
    v = rng.normal(size=q.shape)
    change = (phantom.tip_position(q + 1e-6 * v) - phantom.tip_position(q - 1e-6 * v)) / 2e-6
    velocity = np.einsum("nij,nj->ni", phantom.hybrid_jacobian(q), v)[:, :3]
    np.testing.assert_allclose(velocity, change, rtol=0, atol=1e-9)


def test_the_torque_of_a_wrench_does_the_work_of_the_wrench(q, rng):
    # Virtual work, with the twist by finite differences of the pose.
    v, wrench = rng.normal(size=q.shape), rng.normal(size=(len(q), 6))
    ahead, behind, step = q + 1e-6 * v, q - 1e-6 * v, 2e-6
    velocity = (phantom.tip_position(ahead) - phantom.tip_position(behind)) / step
    change = (phantom.tip_rotation(ahead) - phantom.tip_rotation(behind)) / step
    w = np.einsum("nij,nkj->nik", change, phantom.tip_rotation(q))
    twist = np.column_stack([velocity, w[:, 2, 1], w[:, 0, 2], w[:, 1, 0]])
    work = np.sum(phantom.wrench_torque(q, wrench) * v, axis=1)
    np.testing.assert_allclose(work, np.sum(wrench * twist, axis=1), rtol=0, atol=1e-8)


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


def test_the_ends_of_the_curve_are_where_the_reach_is_l1_or_l2():
    # Published angles -13.333 and 76.667 degrees.
    for degrees in (-13.333, 76.667):
        angle = np.radians(degrees)
        reach = L1 * np.cos(angle) + L2 * np.sin(angle)
        assert min(abs(reach - L1), abs(reach - L2)) < 2e-6


def test_no_configuration_is_more_manipulable_than_34_43(q):
    # Closed form: the ratio of the two lengths.
    assert phantom.manipulability(q).max() <= 34 / 43 + 1e-14
