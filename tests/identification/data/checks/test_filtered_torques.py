"""Torques that were filtered otherwise than the positions. Oracle: known truth, and closed forms of spectra."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from identification.data.checks.torques.filtered_torques import check_filtered, filtered_joints, roll_off


def low_passed(x: np.ndarray, edge: float = 0.1) -> np.ndarray:
    """Second order; the edge as a share of half the rate."""
    return sosfilt(butter(2, edge, output="sos"), x, axis=0)


def said(recording) -> tuple[str, ...]:
    return check_filtered(recording, filtered_joints(recording))


def test_white_noise_has_no_roll_off(rng):
    assert roll_off(rng.standard_normal((20000, 1))) == pytest.approx(0.0, abs=0.5)


def test_a_mean_of_two_samples_rolls_off_as_its_cosine(rng):
    # Closed form: the power of a mean of two is cos(pi f)^2; the medians lie near the middles of the bands.
    x = rng.standard_normal(40001)
    wanted = 20 * np.log10(np.cos(np.pi * 0.415) / np.cos(np.pi * 0.185))
    assert roll_off((x[1:, None] + x[:-1, None]) / 2) == pytest.approx(wanted, abs=0.7)


def test_a_slow_motion_does_not_leak_into_the_bands(rng):
    x = 100 * np.sin(np.arange(20000) / 300) + 1e-3 * rng.standard_normal(20000)
    assert roll_off(x[:, None]) == pytest.approx(0.0, abs=0.7)


def test_filtered_torques_are_told_with_their_joints(clean, arm, changed):
    recording = clean()
    tau = recording.tau.copy()
    tau[:, :2] = low_passed(tau[:, :2])
    (sentence,) = said(changed(recording, tau=tau))
    assert "the torques of turn, tilt went through a low-pass that the positions did not" in sentence
    assert "the noise above the band cannot be used" in sentence


def test_torques_and_positions_filtered_alike_are_not_told(clean, arm, changed, rng):
    recording = clean()
    q = recording.q + 1e-5 * rng.standard_normal(recording.q.shape)
    assert said(changed(recording, q=low_passed(q), tau=low_passed(recording.tau))) == ()


def test_torques_as_sensors_give_them_are_not_told(clean):
    assert said(clean()) == ()
