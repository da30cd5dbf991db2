# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.walking import zmp

WAYS = (zmp.zmp_from_bodies, zmp.zmp_from_centroidal_momentum, zmp.zmp_from_contact_wrench)


@pytest.fixture(scope="module")
def humanoid():
    # Not the random sample, which is another robot in every process and leaves the ground in some.
    return pin.buildSampleModelHumanoid()


@pytest.fixture(scope="module")
def point_mass():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    return model


def standing_states(model, rng, samples=50):
    """Random states in which the ground still carries a good part of the weight."""
    limit = np.full(model.nq, np.pi)
    limit[:7] = 1.0
    pin.seed(7)
    data, states = model.createData(), []
    while len(states) < samples:
        q = pin.randomConfiguration(model, -limit, limit)
        v, a = rng.normal(size=model.nv), 0.5 * rng.normal(size=model.nv)
        pin.centerOfMass(model, data, q, v, a)
        if data.acom[0][2] > -5.0:
            states.append((q, v, a))
    return tuple(np.array(part) for part in zip(*states, strict=True))


@pytest.mark.parametrize("ground", [0.0, -0.7])
def test_body_sum_and_centroidal_momentum_and_contact_wrench_agree(humanoid, rng, ground):
    q, v, a = standing_states(humanoid, rng)
    bodies, centroidal, wrench = (way(humanoid, q, v, a, ground=ground) for way in WAYS)
    scale = max(1.0, np.abs(bodies).max())
    np.testing.assert_allclose(centroidal, bodies, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(wrench, bodies, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("way", WAYS)
def test_at_rest_it_is_the_projection_of_the_centre_of_mass(humanoid, rng, way):
    q, v, _ = standing_states(humanoid, rng, 5)
    data = humanoid.createData()
    com = np.array([pin.centerOfMass(humanoid, data, each)[:2] for each in q])
    np.testing.assert_allclose(way(humanoid, q, 0 * v, 0 * v), com, atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
def test_a_body_that_starts_to_roll_moves_it_along_plus_y(way):
    # Closed form: a body that only spins about x with I alpha has y = + I alpha / (m g); Huang's printed sign is minus.
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), 0.3 * np.eye(3)), pin.SE3.Identity())
    q, v, a = np.zeros((1, 7)), np.zeros((1, 6)), np.zeros((1, 6))
    q[0, 6], a[0, 3] = 1.0, 4.0
    np.testing.assert_allclose(way(model, q, v, a), [[0.0, 0.3 * 4.0 / (2.0 * 9.81)]], atol=1e-14)


def test_point_masses_without_spin_are_off_by_more_than_ten_centimetres_in_fast_motion(humanoid, rng):
    # The published simplification: leave the angular momentum of each body about its centre out.
    q, v, a = standing_states(humanoid, rng)
    points = humanoid.copy()
    for joint in range(1, points.njoints):
        inertia = points.inertias[joint]
        points.inertias[joint] = pin.Inertia(inertia.mass, inertia.lever, np.zeros((3, 3)))
    exact, approximate = zmp.zmp_from_bodies(humanoid, q, v, a), zmp.zmp_from_bodies(points, q, v, a)
    assert np.abs(exact - approximate).max() > 0.1


@pytest.mark.parametrize("way", WAYS)
def test_free_fall_is_refused(point_mass, way):
    q, a = np.zeros((2, 7)), np.zeros((2, 6))
    q[:, 6], a[1, 2] = 1.0, -9.9
    with pytest.raises(ParameterError, match="does not press on the ground at sample 1"):
        way(point_mass, q, np.zeros((2, 6)), a)


def test_a_fixed_base_is_refused():
    model = pin.buildSampleModelManipulator()
    with pytest.raises(RobotError, match="needs a robot on a floating base"):
        zmp.zmp_from_bodies(model, np.zeros((1, 6)), np.zeros((1, 6)), np.zeros((1, 6)))


def test_gravity_that_is_not_vertical_is_refused(point_mass):
    tilted = point_mass.copy()
    tilted.gravity = pin.Motion(np.array([1.0, 0, -9.0, 0, 0, 0]))
    with pytest.raises(RobotError, match=r"needs gravity along -z, and it is \(1, 0, -9\)"):
        zmp.zmp_from_contact_wrench(tilted, np.zeros((1, 7)), np.zeros((1, 6)), np.zeros((1, 6)))
