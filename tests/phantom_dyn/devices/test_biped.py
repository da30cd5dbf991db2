# pyright: reportAttributeAccessIssue=false
import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.devices import biped
from phantom_dyn.devices.biped import BipedLengths
from phantom_dyn.errors import ParameterError

# All different, so that no length can stand for another.
LENGTHS = BipedLengths(0.11, 0.13, 0.21, 0.14, 0.12, 0.05, 0.09)
# Both legs straight, the second one down: the foot points forward.
UPRIGHT = np.array([[np.pi / 2, 0.0, -np.pi / 2, -np.pi / 2, 0.0, np.pi / 2]])


def some_posture(rng, samples=30):
    return UPRIGHT + rng.uniform(-0.6, 0.6, (samples, 6)), rng.uniform(-0.3, 0.3, samples)


def pinocchio_points(theta, beta, side=-1.0):
    """Oracle: a tree of joints that leans each leg about x and bends it about y."""
    model = pin.Model()
    l1, l2, _, l4, l5, l6 = LENGTHS.sagittal

    def along(length):
        return pin.SE3(np.eye(3), np.array([length, 0.0, 0.0]))

    def add(parent, kind, placement, name):
        return model.addJoint(parent, kind, placement, name)

    still = pin.SE3.Identity()
    lean = add(0, pin.JointModelRX(), still, "lean")
    shank = add(lean, pin.JointModelRY(), still, "ankle")
    thigh = add(shank, pin.JointModelRY(), along(l1), "knee")
    level = add(thigh, pin.JointModelRY(), along(l2), "hip")  # undoes the bending
    pelvis = add(level, pin.JointModelRX(), still, "hip lean")  # undoes the leaning
    other = add(pelvis, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, side * LENGTHS.pelvis, 0.0])), "lean 2")
    thigh_2 = add(other, pin.JointModelRY(), still, "hip 2")
    shank_2 = add(thigh_2, pin.JointModelRY(), along(l4), "knee 2")
    ankle_2 = add(shank_2, pin.JointModelRY(), along(l5), "ankle 2")  # undoes the bending
    ankle_lean = add(ankle_2, pin.JointModelRX(), still, "ankle lean 2")  # undoes the leaning
    foot = add(ankle_lean, pin.JointModelRY(), still, "foot")
    model.addFrame(pin.Frame("toe", foot, along(l6), pin.FrameType.OP_FRAME))
    data = model.createData()
    rows = []
    for (t1, t2, t3, t4, t5, t6), b in zip(theta, beta, strict=True):
        # A positive sagittal angle lifts x towards z: minus about y. A lean to the left is minus about x.
        thigh_angle = t1 + t2 + t3 + t4
        q = [-b, -t1, -t2, t1 + t2, b, -b, -thigh_angle, -t5, thigh_angle + t5, b, -(thigh_angle + t5 + t6)]
        pin.framesForwardKinematics(model, data, np.array(q))
        joints = [shank, thigh, level, thigh_2, shank_2, ankle_2]
        rows.append(
            [data.oMi[j].translation.copy() for j in joints] + [data.oMf[model.getFrameId("toe")].translation.copy()]
        )
    return np.array(rows)


def test_true_coordinates_are_those_of_a_rigid_chain_in_pinocchio(rng):
    theta, beta = some_posture(rng)
    np.testing.assert_allclose(
        biped.true_joint_coordinates(LENGTHS, theta, beta), pinocchio_points(theta, beta), atol=1e-14
    )


def test_coordinates_by_projection_are_exact_where_no_link_leans_out_of_the_sagittal_plane(rng):
    theta, _ = some_posture(rng)
    flat = np.zeros(len(theta))
    points = biped.joint_coordinates(LENGTHS, theta, flat)
    np.testing.assert_allclose(points, pinocchio_points(theta, flat), atol=1e-14)


def test_the_surviving_rows_of_equation_3_hold(rng):
    # Closed form, written out from the groups of symbols that survive in the fragment.
    theta, beta = some_posture(rng, 1)
    points = biped.joint_coordinates(LENGTHS, theta, beta)[0]
    s, c = biped.sagittal_lengths(LENGTHS, beta)[0], biped.coronal_lengths(LENGTHS, theta)[0]
    sums, b = np.cumsum(theta[0]), beta[0]
    expected = [np.zeros(3)]
    for i in range(6):
        x, y, z = expected[-1]
        if i == 2:
            expected.append(np.array([x, y - LENGTHS.pelvis, z]))
        else:
            expected.append(np.array([x + s[i] * np.cos(sums[i]), y + c[i] * np.sin(b), z + s[i] * np.sin(sums[i])]))
    np.testing.assert_allclose(points[:6], expected[:6], atol=1e-15)
    # The last row has y6 = y5.
    np.testing.assert_allclose(points[6], [expected[6][0], points[5, 1], expected[6][2]], atol=1e-15)


def test_the_projected_lengths_are_those_of_equation_1():
    beta = np.array([0.2])
    leg = np.cos(0.2)
    expected = [0.11 * leg, 0.13 * leg, 0.21, 0.14 * leg, 0.12 * leg, 0.05]
    np.testing.assert_allclose(biped.sagittal_lengths(LENGTHS, beta), [expected], atol=1e-15)


def test_a_projected_link_is_too_short():
    # The length of a link at 10 degrees lean and 10 degrees from upright.
    phi, beta = np.radians(80.0), np.array([np.radians(10.0)])
    theta = UPRIGHT.copy()
    theta[0, 0] = phi
    points = biped.joint_coordinates(BipedLengths(shank_support=1.0), theta, beta)
    length = np.linalg.norm(points[0, 1])
    exact = np.sqrt(np.sin(phi) ** 2 + np.cos(phi) ** 2 * np.cos(beta[0]) ** 2)
    assert length == pytest.approx(exact)
    assert length < 1


def test_right_support_is_the_mirror_of_left_support(rng):
    theta, beta = some_posture(rng)
    left = biped.joint_coordinates(LENGTHS, theta, beta)
    right = biped.joint_coordinates(LENGTHS, theta, -beta, support="right")
    np.testing.assert_allclose(right, left * [1, -1, 1], atol=1e-15)


# Turning


def test_a_turn_on_the_support_is_equation_5_written_out(rng):
    theta, beta = some_posture(rng)
    psi = rng.uniform(-1, 1, len(beta))
    points = biped.joint_coordinates(LENGTHS, theta, beta)
    turned = biped.turned_on_support(points, psi)
    for k in range(3, 7):
        dx, dy = (points[:, k, i] - points[:, 2, i] for i in (0, 1))
        np.testing.assert_allclose(turned[:, k, 0], points[:, 2, 0] + dx * np.cos(psi) - dy * np.sin(psi), atol=1e-15)
        np.testing.assert_allclose(turned[:, k, 1], points[:, 2, 1] + dx * np.sin(psi) + dy * np.cos(psi), atol=1e-15)


def test_a_turn_keeps_heights_distances_and_the_standing_leg(rng):
    theta, beta = some_posture(rng)
    points = biped.joint_coordinates(LENGTHS, theta, beta)
    turned = biped.turned_on_support(points, np.full(len(beta), -0.4))
    np.testing.assert_array_equal(turned[..., 2], points[..., 2])
    np.testing.assert_array_equal(turned[:, :3], points[:, :3])
    links = (np.linalg.norm(np.diff(each, axis=1), axis=-1) for each in (turned, points))
    np.testing.assert_allclose(*links, atol=1e-15)


def test_two_half_turns_align_both_feet():
    # Equations (4), then (6): a turn on the left leg, then one on the right leg by as much, which turns the left foot.
    psi = np.array([-0.3])
    first = biped.turned_on_support(biped.joint_coordinates(LENGTHS, UPRIGHT, np.zeros(1)), psi)
    right_toe = first[0, 6] - first[0, 5]
    standing_right = biped.joint_coordinates(LENGTHS, UPRIGHT, np.zeros(1), support="right")
    left_toe = np.diff(biped.turned_on_swing(standing_right, psi)[0, 5:], axis=0)[0]
    np.testing.assert_allclose(left_toe, right_toe, atol=1e-15)


def test_an_ankle_elsewhere_moves_every_point(rng):
    theta, beta = some_posture(rng)
    ankle = np.array([1.0, 2.0, 0.1])
    moved = biped.joint_coordinates(LENGTHS, theta, beta, ankle=ankle)
    np.testing.assert_allclose(moved - ankle, biped.joint_coordinates(LENGTHS, theta, beta), atol=1e-15)


def test_a_length_that_is_not_positive_is_refused():
    with pytest.raises(ParameterError, match=r"link length pelvis is 0\.0: give a number above 0"):
        BipedLengths(pelvis=0.0)
