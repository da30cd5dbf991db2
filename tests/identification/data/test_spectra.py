from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from identification.data.signals import _driven_edge, acceleration_edge, driven_edge, torque_edge

RATE = 500.0
T = np.arange(round(20 * RATE)) / RATE


def swinging(rng: np.random.Generator, top_hz: float) -> np.ndarray:
    """Positions with content up to a known frequency, flat in acceleration."""
    f = np.arange(0.2, top_hz, 0.2)
    phase = rng.uniform(0, 2 * np.pi, len(f))
    return (np.cos(2 * np.pi * np.outer(T, f) + phase) / f**2).sum(axis=1)


@pytest.mark.parametrize(("top_hz", "noise"), [(5.0, 1e-3), (12.0, 1e-3), (30.0, 1e-4)])
def test_the_acceleration_of_a_joint_ends_where_its_motion_ends(rng, top_hz, noise):
    # Known truth: content up to top_hz, then white noise of the position; bins and envelope are half an octave wide.
    q = swinging(rng, top_hz) + noise * rng.normal(size=len(T))
    edge = acceleration_edge(q, RATE)
    assert edge is not None
    assert 0.8 * top_hz < edge < 1.6 * top_hz


def test_a_joint_at_rest_has_no_edge(rng):
    assert acceleration_edge(1e-4 * rng.normal(size=len(T)), RATE) is None


def test_a_joint_that_never_moves_has_no_edge():
    assert acceleration_edge(np.full(len(T), 0.3), RATE) is None


def test_a_coarser_encoder_lowers_the_edge(rng):
    f = np.arange(0.2, 60.0, 0.2)
    phase = rng.uniform(0, 2 * np.pi, len(f))
    q = (np.cos(2 * np.pi * np.outer(T, f) + phase) / f**4).sum(axis=1)
    edges = [acceleration_edge(np.round(q / step) * step, RATE) or 0.0 for step in (1e-5, 1e-3, 1e-1)]
    assert edges[0] > 1.5 * edges[1] > 1.5**2 * edges[2] > 0


def test_the_torque_of_a_recorder_that_smooths_ends_at_its_filter(rng):
    # Known truth: an eighth-order low pass at 40 Hz leaves 1 % of the amplitude within an octave.
    tau = sosfiltfilt(butter(8, 40.0, fs=RATE, output="sos"), rng.normal(size=len(T)))
    assert 40.0 < torque_edge(tau, RATE) < 60.0


@pytest.mark.parametrize(("amplitude", "edge"), [(0.03, 80.0), (0.003, 10.0)])
def test_the_torque_ends_where_a_hundredth_of_its_amplitude_is_left(amplitude, edge):
    # Closed form: a hum of 3 % at 80 Hz counts, one of 0.3 % does not; the window is three bins of 0.25 Hz wide.
    tau = np.sin(2 * np.pi * 10.0 * T) + amplitude * np.sin(2 * np.pi * 80.0 * T)
    assert torque_edge(tau, RATE) == pytest.approx(edge, abs=1.0)


def test_white_torque_reaches_half_the_rate(rng):
    assert torque_edge(rng.normal(size=len(T)), RATE) == pytest.approx(0.5 * RATE, rel=0.01)


def test_no_torque_has_no_band():
    assert torque_edge(np.zeros(len(T)), RATE) == 0.0


def ramps(amplitude: float, hz: float) -> np.ndarray:
    """A triangle wave of a position."""
    return amplitude * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * hz * T))


@pytest.mark.parametrize("noise", [5e-4, 1e-3, 3e-3])
def test_the_edge_of_ramps_is_where_the_noise_of_the_encoder_takes_over(rng, noise):
    # Closed form: a triangle wave has acceleration lines of 32 A f^2 every 2 f, a flat density of (32 A f^2)^2 / (4 f);
    # white noise of the position has 2 s^2 / rate (2 pi f)^4. Where they sum to ten times the noise is the edge.
    amplitude, hz = 0.5, 0.4
    flat = (32 * amplitude * hz**2) ** 2 / (4 * hz)
    expected = (flat * RATE / (18 * noise**2)) ** 0.25 / (2 * np.pi)
    edge = acceleration_edge(ramps(amplitude, hz) + noise * rng.normal(size=len(T)), RATE)
    assert edge == pytest.approx(expected, rel=0.3)


def test_a_spectrum_that_does_not_rise_like_that_of_an_encoder_has_no_edge(rng):
    # White acceleration, twice integrated: nothing tells its end.
    assert acceleration_edge(np.cumsum(np.cumsum(1e-5 * rng.normal(size=len(T)))), RATE) is None


def lines(*hz: float) -> np.ndarray:
    return sum(np.sin(2 * np.pi * f * T) for f in hz)


def test_the_drive_ends_below_the_lowest_third_octave_in_which_the_model_alone_moves():
    # By hand: thirds of an octave down from 40 Hz end at 31.7, 25.2, 20, 15.9, 12.6 and 10 Hz. Up to 12.6 Hz both have
    # a line; the model alone has one in each above.
    edge = driven_edge(lines(5.0, 11.0), lines(5.0, 11.0, 14.0, 18.0, 22.0, 28.0, 36.0), RATE, 40.0)
    assert edge == pytest.approx(40.0 / 2 ** (5 / 3))


def test_a_drive_that_moves_what_is_at_the_top_has_no_end():
    # A line at the top is driven, whatever lies below it.
    assert driven_edge(lines(5.0, 36.0), lines(5.0, 14.0, 36.0), RATE, 40.0) == np.inf


@pytest.mark.parametrize(("share", "driven"), [(0.6, False), (0.8, True)])
def test_a_torque_of_half_the_power_that_the_model_needs_drives_it(share, driven):
    # Closed form: shares of amplitude of 0.6 and 0.8 are 0.36 and 0.64 of the power.
    assert (driven_edge(share * lines(36.0), lines(36.0), RATE, 40.0) == np.inf) is driven


def test_what_no_drive_moves_is_followed_down_to_two_hertz():
    # By hand: 16, 12.7, ..., 2.52, 2.0: the last third that begins above 2 Hz ends there.
    f = 16.0 / 2 ** (np.arange(9) / 3) * 0.9
    assert driven_edge(1e-3 * lines(*f), lines(*f), RATE, 16.0) == pytest.approx(2.0)


def test_a_robot_has_the_median_end_of_its_moving_joints_on_the_longest_recording(pendulum):
    # Known truth: a hum of 12 Hz that the torque knows nothing of; at rest nothing is moved, so nothing ends.
    still = np.zeros((len(T), 1))
    swing = 0.5 * np.sin(2 * np.pi * 1.0 * T)[:, None]
    model = -1.1 * (2 * np.pi) ** 2 * swing
    hum = 2e-3 * np.sin(2 * np.pi * 12.0 * T)[:, None]
    assert 1.0 < _driven_edge(pendulum, [(swing + hum, model, RATE), (still[:900], still[:900], RATE)], 15.0) < 12.0
    assert _driven_edge(pendulum, [(still, still, RATE)], 15.0) == np.inf
