"""Bases that are mounted in another way than the model's gravity says. Oracle: known truth; the gravity is put in."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.checks.check_recording import checked
from identification.data.checks.readings.reading import reading_of
from identification.data.checks.readings.weights import attitude_suspects, gravity_from_torques
from identification.data.checks.smoothed_copy import smoothed
from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.effects.support.changed_robot import with_gravity


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 9.81), (9.81, 0.0, 0.0), (5.0, 0.0, 8.44)])
def test_a_robot_that_hangs_or_leans_far_is_refused_with_its_gravity(clean, planar2, gravity):
    # Known truth: the recorded robot feels this gravity, the given model 9.81 m/s^2 downwards.
    hanging = with_gravity(planar2, np.array(gravity))
    (fault,) = checked(clean(robot=hanging), planar2).wrong
    assert fault.what.startswith("the base is mounted in another way than gravity in the model says")
    stated = re.search(r"write gravity: \[(.*)\] into robot.yaml", fault.mend)[1]
    np.testing.assert_allclose([float(x) for x in stated.split(",")], gravity, atol=0.3)


def loaded(robot, gravity, place=(0.0, 0.0, -0.3), share=0.4):
    """The robot with a payload, a share of its mass, at a place on its last link [m], under a gravity."""
    out = with_gravity(robot, np.array(gravity))
    load = pin.Inertia.FromSphere(share * sum(body.mass for body in robot.model.inertias), 0.05)
    out.model.appendBodyToJoint(robot.model.njoints - 1, load, pin.SE3(np.eye(3), np.array(place)))
    return out


@pytest.mark.parametrize("given", [(0.0, 0.0, 9.81), (9.81, 0.0, 0.0)])
@pytest.mark.parametrize(("place", "feels"), [((0.0, 0.0, -0.3), 21.0), ((0.3, 0.1, 0.0), 11.6)])
def test_a_wrong_gravity_is_refused_although_the_model_lacks_a_load(clean, planar2, given, place, feels):
    # Known truth: gravity is downwards. With the model's masses twice as much of it is felt, or some from the side.
    robot, recording = with_gravity(planar2, np.array(given)), clean(robot=loaded(planar2, (0.0, 0.0, -9.81), place))
    felt = gravity_from_torques(robot, reading_of(smoothed(recording)), range(planar2.nv))
    assert np.linalg.norm(felt) == pytest.approx(feels, rel=0.02)
    (fault,) = checked(recording, robot).wrong
    assert fault.what.startswith("the base is mounted in another way than gravity in the model says")
    assert "write gravity: [0, 0, -9.81] into robot.yaml" in fault.mend


def test_another_zero_of_the_first_joint_is_named_beside_another_base(clean, planar2):
    # By hand: a planar arm that hangs upside down is one whose first joint is counted from above.
    recording = clean(robot=loaded(planar2, (0.0, 0.0, -9.81)))
    (fault,) = checked(recording, with_gravity(planar2, np.array([0.0, 0.0, 9.81]))).wrong
    assert fault.what.endswith("model says or the zero of shoulder is 3.14 rad from that of the model")
    assert "fits equally well, write q.shoulder: {from: q.shoulder, offset: 3.14159} into a column map" in fault.mend


@pytest.mark.parametrize("load", [False, True])
def test_a_model_without_gravity_is_refused_where_the_torques_feel_it(clean, planar2, load):
    recorded = loaded(planar2, (0.0, 0.0, -9.81)) if load else planar2
    (fault,) = checked(clean(robot=recorded), with_gravity(planar2, np.zeros(3))).wrong
    assert fault.what == "the model has no gravity, but the torques contain the weight of the links"
    assert "write gravity: [0, 0, -9.81] into robot.yaml" in fault.mend


@pytest.mark.parametrize(("size", "load"), [(1.62, False), (1.62, True), (3.72, False)])
def test_a_gravity_of_the_moon_or_of_mars_is_refused(clean, planar2, size, load):
    recorded = loaded(planar2, (0.0, 0.0, -9.81)) if load else planar2
    (fault,) = checked(clean(robot=recorded), with_gravity(planar2, np.array([0.0, 0.0, -size]))).wrong
    assert fault.what == f"gravity is {size:.3g} m/s^2 in the model, but 9.81 m/s^2 in the torques"
    assert "write gravity: [0, 0, -9.81] into robot.yaml" in fault.mend


@pytest.mark.parametrize("load", [False, True])
def test_a_robot_on_the_moon_is_not_refused(clean, planar2, load):
    # Known truth: recorded under 1.62 m/s^2, as the model says.
    moon = (0.0, 0.0, -1.62)
    recording = clean(robot=loaded(planar2, moon) if load else with_gravity(planar2, np.array(moon)))
    assert checked(recording, with_gravity(planar2, np.array(moon))).wrong == ()


@pytest.mark.parametrize("load", [False, True])
def test_a_robot_without_weight_whose_model_has_none_is_not_refused(clean, planar2, load):
    # Known truth: in space, or a controller that took all weight out and a user who says so.
    free = with_gravity(planar2, np.zeros(3))
    recording = clean(robot=loaded(planar2, (0.0, 0.0, 0.0)) if load else free)
    assert attitude_suspects(free, reading_of(smoothed(recording))) == []
    assert checked(recording, free).wrong == ()


@pytest.mark.parametrize("degrees", [0.0, 20.0])
def test_a_base_that_leans_a_little_is_for_the_diagnosis(clean, planar2, degrees):
    turned = pin.exp3(np.array([0.0, np.radians(degrees), 0.0])) @ np.array([0.0, 0.0, -9.81])
    reading = reading_of(smoothed(clean(robot=with_gravity(planar2, turned))))
    assert attitude_suspects(planar2, reading) == []


@pytest.mark.parametrize("share", [0.2, 0.3])
def test_weight_that_a_controller_took_out_is_reported_although_the_model_lacks_a_load(clean, planar2, share):
    # Known truth: the controller knows the given model; the weight of the load is left in the torques.
    recording = clean(robot=loaded(planar2, (0.0, 0.0, -9.81), (0.1, 0.0, -0.2), share))
    taken = replace(recording, tau=recording.tau - gravity_torque(planar2, recording.q))
    (sentence,) = [w for w in checked(taken, planar2).warnings if "the weight of the links" in w]
    assert "the torques of shoulder, elbow may lack the weight of the links that the model has" in sentence
    assert "write tau: {compensated: gravity} into a column map" in sentence


@pytest.mark.parametrize("factor", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
def test_a_robot_that_is_lighter_than_its_model_is_not_taken_for_a_compensated_one(clean, planar2, factor, share):
    lighter = with_gravity(planar2, np.array([0.0, 0.0, -9.81]))
    for joint in (1, 2):
        body = planar2.model.inertias[joint]
        lighter.model.inertias[joint] = pin.Inertia(factor * body.mass, body.lever, factor * body.inertia)
    assert lighter.model.inertias[2].mass == factor * planar2.model.inertias[2].mass
    recording = clean(robot=loaded(lighter, (0.0, 0.0, -9.81), (0.1, 0.0, -0.2), share) if share else lighter)
    assert not [w for w in checked(recording, planar2).warnings if "the weight of the links" in w]
