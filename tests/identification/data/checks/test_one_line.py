"""What a motion can tell of the links. Oracles: by hand, and Pinocchio's regressor on motions of known rank."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.checks.one_line import is_one_sine, lines_of, separated
from phantom_dyn.motion import Motion


def waves(*phases, frequencies=None):
    t = np.arange(0.0, 20.0, 0.005)
    w = np.ones(len(phases)) if frequencies is None else np.array(frequencies)
    angle = w * t[:, None] + np.array(phases)
    return Motion(t, np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle))


def test_joints_that_follow_one_profile_are_on_one_line():
    # Half the profile, backwards and 5 ms late, is the same line; a joint that stands is on none.
    t = np.arange(0.0, 20.0, 0.005)
    v = np.column_stack([np.cos(t), -0.5 * np.cos(t - 0.005), np.cos(3 * t), 0.0 * t])
    assert lines_of(v) == ((0, 1),)


def test_joints_that_move_independently_are_on_no_line():
    assert lines_of(waves(0.0, 1.0, frequencies=(1.0, 2.3)).v) == ()


def test_a_motion_along_one_line_shows_fewer_base_parameters(planar2):
    free = separated(planar2, waves(0.0, 1.0, frequencies=(1.0, 2.3)))
    line = separated(planar2, waves(0.0, 0.0))
    assert line.all == free.all == 6
    assert line.shown < free.shown
    assert line.condition > free.condition


def test_a_check_names_the_joints_of_a_line(lab, planar2):
    from identification.data.checks.check_recording import check_recording

    recording = lab.recording(planar2, waves(0.0, 0.0, frequencies=(2.0, 2.0)), np.zeros((4000, 2)))
    words = [one for one in check_recording(recording, planar2) if "along one line" in one]
    assert len(words) == 1
    assert words[0].startswith("shoulder and elbow move along one line")


def test_a_check_of_a_good_motion_names_none(lab, planar2):
    from identification.data.checks.check_recording import check_recording

    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    words = check_recording(lab.recording(planar2, motion, np.zeros_like(motion.q)), planar2)
    assert not any("along one line" in one for one in words)


@pytest.mark.parametrize("joints", [1, 3])
def test_one_joint_alone_is_on_no_line(joints):
    v = np.cos(np.arange(100.0))[:, None] * np.ones((1, joints))
    assert lines_of(v) == (((0, 1, 2),) if joints == 3 else ())


@pytest.mark.parametrize(("hertz", "alone"), [((0.7,), True), ((0.7, 1.1), False), ((0.1,), False)])
def test_motion_of_one_frequency_is_one_sine(rng, hertz, alone):
    t = np.arange(4000) / 200.0
    q = sum(np.sin(2 * np.pi * f * t) for f in hertz) + 1e-3 * rng.standard_normal(len(t))
    assert is_one_sine(q) is alone
