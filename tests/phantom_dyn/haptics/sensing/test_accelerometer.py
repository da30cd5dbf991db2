"""Observer of position and acceleration: known motions, its covariance, and the estimators without acceleration."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.sensing.accelerometer import (
    AccelerationObserver,
    Accelerometer,
    observe_velocity,
    observer_gains,
)
from phantom_dyn.haptics.sensing.encoder import Encoder, record_motion
from phantom_dyn.haptics.sensing.velocity_comparison import estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import IMPROVED, KalmanVelocity, kalman_gains

T = 1e-3
MOTION = {"speed": 0.1003, "acceleration": 0.1}


def test_an_accelerated_motion_is_followed_without_lag(rng):
    found = estimator_figures(AccelerationObserver(), Encoder(), **MOTION, accelerometer=Accelerometer(), rng=rng)
    assert abs(found.lag) < 0.1e-3
    assert estimator_figures(IMPROVED, Encoder(), **MOTION).lag > 7e-3


def test_a_bias_of_the_accelerometer_is_found_and_leaves_the_velocity_as_it_is(rng):
    """Known truth: 0.3 m/s2 of bias, and the speed it is to find, 0.1003 m/s."""
    found = estimator_figures(
        AccelerationObserver(), Encoder(), **MOTION, accelerometer=Accelerometer(0.05, bias=0.3), rng=rng
    )
    settled = found.steady_estimate[found.t >= 0.6]
    assert settled.mean() == pytest.approx(0.1003, abs=1e-4)


def test_it_is_less_noisy_than_the_kalman_filter_of_the_position_alone(rng):
    with_it = estimator_figures(AccelerationObserver(), Encoder(), **MOTION, accelerometer=Accelerometer(), rng=rng)
    assert with_it.noise < 0.5 * estimator_figures(KalmanVelocity(), Encoder(), **MOTION).noise


def test_its_gains_without_a_bias_that_walks_are_those_of_the_kalman_filter():
    """Oracle: the filter of constant velocity pushed by white acceleration, in the limit of no drift."""
    position, velocity, bias = observer_gains(AccelerationObserver(1.0, 1e-7), step=3e-5, period=T)
    assert (position, velocity) == pytest.approx(kalman_gains(KalmanVelocity(1.0), step=3e-5, period=T), rel=1e-3)
    assert abs(bias) < 1e-2


def test_the_observed_error_has_the_deviation_that_the_gains_are_made_for(rng):
    """Known truth: readings with white noise of a twelfth of a step squared in the place of rounding."""
    observer, count = AccelerationObserver(0.5, 0.01), 40_000
    still = record_motion(Encoder(), np.zeros(count), interval=T, samples_apart=1)
    noise = Encoder().step / math.sqrt(12) * rng.standard_normal(count)
    object.__setattr__(still, "reading", noise)
    found = observe_velocity(observer, still, 0.5 * rng.standard_normal(count))[5000:]
    # Mean of two readings: half the variance drives the velocity, and what is foreseen is corrected by the same gains.
    position, velocity, _ = observer_gains(observer, step=Encoder().step, period=T)
    A = np.array([[1.0, T], [0.0, 1.0]])
    kept = (np.eye(2) - np.outer([position, velocity], [1.0, 0.0])) @ A
    w = np.linspace(1e-4, math.pi, 40_001)
    z = np.exp(1j * w)
    inverse = np.linalg.inv(z[:, None, None] * np.eye(2) - kept)
    by_reading = np.abs((inverse @ (z[:, None] * np.array([position, velocity]))[:, :, None])[:, 1, 0]) ** 2
    push = (np.eye(2) - np.outer([position, velocity], [1.0, 0.0])) @ np.array([T**2 / 2, T])
    by_acceleration = np.abs((inverse @ (0.5 * (1 + z)[:, None] * push)[:, :, None])[:, 1, 0]) ** 2
    response = by_reading * Encoder().step ** 2 / 12 + by_acceleration * 0.25
    assert found.std() == pytest.approx(math.sqrt(np.trapezoid(response, w) / math.pi), rel=0.05)


def test_an_observer_without_an_accelerometer_is_refused():
    with pytest.raises(ParameterError, match="has no accelerometer"):
        estimator_figures(AccelerationObserver(), Encoder(), **MOTION)


def test_accelerations_of_another_length_are_refused():
    record = record_motion(Encoder(), np.zeros(100), interval=T, samples_apart=1)
    with pytest.raises(ParameterError, match="one number for each of 100 samples"):
        observe_velocity(AccelerationObserver(), record, np.zeros(99))


def test_an_accelerometer_of_negative_noise_is_refused():
    with pytest.raises(ParameterError, match="noise of the accelerometer is -1"):
        Accelerometer(noise=-1.0)
