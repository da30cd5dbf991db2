"""Pushes that nobody measured. Oracle: known truth, pushes put into simulated recordings."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from identification.data.joint_torque import external_torque
from identification.diagnosis.judge.pushes import pushes_in
from identification.pipeline import diagnose

T = np.arange(0, 30, 0.02)
FLOOR = np.array([0.05, 0.05])
ALL = np.ones((len(T), 2), dtype=bool)
JOINTS = ("shoulder", "elbow")


def noise(seed: int = 0) -> np.ndarray:
    return 0.05 * np.random.default_rng(seed).standard_normal((len(T), 2))


def test_a_push_is_found_with_time_joint_and_size():
    left = noise()
    left[:, 1] += 1.5 * ((T > 12) & (T < 12.6))
    (push,) = pushes_in(T, left, ALL, FLOOR, JOINTS)
    assert push.joint == "elbow"
    assert (push.start, push.stop) == (pytest.approx(12, abs=0.1), pytest.approx(12.6, abs=0.1))
    assert push.torque == pytest.approx(1.5, abs=0.2)


def test_a_push_that_two_joints_feel_is_said_once():
    left = noise() + np.array([2.0, 1.0]) * ((T > 5) & (T < 5.5))[:, None]
    assert [push.joint for push in pushes_in(T, left, ALL, FLOOR, JOINTS)] == ["shoulder"]


def test_noise_is_no_push():
    assert [pushes_in(T, noise(seed), ALL, FLOOR, JOINTS) for seed in range(50)] == [()] * 50


def test_what_comes_back_is_no_push():
    # Friction that is not modelled leaves a spike at every reversal.
    left = noise()
    left[:, 0] += 1.0 * (np.abs(np.sin(1.5 * T)) < 0.05)
    assert pushes_in(T, left, ALL, FLOOR, JOINTS) == ()


def test_what_lasts_is_no_push():
    left = noise()
    left[:, 0] += 1.0 * (T > 20)
    assert pushes_in(T, left, ALL, FLOOR, JOINTS) == ()


def test_samples_that_may_not_be_used_are_no_push():
    left, usable = noise(), ALL.copy()
    here = (T > 12) & (T < 12.6)
    left[:, 1] += 1.5 * here
    usable[:, 1] = ~here
    assert pushes_in(T, left, usable, FLOOR, JOINTS) == ()


def test_few_samples_have_no_push():
    assert pushes_in(T[:10], noise()[:10], ALL[:10], FLOOR, JOINTS) == ()


@pytest.fixture(scope="module")
def pushed(lab, planar2):
    """A recording in which the last link is pushed for half a second, and the force."""
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    force = np.zeros((len(motion.t), 3))
    force[:, 0] = 8.0 * ((motion.t > 12.0) & (motion.t < 12.5))
    torque = external_torque(planar2, motion.q, {"lower": force})
    return lab.recording(planar2, motion, torque), force


def test_a_push_that_nobody_measured_is_told_with_what_to_leave_out(planar2, pushed):
    warnings = diagnose(planar2, (pushed[0],)).data_warnings
    told = [w for w in warnings if "joint shoulder was pushed by a force that no sensor measured" in w]
    assert len(told) == 1
    start, stop = map(float, re.findall(r"--exclude ([\d.]+):([\d.]+),", told[0])[0])
    assert 11.5 < start < 12.0
    assert 12.5 < stop < 13.0


def test_a_push_that_is_left_out_is_no_gap(planar2, pushed):
    found = diagnose(planar2, (replace(pushed[0], excluded=((11.7, 12.8),)),))
    assert (found.verdict, found.data_warnings) == ("no_gap", ())


def test_a_push_that_was_measured_is_no_gap(planar2, pushed):
    recording, force = pushed
    found = diagnose(planar2, (replace(recording, forces={"lower": force}),))
    assert (found.verdict, found.data_warnings) == ("no_gap", ())
