"""Encoders and accelerometers of a haptic device."""

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
from phantom_dyn.haptics.sensing.encoder import (
    PHANTOM_STEP,
    Encoder,
    SinusoidalEncoder,
    record_motion,
    record_sinusoidal,
)
from phantom_dyn.haptics.sensing.velocity_comparison import estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import (
    IMPROVED,
    AveragedDifference,
    KalmanVelocity,
    PeriodMeasurement,
    estimate_velocity,
    kalman_gains,
)


def test_counts_are_the_rounded_position(rng):
    position = np.cumsum(rng.normal(size=501)) * 0.4
    record = record_motion(Encoder(1.0), position, interval=1e-4, samples_apart=10)
    np.testing.assert_array_equal(record.counts, np.floor(position[::10] + 0.5))


def test_edges_of_a_steady_motion_come_every_step_over_speed():
    position = 0.2 * np.arange(501) * 1e-3  # 0.2 units/s for 0.5 s
    record = record_motion(Encoder(0.01), position, interval=1e-3, samples_apart=1)
    np.testing.assert_allclose(record.edge_time, (np.arange(10) + 0.5) * 0.05, rtol=0, atol=1e-12)


def test_a_motion_there_and_back_passes_every_edge_in_both_directions():
    position = np.concatenate([np.linspace(0, 3, 31), np.linspace(3, 0, 31)[1:]])
    record = record_motion(Encoder(1.0), position, interval=1e-3, samples_apart=1)
    np.testing.assert_array_equal(record.edge_direction, [1, 1, 1, -1, -1, -1])
    assert record.counts[-1] == 0


def test_misplaced_edges_repeat_after_four():
    position = np.arange(2001) * 0.01
    record = record_motion(Encoder(1.0, (0.0, 0.1, 0.0, -0.1)), position, interval=0.01, samples_apart=1)
    spacing = np.diff(record.edge_time)[:16].reshape(4, 4)
    np.testing.assert_allclose(spacing[0], [0.9, 0.9, 1.1, 1.1], rtol=0, atol=1e-9)  # edges 1.1, 2.0, 2.9, 4.0, ...
    np.testing.assert_allclose(spacing, spacing[[0]].repeat(4, axis=0), rtol=0, atol=1e-9)


@pytest.mark.parametrize("step", [0.0, -1e-3, float("nan")])
def test_a_step_that_is_not_positive_is_refused(step):
    with pytest.raises(ParameterError, match=r"The step of the encoder is .*: give a number above 0"):
        Encoder(step)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda: Encoder(1.0, (0.0, 0.25, 0.0, 0.0)),
            "give four shares of a step",
            id="a misplacement of a quarter step",
        ),
        pytest.param(
            lambda: record_motion(Encoder(), np.zeros(10), interval=1e-3, samples_apart=10),
            "less than two samples: give a longer motion",
            id="a motion shorter than two samples",
        ),
        pytest.param(
            lambda: record_motion(Encoder(), np.array([0.0, np.nan, 0.0]), interval=1e-3, samples_apart=1),
            "not finite",
            id="a motion with a gap",
        ),
        pytest.param(lambda: SinusoidalEncoder(offset=(0.6, 0.0)), "of at most 0", id="errors in which a line is lost"),
        pytest.param(
            lambda: record_sinusoidal(SinusoidalEncoder(), np.linspace(0, 1, 100), interval=1e-3, samples_apart=1),
            "at most a quarter of a line apart",
            id="a motion too coarse to count lines",
        ),
        pytest.param(
            lambda: estimator_figures(AccelerationObserver(), Encoder(), **MOTION),
            "has no accelerometer",
            id="an observer without an accelerometer",
        ),
        pytest.param(
            lambda: Accelerometer(noise=-1.0),
            "noise of the accelerometer is -1",
            id="an accelerometer of negative noise",
        ),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


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


def test_accelerations_of_another_length_are_refused():
    record = record_motion(Encoder(), np.zeros(100), interval=T, samples_apart=1)
    with pytest.raises(ParameterError, match="one number for each of 100 samples"):
        observe_velocity(AccelerationObserver(), record, np.zeros(99))
