"""Velocity estimators: closed forms, and the figures of Cavusoglu, Feygin and Tendick (2002), sections 4.1 and 4.2."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.sensing.encoder import PHANTOM_STEP, Encoder, EncoderRecord, record_motion
from phantom_dyn.haptics.sensing.velocity_estimators import (
    IMPROVED,
    STOCK,
    AdaptiveWindow,
    AveragedDifference,
    KalmanVelocity,
    PeriodMeasurement,
    estimate_velocity,
    kalman_gains,
)

PERIOD = 1e-3
ESTIMATORS = [AveragedDifference(), STOCK, AdaptiveWindow(), KalmanVelocity(), IMPROVED]


def steady(speed: float, *, encoder: Encoder | None = None, seconds: float = 0.5) -> EncoderRecord:
    """Record of a motion at one speed, 20 points to a sample."""
    fine = np.arange(round(seconds / PERIOD) * 20 + 1) * PERIOD / 20
    return record_motion(encoder or Encoder(), speed * fine, interval=PERIOD / 20, samples_apart=20)


def test_finite_difference_is_that_of_the_readings(rng):
    record = record_motion(Encoder(1.0), np.cumsum(rng.normal(size=300)), interval=PERIOD, samples_apart=1)
    np.testing.assert_allclose(
        estimate_velocity(AveragedDifference(), record)[1:], np.diff(record.reading) / PERIOD, rtol=0, atol=1e-9
    )


def test_average_of_a_hundred_is_the_mean_of_a_hundred_differences(rng):
    record = record_motion(Encoder(1.0), np.cumsum(rng.normal(size=300)), interval=PERIOD, samples_apart=1)
    differences = np.diff(record.reading) / PERIOD
    assert estimate_velocity(STOCK, record)[-1] == pytest.approx(differences[-100:].mean(), rel=1e-12)


def test_a_step_at_100_mm_per_second_lasts_3000_ticks():
    record = steady(0.1)
    ticks = np.diff(np.floor(record.edge_time * IMPROVED.clock))
    np.testing.assert_allclose(ticks, 3000, atol=1)


def test_a_counter_that_wraps_takes_a_slow_motion_for_a_fast_one():
    velocity = estimate_velocity(PeriodMeasurement(samples=1, overflow="wraps"), steady(1e-3))
    assert velocity[-1] == pytest.approx(PHANTOM_STEP * 10e6 / (300_000 % 2**16), rel=1e-4)  # 7.92 mm/s for 1 mm/s


def test_counting_samples_past_the_overflow_keeps_the_speed_within_a_sample():
    velocity = estimate_velocity(PeriodMeasurement(samples=1), steady(1e-3))
    assert abs(velocity[-1] - 1e-3) < 1e-3 * PERIOD / (PHANTOM_STEP / 1e-3 - PERIOD)


def test_a_motion_that_stops_is_bounded_by_one_step_over_the_time_waited():
    moving = np.arange(0, 0.2, PERIOD / 20)
    position = 0.05 * np.concatenate([moving, np.full(4001, moving[-1])])
    record = record_motion(Encoder(), position, interval=PERIOD / 20, samples_apart=20)
    waited = record.counts.size - 1 - np.ceil(record.edge_time[-1] / PERIOD)
    velocity = estimate_velocity(PeriodMeasurement(samples=1), record)
    assert velocity[-1] == pytest.approx(PHANTOM_STEP / (waited * PERIOD), rel=1e-9)


def test_a_reversal_is_no_period():
    position = np.concatenate([np.linspace(0, 0.52, 201), np.linspace(0.52, 0.48, 21)[1:]])  # over the edge and back
    record = record_motion(Encoder(1.0), position, interval=PERIOD / 20, samples_apart=20)
    assert record.edge_direction.tolist() == [1.0, -1.0]
    assert estimate_velocity(PeriodMeasurement(samples=1), record)[-1] == 0.0


@pytest.mark.parametrize(("edges", "quiet"), [(1, False), (4, True), (6, False), (8, True)])
def test_periods_joined_by_fours_do_not_see_the_spacing_of_the_quadrature(edges, quiet):
    encoder = Encoder(PHANTOM_STEP, (0.0, 0.1, -0.05, 0.08))
    velocity = estimate_velocity(PeriodMeasurement(edges=edges, samples=1), steady(0.1, encoder=encoder))
    ripple = np.ptp(velocity[100:]) / 0.1
    assert (ripple < 2e-4) == quiet  # a tick in four periods of 3000 is 0.8e-4


def test_adaptive_window_is_the_long_average_in_a_steady_motion():
    record = steady(0.0317)
    np.testing.assert_allclose(
        estimate_velocity(AdaptiveWindow(50), record)[60:],
        estimate_velocity(AveragedDifference(50), record)[60:],
        rtol=1e-12,
    )


def test_adaptive_window_of_a_sudden_motion_forgets_the_rest_before_it():
    fine = np.arange(20 * 400 + 1) * PERIOD / 20
    record = record_motion(Encoder(), 0.3 * np.maximum(fine - 0.3, 0), interval=PERIOD / 20, samples_apart=20)
    adaptive = estimate_velocity(AdaptiveWindow(100), record)[310]  # 10 ms into the motion
    assert adaptive == pytest.approx(0.3, rel=0.1)
    assert estimate_velocity(STOCK, record)[310] == pytest.approx(0.03, rel=0.05)


def test_kalman_gains_are_where_the_riccati_recursion_ends():
    period, step, acceleration = PERIOD, PHANTOM_STEP, 2.0
    transition = np.array([[1, period], [0, 1]])
    push = acceleration * np.array([[period**2 / 2], [period]])
    covariance = np.eye(2)
    for _ in range(5000):
        covariance = transition @ covariance @ transition.T + push @ push.T
        gain = covariance[:, 0] / (covariance[0, 0] + step**2 / 12)
        covariance = covariance - np.outer(gain, covariance[0])
    np.testing.assert_allclose(kalman_gains(KalmanVelocity(acceleration), step=step, period=period), gain, rtol=1e-6)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_every_estimator_finds_a_steady_speed(estimator):
    velocity = estimate_velocity(estimator, steady(-0.03))  # one count a sample: nothing left to round
    np.testing.assert_allclose(velocity[200:], -0.03, rtol=1e-3)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_every_estimator_is_zero_at_rest(estimator):
    np.testing.assert_array_equal(estimate_velocity(estimator, steady(0.0)), 0.0)


def test_a_window_of_no_samples_is_refused():
    with pytest.raises(ParameterError, match="samples is 0: give a whole number from 1 to 500"):
        AveragedDifference(0)


def test_a_bound_of_nothing_is_refused():
    with pytest.raises(ParameterError, match="bound of the adaptive window is 0"):
        AdaptiveWindow(10, 0.0)


def test_an_acceleration_of_nothing_is_refused():
    with pytest.raises(ParameterError, match="acceleration of the Kalman filter is 0"):
        KalmanVelocity(0.0)


def test_a_clock_that_stands_is_refused():
    with pytest.raises(ParameterError, match="give a clock above 0 and 1 to 52 bits"):
        PeriodMeasurement(clock=0.0)


def test_an_unknown_overflow_is_refused():
    with pytest.raises(ParameterError, match="give 'bounded' or 'wraps'"):
        PeriodMeasurement(overflow="forgets")
