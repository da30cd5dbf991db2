from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from identification.spectra import acceleration_edge, torque_edge

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
