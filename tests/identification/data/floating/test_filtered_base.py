"""Motion of a base from its sensors. Oracle: closed form of sines, and the noise that was put in."""

from dataclasses import replace

import numpy as np
import pytest

from floating_leg import written_leg
from identification.data.floating.base_columns import filtered_base, sensors_of_base, with_redrawn_noise
from identification.data.recording import BaseReadings, Recording
from identification.data.signals import process
from phantom_dyn.dynamics.moving_base import base_motion
from phantom_dyn.model.loading import load_robot

RATE = 500.0
T = np.arange(6000) / RATE
SPEEDS = 2 * np.pi * np.array([0.7, 1.1, 1.6])


@pytest.fixture
def leg(tmp_path):
    return load_robot(written_leg(tmp_path))


def turning(w=0.0, sf=0.0) -> Recording:
    """A base that turns to and fro, read with noise."""
    rng = np.random.default_rng(3)
    sense = np.sin(SPEEDS * T[:, None]) + w * rng.normal(size=(len(T), 3))
    felt = 9.8 + np.cos(SPEEDS * T[:, None]) + sf * rng.normal(size=(len(T), 3))
    q = np.column_stack([np.sin(T), np.cos(T)])
    base = BaseReadings("imu", "imu", sense, felt, {"foot": np.zeros(len(T))})
    return Recording("log.csv", ("hip", "knee"), T, q, np.ones_like(q), base=base)


def test_the_angular_acceleration_is_the_derivative_of_the_gyroscopes(leg):
    found = filtered_base(turning(), leg, T, RATE, 60.0)
    phases = SPEEDS * T[:, None]
    exact = base_motion(leg, "imu", "imu", np.sin(phases), SPEEDS * np.cos(phases), 9.8 + np.cos(phases))
    inside = slice(200, -200)
    for name in ("w", "dw", "f"):
        np.testing.assert_allclose(getattr(found, name)[inside], getattr(exact, name)[inside], atol=2e-3)


def test_the_noise_of_both_sensors_is_read_from_their_readings():
    w, sf = sensors_of_base(turning(w=0.004, sf=0.07)).noise
    assert w == pytest.approx(0.004, rel=0.05)
    assert sf == pytest.approx(0.07, rel=0.05)


def test_a_base_that_is_bolted_down_has_no_noise():
    assert sensors_of_base(replace(turning(), base=None)) is None


def test_with_redrawn_noise_the_base_differs_by_its_noise_in_the_band(leg, rng):
    log = process(turning(w=0.004, sf=0.07), leg, cutoff_hz=20.0)
    again = with_redrawn_noise(log, rng, 50.0)
    # White noise up to a quarter of its band of 250 Hz; Butterworth's edge leaves a little more.
    share = np.sqrt(50.0 / 250.0)
    assert np.std(again.w - log.motion.base.w) == pytest.approx(0.004 * share, rel=0.1)
    assert np.std(again.f - log.motion.base.f) == pytest.approx(0.07 * share, rel=0.1)
