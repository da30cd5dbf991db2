"""Lag and granularity against closed forms and the figures of Cavusoglu, Feygin and Tendick (2002)."""

from __future__ import annotations

import math

import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.sensing.encoder import PHANTOM_STEP, Encoder
from phantom_dyn.haptics.sensing.velocity_comparison import EstimatorFigures, estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import (
    IMPROVED,
    STOCK,
    AdaptiveWindow,
    AveragedDifference,
    Estimator,
    KalmanVelocity,
    PeriodMeasurement,
    kalman_gains,
)


def figures(estimator: Estimator) -> EstimatorFigures:
    return estimator_figures(estimator, Encoder(), speed=0.1003, acceleration=0.1)


def test_finite_difference_has_a_granularity_of_30_mm_per_second():
    assert figures(AveragedDifference()).granularity == pytest.approx(30e-3, rel=1e-6)


@pytest.mark.parametrize("samples", [16, 100])
def test_an_average_of_n_is_n_times_finer_and_lags_by_half_its_length(samples):
    measured = figures(AveragedDifference(samples))
    assert measured.granularity == pytest.approx(30e-3 / samples, rel=1e-6)
    assert measured.lag == pytest.approx(samples * 0.5e-3, rel=5e-3)


def test_the_stock_lag_of_50_ms_is_half_a_turn_at_10_hertz():
    assert 360 * 10 * figures(STOCK).lag == pytest.approx(180, rel=5e-3)


def test_16_samples_for_100_make_the_lag_six_times_shorter():
    assert figures(STOCK).lag / figures(AveragedDifference(16)).lag == pytest.approx(6.25, rel=5e-3)


def test_the_improved_estimator_has_the_lag_of_its_16_samples():
    assert figures(IMPROVED).lag == pytest.approx(15 / 2 * 1e-3, abs=0.3e-3)  # and half a period of the encoder


def test_the_granularity_of_a_period_is_one_tick():
    measured = estimator_figures(PeriodMeasurement(samples=1), Encoder(), speed=0.1003, acceleration=0.1)
    assert measured.granularity == pytest.approx(0.1003**2 / (PHANTOM_STEP * 10e6), rel=2e-3)


def test_adaptive_window_lags_less_than_a_parabola_fits_its_bound():
    longest = math.sqrt(8 * PHANTOM_STEP / 0.1)  # chord of a parabola: a n^2 T^2 / 8 = bound
    assert 0 < figures(AdaptiveWindow()).lag < longest / 2


def test_adaptive_window_is_as_fine_as_the_average_of_its_length():
    assert figures(AdaptiveWindow(100)).granularity == pytest.approx(0.3e-3, rel=1e-6)


def test_kalman_lag_is_that_of_its_closed_form():
    position_gain, velocity_gain = kalman_gains(KalmanVelocity(), step=PHANTOM_STEP, period=1e-3)
    # Steady error of the prediction: e = a T / velocity_gain, of the velocity after it: (e position_gain - a T^2/2)/T.
    lag = 1e-3 / velocity_gain * position_gain / 1e-3 - 0.5e-3
    assert figures(KalmanVelocity()).lag == pytest.approx(lag, rel=0.02)


def test_kalman_with_more_acceleration_lags_less_and_is_coarser():
    calm, agile = figures(KalmanVelocity(1.0)), figures(KalmanVelocity(10.0))
    assert agile.lag < calm.lag
    assert agile.granularity > calm.granularity


def test_no_acceleration_is_refused():
    with pytest.raises(ParameterError, match="an acceleration that is not 0"):
        estimator_figures(STOCK, Encoder(), speed=0.1, acceleration=0.0)
