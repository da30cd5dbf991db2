"""Noise of torque readings above the band. Oracle: closed forms of white noise, known truths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.data.log import Band, Log
from identification.data.signals import align_held_torque, low_pass
from identification.diagnosis.noise.sensor_noise import torque_noise
from phantom_dyn.motion import Motion

RATE, SIGMA = 500.0, 0.3  # [Hz], [N m]


def log_of(tau: np.ndarray, raw_q: np.ndarray | None = None, band: Band | None = None) -> Log:
    still = np.zeros((len(tau), 1))
    motion = Motion(np.arange(len(tau)) / RATE, still, still, still)
    return Log("a.csv", ("j1",), motion, tau[:, None], band or low_pass(20.0, RATE), np.ones(len(tau), bool), raw_q)


@pytest.fixture
def white(rng) -> np.ndarray:
    return SIGMA * rng.standard_normal(20000)


@pytest.mark.parametrize("held", [False, True])
def test_white_noise_has_the_density_of_its_variance_over_half_the_rate(white, held):
    # Closed form: sigma^2 / (rate / 2).
    tau = align_held_torque(white[:, None])[:, 0] if held else white
    found = torque_noise((log_of(tau),), 0, held=held)
    assert found.value == pytest.approx(SIGMA**2 / (RATE / 2), rel=0.05)
    assert found.low <= found.value <= found.high < 1.3 * found.low


def test_noise_that_a_recorder_has_smoothed_says_nothing(white):
    assert torque_noise((log_of(lfilter([0.4], [1.0, -0.6], white)),), 0, held=False) is None


def test_what_a_controller_answers_to_its_encoder_is_no_noise_of_the_torque(white, rng):
    # Known truth: a proportional gain on noisy readings, thirty times as much as the torque's own noise.
    q = 1e-3 * rng.standard_normal((len(white), 1))
    found = torque_noise((log_of(white - 9000.0 * q[:, 0], q),), 0, held=False)
    assert found.value == pytest.approx(SIGMA**2 / (RATE / 2), rel=0.3)


def test_a_band_that_reaches_up_to_the_rate_leaves_nothing_above(white):
    assert torque_noise((log_of(white, band=low_pass(80.0, RATE)),), 0, held=False) is None


def test_a_torque_without_noise_shows_no_density():
    assert torque_noise((log_of(np.zeros(20000)),), 0, held=False) is None


def test_several_recordings_count_by_their_length(white):
    # Closed form: of two recordings with a third and two thirds of the samples, the density is the mean so weighted.
    short, long = log_of(white[:6000]), log_of(3.0 * white[6000:18000])
    found = torque_noise((short, long), 0, held=False)
    assert found.value == pytest.approx((1.0 + 2.0 * 9.0) / 3.0 * SIGMA**2 / (RATE / 2), rel=0.07)
