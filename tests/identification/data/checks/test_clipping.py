"""Torques that stay at their extreme value. Oracle: known truth; the torques are clipped, held and rounded by hand."""

import numpy as np
import pytest

from identification.data.checks.check_recording import checked
from identification.data.checks.times_and_torques import check_clipping
from identification.data.recording import Recording


def test_a_clipped_torque_is_reported_with_value_and_share(arm, changed, recording):
    top = np.percentile(recording.tau[:, 1], 95)
    tau = np.minimum(recording.tau, [np.inf, top, np.inf])
    warnings = checked(changed(recording, tau=tau), arm).warnings
    assert any(f"torque of tilt sits at {top:.6g} for 5 % of the samples" in w for w in warnings)


@pytest.mark.parametrize("digits", [1, 2, 3, 6])
@pytest.mark.parametrize("frequency", [0.05, 0.3])
def test_the_rounded_peak_of_a_slow_sine_is_not_clipped(digits, frequency):
    t = np.arange(20000) / 1000
    tau = (5.03 * np.sin(2 * np.pi * frequency * t)).round(digits)[:, None]
    assert check_clipping(Recording("a.csv", ("j",), t, tau, tau)) == ()


def test_the_highest_level_of_a_coarse_torque_is_not_clipped(rng):
    # Known truth: a torque of five levels, each as frequent as a normal distribution makes it.
    t = np.arange(4000) / 200
    level = np.round(np.sin(2 * np.pi * 0.3 * t) + 0.5 * rng.standard_normal(len(t)))
    tau = 0.0136 * np.clip(np.repeat(level[::8], 8), -2, 2)[:, None]
    assert check_clipping(Recording("a.csv", ("j",), t, tau, tau)) == ()


@pytest.mark.parametrize("rows", [5, 8])
def test_torques_that_are_held_for_some_rows_are_clipped_only_where_they_are(rows, rng):
    # Known truth: of a drive that is read more slowly than it is logged, and whose torque is mostly small.
    t = np.arange(2000) / 100
    read = 0.05 * rng.uniform(-1, 1, len(t)) - 4 * np.sin(2 * np.pi * 0.37 * t) ** 8
    read[20 * rows] = 0.1
    tau = read[np.arange(len(t)) // rows * rows][:, None]
    assert check_clipping(Recording("a.csv", ("j",), t, tau, tau)) == ()
    clipped = np.maximum(tau, -3.0)
    (said,) = check_clipping(Recording("a.csv", ("j",), t, clipped, clipped))
    assert "sits at -3 for" in said


def test_a_torque_of_two_values_is_clipped_at_both():
    t = np.arange(4000) / 100
    tau = np.where(t % 2 < 1, 3.0, -3.0)[:, None]
    said = check_clipping(Recording("a.csv", ("j",), t, tau, tau))
    assert ["sits at 3 for 50 %" in said[0], "sits at -3 for 50 %" in said[1]] == [True, True]


def test_a_torque_that_repeats_its_peak_without_noise_is_not_clipped():
    # Known truth: a quarter of the rate is sampled at its peaks, each once.
    t = np.arange(4000) / 100
    tau = np.tile([0.0, 2.12, 0.0, -2.12], 1000)[:, None]
    assert check_clipping(Recording("a.csv", ("j",), t, tau, tau)) == ()
