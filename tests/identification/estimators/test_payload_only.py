from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.estimators.consistent.consistent_bodies import pseudo_inertia
from identification.estimators.payload_only import fit_payload, fit_payload_and_robot
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import LogError, ParameterError, RobotError
from phantom_dyn.model.inertia import STANDARD_NAMES, body_parameters
from phantom_dyn.motion import Motion

CENTER = np.array([0.05, -0.02, 0.15])
CENTRAL = np.array([[0.02, 1e-3, 0], [1e-3, 0.03, 2e-3], [0, 2e-3, 0.025]])
BOX = body_parameters(3.0, CENTER, CENTRAL)


@pytest.fixture(scope="module")
def ur10():
    return load_robot("example:ur10")


@pytest.fixture
def recording(make_log, rng):
    """A robot with 0.4 N m s of viscous friction, with a payload on its last link or without."""

    def made(robot, payload=None, sigma=0.0, samples=250):
        added = np.zeros_like(standard_parameters(robot))
        added[-10:] = 0.0 if payload is None else payload
        motion = Motion(np.arange(samples) * 0.01, *rng.normal(size=(3, samples, robot.nv)))
        tau = inverse_dynamics(with_parameters(robot, added), motion) + 0.4 * motion.v
        return make_log(robot, motion, tau + sigma * rng.normal(size=tau.shape))

    return made


def viscous(friction, robot):
    return friction(robot)[::2]


def test_all_ten_parameters_of_a_payload_on_a_known_ur10_come_back(ur10, recording, friction):
    fit = fit_payload(ur10, recording(ur10, BOX), viscous(friction, ur10))
    np.testing.assert_allclose(fit.standard, BOX, atol=1e-6)
    assert fit.determined == STANDARD_NAMES


def test_it_does_not_need_to_know_the_robot_if_it_has_a_recording_without_payload(ur10, recording, friction):
    # Known truth: the given model is 10 % off, the payload is the difference of two recordings.
    wrong = with_parameters(ur10, 0.1 * standard_parameters(ur10))
    fit = fit_payload_and_robot(wrong, recording(ur10, BOX), recording(ur10), viscous(friction, ur10))
    np.testing.assert_allclose(fit.standard, BOX, atol=1e-5)
    assert fit.determined == STANDARD_NAMES


def test_taking_a_wrong_robot_as_known_gives_a_wrong_payload(ur10, recording, friction):
    wrong = with_parameters(ur10, 0.1 * standard_parameters(ur10))
    fit = fit_payload(wrong, recording(ur10, BOX), viscous(friction, ur10))
    assert abs(fit.standard[0] - 3.0) > 0.1


def test_deviations_cover_the_truth_with_noise(ur10, recording, friction):
    fit = fit_payload(ur10, recording(ur10, BOX, 1.0), viscous(friction, ur10), unloaded=recording(ur10, None, 1.0))
    estimate = fit.fit.theta[:10]
    assert (np.abs(estimate - BOX) < 4 * fit.std).all()


def test_a_recording_without_payload_makes_deviations_smaller(ur10, recording, friction):
    loaded = recording(ur10, BOX, 1.0)
    alone = fit_payload(ur10, loaded, viscous(friction, ur10))
    both = fit_payload(ur10, loaded, viscous(friction, ur10), unloaded=recording(ur10, None, 1.0, 1000))
    assert both.fit.std()[-6:].max() < 0.7 * alone.fit.std()[-6:].max()


def test_the_payload_can_exist_whatever_the_noise(ur10, recording, friction):
    fit = fit_payload(ur10, recording(ur10, None, 20.0), viscous(friction, ur10))
    assert np.linalg.eigvalsh(pseudo_inertia(fit.standard))[0] > 0


def test_a_turning_joint_determines_combinations_only(pendulum, recording):
    # Closed form: inertia about the axis and two first moments are all that one revolute joint shows.
    fit = fit_payload(pendulum, recording(pendulum, BOX), [])
    assert fit.fit.rank <= 3
    assert "m" not in fit.determined


def test_what_is_not_told_is_that_of_the_expected_payload(pendulum, recording, friction):
    fit = fit_payload(pendulum, recording(pendulum, BOX), viscous(friction, pendulum), expected=BOX)
    np.testing.assert_allclose(fit.standard, BOX, atol=1e-6)


def test_parameters_at_a_frame_are_those_moved_there(ur10, recording, friction):
    # Closed form: the centre of mass in the frame, the central inertia turned with it.
    fit = fit_payload(ur10, recording(ur10, BOX), viscous(friction, ur10), frame="tool0")
    pose = fit.joint_from_frame
    turned = pose[:3, :3].T @ CENTRAL @ pose[:3, :3]
    center = pose[:3, :3].T @ (CENTER - pose[:3, 3])
    assert not np.allclose(pose, np.eye(4))
    np.testing.assert_allclose(fit.standard_in_frame, body_parameters(3.0, center, turned), atol=1e-6)


def test_a_slide_and_a_hinge_carry_payloads_too(arm, recording, friction):
    fit = fit_payload(arm, recording(arm, BOX), viscous(friction, arm))
    assert fit.standard[0] == pytest.approx(3.0)


def test_an_unknown_frame_is_refused(ur10, recording):
    with pytest.raises(RobotError, match="has no frame 'hand' on a moving link"):
        fit_payload(ur10, recording(ur10, None), frame="hand")


def test_no_recording_with_payload_is_refused(ur10):
    with pytest.raises(LogError, match="No recording with payload was given"):
        fit_payload(ur10, [])


def test_a_difference_needs_a_recording_without_payload(ur10, recording):
    with pytest.raises(LogError, match="No recording without payload was given"):
        fit_payload_and_robot(ur10, recording(ur10, BOX), [])


def test_an_expected_payload_that_is_not_finite_is_refused(pendulum, recording):
    with pytest.raises(ParameterError, match="expected payload is not ten finite numbers"):
        fit_payload(pendulum, recording(pendulum, BOX), expected=np.full(10, np.nan))


def test_the_robot_of_the_payload_stays_as_it_was(ur10, recording):
    before = standard_parameters(ur10)
    fit_payload(ur10, recording(ur10, BOX), frame="tool0")
    np.testing.assert_array_equal(standard_parameters(replace(ur10)), before)
