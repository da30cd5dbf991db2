"""Sinusoidal encoders: the arc tangent against its expansion, and the published gain in resolution."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.sensing.encoder import PHANTOM_STEP, Encoder
from phantom_dyn.haptics.sensing.sinusoidal_encoder import SinusoidalEncoder, record_sinusoidal
from phantom_dyn.haptics.sensing.velocity_comparison import estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import AveragedDifference, PeriodMeasurement, estimate_velocity

LINE = 2 * math.pi / SinusoidalEncoder().pitch
X = np.linspace(-3.0, 3.0, 1201) * SinusoidalEncoder().pitch


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        ({"offset": (0.01, 0.0)}, lambda turn: 0.01 * np.cos(turn)),
        ({"offset": (0.0, 0.01)}, lambda turn: -0.01 * np.sin(turn)),
        ({"mismatch": 0.01}, lambda turn: 0.005 * np.sin(2 * turn)),
        ({"phase": 0.01}, lambda turn: 0.005 * (1 + np.cos(2 * turn))),
        ({"harmonic": 0.01}, lambda turn: 0.01 * np.sin(4 * turn)),
    ],
)
def test_a_small_signal_error_leaves_the_wave_of_its_expansion(error, expected):
    """Oracle: first-order expansion of the arc tangent; the second order is 1e-4."""
    found = LINE * (SinusoidalEncoder(**error).interpolated(X) - X)
    np.testing.assert_allclose(found, expected(LINE * X), atol=1.5e-4)


def test_perfect_signals_are_read_without_error():
    np.testing.assert_allclose(SinusoidalEncoder().interpolated(X), X, atol=1e-18)


@pytest.mark.parametrize("factor", [16, 64])
def test_the_velocity_granularity_falls_by_the_planned_factor(factor):
    """Published: position and velocity finer by a factor of 16 to 64 than the quadrature."""
    coarse = estimator_figures(AveragedDifference(), Encoder(), speed=0.1003, acceleration=0.1)
    fine = estimator_figures(AveragedDifference(), SinusoidalEncoder(factor=factor), speed=0.1003, acceleration=0.1)
    assert coarse.granularity / fine.granularity == pytest.approx(factor, rel=1e-6)
    assert SinusoidalEncoder(factor=factor).step == pytest.approx(PHANTOM_STEP / factor, rel=1e-12)


def test_an_offset_of_two_per_cent_ripples_the_velocity_by_two_per_cent_however_fine_the_steps():
    """Closed form: the ripple's amplitude is o v; 50 samples of 20 us to a line, so that it is seen in full."""
    encoder = SinusoidalEncoder(factor=65536, offset=(0.02, 0.0))
    speed, interval = 0.12, 2e-5
    position = speed * interval * np.arange(500)
    record = record_sinusoidal(encoder, position, interval=interval, samples_apart=1)
    velocity = estimate_velocity(AveragedDifference(), record)[1:]
    assert np.ptp(velocity) / 2 == pytest.approx(0.02 * speed, rel=0.05)


def test_edges_of_the_interpolated_counts_serve_the_period_measurement():
    position = 1e-3 + 0.05 * 1e-5 * np.arange(60_000)
    record = record_sinusoidal(SinusoidalEncoder(factor=16), position, interval=1e-5, samples_apart=100)
    assert estimate_velocity(PeriodMeasurement(), record)[-1] == pytest.approx(0.05, rel=1e-3)


def test_errors_in_which_a_line_is_lost_are_refused():
    with pytest.raises(ParameterError, match="of at most 0"):
        SinusoidalEncoder(offset=(0.6, 0.0))


def test_a_motion_too_coarse_to_count_lines_is_refused():
    with pytest.raises(ParameterError, match="at most a quarter of a line apart"):
        record_sinusoidal(SinusoidalEncoder(), np.linspace(0, 1, 100), interval=1e-3, samples_apart=1)
