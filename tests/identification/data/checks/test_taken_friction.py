"""Torques from which a controller had taken friction. Oracle: known truth; the model's friction is taken out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.checks.check_recording import check_recording
from identification.data.checks.smoothed_copy import smoothed
from identification.data.checks.torques.taken_friction import check_friction_taken, held_friction
from identification.data.recording import Recording
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import own_friction
from places import ROBOTS

EVERY, SECOND = np.ones(3), np.array([0.0, 1.0, 0.0])


@pytest.fixture
def taken(clean, arm, changed):
    """Builds a recording from which a share of each joint's modelled friction was taken."""

    def build(shares: np.ndarray):
        recording = clean(friction=1.0)
        return changed(recording, tau=recording.tau - shares * own_friction(arm, recording.v))

    return build


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_share_of_the_modelled_friction_that_a_torque_holds(taken, arm, share):
    held = held_friction(arm, smoothed(taken(share * EVERY)))
    assert [one.share for one in held] == pytest.approx([1 - share] * 3, abs=0.05)


def test_the_error_of_a_share_covers_its_departure(taken, arm):
    held = held_friction(arm, smoothed(taken(EVERY)))
    assert [abs(one.share) < 4 * one.std for one in held] == [True] * 3


def test_torques_without_friction_are_told_with_the_entry(taken, arm):
    (sentence,) = check_recording(taken(EVERY), arm)
    assert "the torques of turn, tilt, slide lack the friction that the model states" in sentence
    assert "write tau: {compensated: friction} into a column map and give it with --columns" in sentence


def test_one_torque_without_friction_is_told_with_the_entry_of_its_joint(taken, arm):
    (sentence,) = check_recording(taken(SECOND), arm)
    assert "the torque of tilt lacks the friction" in sentence
    assert "write tau.tilt: {compensated: friction} into" in sentence


def test_friction_that_is_half_of_what_the_model_states_is_not_told(taken, arm):
    assert check_friction_taken(taken(0.5 * EVERY), arm, smoothed(taken(0.5 * EVERY))) == ()


def test_nothing_is_told_where_the_column_map_says_so(taken, arm):
    assert check_recording(replace(taken(EVERY), friction_taken=arm.joint_names), arm) == ()


def test_a_robot_whose_model_states_no_friction_lacks_none(taken, arm):
    bare = replace(arm, viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))
    assert held_friction(bare, smoothed(taken(EVERY))) == ()


def test_friction_below_what_the_fit_leaves_is_not_told(taken, arm, changed, rng):
    recording = taken(EVERY)
    friction = own_friction(arm, recording.v).std(axis=0)
    noise = rng.standard_normal(recording.tau.shape) * 6.0 * friction
    noisy = changed(recording, tau=recording.tau + noise)
    assert check_friction_taken(noisy, arm, smoothed(noisy)) == ()


def test_a_joint_that_its_drive_does_not_move_lacks_no_friction(taken, arm, changed):
    recording = taken(EVERY)
    idle = changed(recording, tau=recording.tau * [1.0, 0.1, 1.0])
    assert [one.joint for one in held_friction(arm, smoothed(idle))] == ["turn", "slide"]


def test_a_joint_that_never_moves_lacks_no_friction():
    # The velocity of noise alone has no sign that friction could follow: what a fit finds along it is no friction.
    robot, rng, t = load_robot(ROBOTS / "pendulum.urdf"), np.random.default_rng(1), np.arange(2000) / 100.0
    q, tau = (rng.standard_normal((2000, 1)) * size + level for size, level in ((1e-5, 0.3), (0.01, 1.45)))
    still = Recording("still.csv", robot.joint_names, t, q, tau)
    assert held_friction(robot, smoothed(still)) != ()
    assert check_friction_taken(still, robot, smoothed(still)) == ()
