"""The lag of torques, where friction could feign one. Oracle: known truth, and closed forms."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, lfilter_zi

import phantom_dyn as dyn
from identification.data.checks.check_recording import check_recording
from identification.data.checks.smoothed_copy import smoothed
from identification.data.checks.torques.torque_lag import clear_samples, friction_columns, lags_and_low_passes
from phantom_dyn.model.robot import Robot
from places import ROBOTS


def lags_of(robot: Robot, recording) -> list[float]:
    return [lag.samples for lag, _ in lags_and_low_passes(robot, recording, smoothed(recording)) if lag]


@pytest.mark.parametrize("late", [0.0, 0.003])
def test_friction_that_turns_about_later_than_the_motion_is_no_lag(clean, arm, changed, late):
    # Known truth: the torque is late by 0 or 1.5 samples; as where a joint sticks, its friction turns 15 ms later.
    recording = clean(late=late, seconds=40.0)
    sign = np.roll(np.sign(recording.v), round(500 * late), axis=0)
    rubs = 3.0 * arm.coulomb_friction * (np.roll(sign, round(500 * 0.015), axis=0) - sign)
    stuck = changed(recording, tau=recording.tau + rubs)
    assert lags_of(arm, stuck) == pytest.approx([500 * late] * 3, abs=0.1)


def test_a_simulated_pendulum_that_sticks_has_no_lag():
    # Known truth: positions and torques of a simulation have one time, whatever the friction.
    robot = dyn.load_robot(ROBOTS / "pendulum.urdf")
    reference = dyn.excite(robot, duration=20.0)
    made = dyn.simulate(robot, reference, effects=[("coulomb_friction", "pin", {"torque": 1.5})])
    recording = made.recording(position_noise=1e-5, torque_noise=0.02, seed=1)
    assert lags_of(robot, recording) == pytest.approx([0.0], abs=0.1)
    assert not any("against its motion" in sentence for sentence in check_recording(recording, robot))


def test_samples_are_clear_where_the_filter_touches_no_reversal():
    # Closed form: of a sine of 0.5 Hz at 1 kHz, 16 ms below a twentieth of its top speed, then 50 ms and the filter.
    t = np.arange(4000) / 1000.0
    clear = clear_samples(np.cos(np.pi * t + 1e-4), np.ones(len(t), dtype=bool), 100, 1e-3)
    apart = np.abs((t % 1.0) - 0.5)
    edge = np.arcsin(0.05) / np.pi + 0.15
    np.testing.assert_array_equal(clear[apart > edge + 0.002], True)
    np.testing.assert_array_equal(clear[apart < edge - 0.002], False)


def test_samples_beside_what_does_not_count_are_not_clear():
    inside = np.ones(1000, dtype=bool)
    inside[500] = False
    np.testing.assert_array_equal(np.flatnonzero(~clear_samples(np.ones(1000), inside, 10, 1e-3)), np.arange(490, 511))


def test_friction_may_differ_between_directions(rng):
    # Closed form: Coulomb and viscous friction with other coefficients in either direction.
    v = rng.uniform(-2.0, 2.0, 500)
    law = np.where(v > 0, 1.0 + 0.5 * v, -3.0 + 0.1 * v)
    columns = friction_columns(v)
    left = law - columns @ np.linalg.lstsq(columns, law, rcond=None)[0]
    assert np.abs(left).max() < 1e-9


@pytest.mark.parametrize("scale", [1e-310, 1e-200, 1e200])
def test_columns_of_friction_are_those_of_any_unit_of_speed(rng, scale):
    v = rng.uniform(-2.0, 2.0, 500)
    np.testing.assert_allclose(friction_columns(scale * v), friction_columns(v), atol=1e-9)


def test_positions_of_the_smallest_floats_show_no_lag(clean, arm):
    recording = clean()
    assert lags_of(arm, replace(recording, q=1e-309 * recording.q)) == []


def test_a_joint_that_turns_about_all_the_time_shows_no_lag(clean, arm):
    # Twelve times a second: every 42 ms, and a joint creeps for 50 ms before and behind each.
    recording = clean()
    q = recording.q.copy()
    q[:, 2] = 0.02 * np.sin(2 * np.pi * 12.0 * recording.t)
    copy = replace(smoothed(recording), cutoff_hz=40.0)
    assert "slide" not in [lag.joint for lag, _ in lags_and_low_passes(arm, replace(recording, q=q), copy) if lag]


def low_passed(recording, hertz: float) -> np.ndarray:
    """The torque behind a low pass of first order; scipy's filter, begun in its steady state."""
    b, a = butter(1, hertz, fs=500.0)
    tau, _ = lfilter(b, a, recording.tau, axis=0, zi=lfilter_zi(b, a)[:, None] * recording.tau[0])
    return tau


@pytest.mark.parametrize("hertz", [5.0, 20.0, 50.0])
def test_the_cut_off_of_a_low_pass_is_found(clean, arm, changed, hertz):
    recording = clean(seconds=40.0)
    filtered = changed(recording, tau=low_passed(recording, hertz))
    found = [one.hertz for _, one in lags_and_low_passes(arm, filtered, smoothed(filtered)) if one]
    assert found == pytest.approx([hertz] * 3, rel=0.05)


def test_a_low_pass_is_told_with_the_entry_that_takes_it_back(clean, arm, changed):
    recording = clean(seconds=40.0)
    told = [text for text in check_recording(changed(recording, tau=low_passed(recording, 5.0)), arm) if "tilt" in text]
    assert len(told) == 1
    assert re.search(r"tilt went through a low pass of first order at 5\.?\d* Hz that the positions did not", told[0])
    assert re.search(r"write tau\.tilt: \{low_pass: 5\.?\d*\} into a column map", told[0])


def test_a_low_pass_far_above_the_motion_may_be_a_shift(clean, arm, changed):
    recording = clean()
    told = check_recording(changed(recording, tau=low_passed(recording, 50.0)), arm)
    assert "late against its motion" in told[0]
    assert "shift it, or, if it went through a low pass of first order, write tau.turn: {low_pass: 5" in told[0]


@pytest.mark.parametrize("late", [-0.002, 0.0])
def test_a_torque_that_is_not_late_went_through_no_low_pass(clean, arm, late):
    assert not any("low pass" in text for text in check_recording(clean(late=late), arm))


@pytest.mark.parametrize("hertz", [8.0, 20.0])
def test_a_low_pass_of_second_order_is_not_told_as_one_of_first(clean, arm, changed, hertz):
    # The noise above the motion tells the order: it falls off twice as steeply.
    recording = clean(seconds=40.0)
    tau = lfilter(*butter(2, hertz, fs=500.0), recording.tau - recording.tau[0], axis=0) + recording.tau[0]
    told = check_recording(changed(recording, tau=tau), arm)
    assert any("went through a low-pass that the positions did not" in text for text in told)
    assert not any("first order" in text for text in told)
