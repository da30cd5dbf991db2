"""Errors of sound models. Oracle: the table's shares, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.session import session_of
from identification.diagnosis.noise.discrepancy import DRIVE_CLASSES, MOST, MOST_SHOWN, discrepancy, slow_samples
from phantom_dyn.effects.support.changed_robot import with_friction


@pytest.fixture
def session(lab, planar2):
    return session_of(planar2, (lab.recording(planar2, lab.motion(2, seconds=20.0)),))


def found(session, torque, **changes):
    robot = replace(session.robot, **changes)
    counts = tuple(np.ones((len(log.samples), 2)) for log in session.logs)
    return discrepancy(replace(session, robot=robot), counts, np.array(torque))


def test_it_is_never_less_than_the_share_of_the_torque(session):
    torque = np.array([2.0, 10.0])
    assert np.all(found(session, torque) >= DRIVE_CLASSES["command"].of_torque * torque - 1e-15)


def test_it_is_never_more_than_the_most(session):
    # By hand: friction of newton metres beside a torque of milli newton metres.
    small = np.array([1e-3, 1e-3])
    robot = with_friction(session.robot, session.robot.joint_names[0], viscous=0.0, coulomb=5.0)
    rubbing = replace(session, robot=robot)
    assert found(rubbing, small)[0] == pytest.approx(MOST * 1e-3)


def test_friction_at_reversals_adds_to_it(session):
    torque = np.array([20.0, 20.0])
    robot = with_friction(session.robot, session.robot.joint_names[0], viscous=0.0, coulomb=2.0)
    more = found(replace(session, robot=robot), torque)
    assert more[0] > found(session, torque)[0]
    assert more[1] == found(session, torque)[1]


def test_a_torque_sensor_allows_less(session):
    torque = np.array([2.0, 10.0])
    assert np.all(found(session, torque, torque_source="sensor") < found(session, torque))


def test_the_error_that_another_recording_has_shown_adds_by_its_share_of_time(session):
    # Closed form: 0.03 N m in the slow samples of the first joint and 0.01 elsewhere.
    torque = np.array([20.0, 20.0])
    plain = found(session, torque)
    error = found(session, torque, model_error=np.array([[0.03, 0.01], [0.0, 0.0]]))
    slow = np.concatenate([slow_samples(session, k)[log.samples] for k, log in enumerate(session.logs)])[:, 0]
    wanted = plain[0] ** 2 + slow.mean() * 0.03**2 + (1 - slow.mean()) * 0.01**2
    assert 0.0 < slow.mean() < 1.0
    assert error[0] ** 2 == pytest.approx(wanted, rel=1e-9)
    assert error[1] == plain[1]


def test_the_error_that_another_recording_has_shown_is_at_most_a_tenth_of_the_torque(session):
    torque = np.array([2.0, 2.0])
    error = found(session, torque, model_error=np.full((2, 2), 5.0))
    assert np.all(error <= np.hypot(found(session, torque), MOST_SHOWN * torque) + 1e-12)
