"""Velocity estimators and the loops that they close."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.published import PHANTOM_1_5_Z
from phantom_dyn.haptics.sensing.encoder import PHANTOM_STEP, Encoder, EncoderRecord, record_motion
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings, LoopTrace, gain_until_swinging, simulate_loop
from phantom_dyn.haptics.sensing.velocity_comparison import EstimatorFigures, estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import (
    IMPROVED,
    STOCK,
    AdaptiveWindow,
    AveragedDifference,
    Estimator,
    KalmanVelocity,
    PeriodMeasurement,
    estimate_velocity,
    kalman_gains,
)
from phantom_dyn.haptics.stability.sampled_loop import SampledLoop

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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda: AveragedDifference(0),
            "samples is 0: give a whole number from 1 to 500",
            id="a window of no samples",
        ),
        pytest.param(lambda: AdaptiveWindow(10, 0.0), "bound of the adaptive window is 0", id="a bound of nothing"),
        pytest.param(
            lambda: KalmanVelocity(0.0), "acceleration of the Kalman filter is 0", id="an acceleration of nothing"
        ),
        pytest.param(
            lambda: PeriodMeasurement(clock=0.0), "give a clock above 0 and 1 to 52 bits", id="a clock that stands"
        ),
        pytest.param(
            lambda: estimator_figures(STOCK, Encoder(), speed=0.1, acceleration=0.0),
            "an acceleration that is not 0",
            id="no acceleration",
        ),
        pytest.param(
            lambda: gain_until_swinging(lambda _: swinging(0.0), 1e-5, low=2.0, high=1.0),
            "give two above 0, the lower one first",
            id="gains in the wrong order",
        ),
        pytest.param(
            lambda: LoopSettings(delay=0.33e-4), "give a multiple of 5e-05 s", id="a delay between the substeps"
        ),
        pytest.param(lambda: LoopSettings(period=0.0), "period of the loop is 0", id="a period of nothing"),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


def figures(estimator: Estimator) -> EstimatorFigures:
    return estimator_figures(estimator, Encoder(), speed=0.1003, acceleration=0.1)


@pytest.mark.parametrize("samples", [16, 100])
def test_an_average_of_n_is_n_times_finer_and_lags_by_half_its_length(samples):
    measured = figures(AveragedDifference(samples))
    assert measured.granularity == pytest.approx(30e-3 / samples, rel=1e-6)
    assert measured.lag == pytest.approx(samples * 0.5e-3, rel=5e-3)


def test_the_improved_estimator_has_the_lag_of_its_16_samples():
    assert figures(IMPROVED).lag == pytest.approx(15 / 2 * 1e-3, abs=0.3e-3)  # and half a period of the encoder


def test_the_granularity_of_a_period_is_one_tick():
    measured = estimator_figures(PeriodMeasurement(samples=1), Encoder(), speed=0.1003, acceleration=0.1)
    assert measured.granularity == pytest.approx(0.1003**2 / (PHANTOM_STEP * 10e6), rel=2e-3)


def test_adaptive_window_lags_less_than_a_parabola_fits_its_bound():
    longest = math.sqrt(8 * PHANTOM_STEP / 0.1)  # chord of a parabola: a n^2 T^2 / 8 = bound
    assert 0 < figures(AdaptiveWindow()).lag < longest / 2


def test_kalman_lag_is_that_of_its_closed_form():
    position_gain, velocity_gain = kalman_gains(KalmanVelocity(), step=PHANTOM_STEP, period=1e-3)
    # Steady error of the prediction: e = a T / velocity_gain, of the velocity after it: (e position_gain - a T^2/2)/T.
    lag = 1e-3 / velocity_gain * position_gain / 1e-3 - 0.5e-3
    assert figures(KalmanVelocity()).lag == pytest.approx(lag, rel=0.02)


FINE = Encoder(1e-9)

RIGID = RigidAxis(0.05, 1.0)

TWO_MASS = TwoMassAxis(0.02, 0.03, 0.3, 0.3, 5e3, 0.5)


@pytest.mark.parametrize("delay", [0.0, 0.35e-3, 1.6e-3])
@pytest.mark.parametrize("axis", [RIGID, TWO_MASS], ids=["rigid", "two masses"])
def test_a_fine_encoder_gives_the_exact_sampled_loop(axis, delay):
    settings = LoopSettings(delay=delay, encoder=FINE)
    trace = simulate_loop(
        (axis,), settings, gain=300.0, damping=0.0, start=(1e-3,), speed=(0.0,), hand=np.zeros((200, 1))
    )
    loop = SampledLoop((discretise(axis, period=1e-3, delay=delay),))
    matrix, state = loop.closed_loop(300.0), np.zeros(loop.closed_loop(300.0).shape[0])
    state[: len(axis.state_space.B)] = axis.rest(1e-3)
    exact = np.empty(200)
    for k in range(200):
        exact[k] = loop.plant.output @ state[: len(loop.plant.output)]
        state = matrix @ state
    np.testing.assert_allclose(trace.position[:, 0], exact, rtol=0, atol=2e-8)


def test_a_free_push_is_the_matrix_exponential():
    trace = simulate_loop(
        (RIGID,), LoopSettings(), gain=0.0, damping=0.0, start=(0.0,), speed=(0.2,), hand=np.full((101, 1), 0.5)
    )
    A = np.array([[0, 1, 0], [0, -1.0 / 0.05, 0.5 / 0.05], [0, 0, 0]])
    assert trace.position[-1, 0] == pytest.approx((expm(A * 0.1) @ [0, 0.2, 1])[0], rel=1e-9)


def test_readings_are_the_rounded_position():
    trace = simulate_loop(
        (RIGID,), LoopSettings(), gain=100.0, damping=0.0, start=(2e-3,), speed=(0.1,), hand=np.zeros((300, 1))
    )
    step = LoopSettings().encoder.step
    np.testing.assert_allclose(trace.reading, np.floor(trace.position / step + 0.5) * step, rtol=0, atol=1e-15)


def test_a_wall_pushes_only_from_inside():
    trace = simulate_loop(
        (RIGID,), LoopSettings(), gain=500.0, damping=0.0, start=(0.0,), speed=(0.1,), hand=np.zeros((300, 1)),
        one_sided=True,
    )  # fmt: skip
    inside = trace.reading > 0
    np.testing.assert_allclose(trace.force[inside], -500.0 * trace.reading[inside], rtol=1e-12)
    assert inside.any()
    assert not trace.force[~inside].any()


def test_a_position_that_answers_at_once_is_read_before_its_force_acts():
    trace = simulate_loop(
        (PHANTOM_1_5_Z,), LoopSettings(), gain=0.0, damping=0.0, start=(0.0,), speed=(0.0,), hand=np.ones((3, 1))
    )
    assert trace.position[0, 0] == 0.0
    # One millisecond of force: its feed-through, and what the poles have added to it.
    assert trace.position[1, 0] > PHANTOM_1_5_Z.state_space.D


def test_a_loop_that_runs_away_ends_there():
    trace = simulate_loop(
        (RIGID,), LoopSettings(), gain=1e6, damping=0.0, start=(1e-3,), speed=(0.0,), hand=np.zeros((2000, 1))
    )
    assert trace.ran_away
    assert len(trace.t) < 2000


def swinging(decay: float) -> LoopTrace:
    t = np.arange(3000) * 1e-3
    x = (np.exp(-decay * t) * np.sin(50 * t))[:, None] * 1e-3
    return LoopTrace(t, x, x, x, x, False)


@pytest.mark.parametrize(("decay", "lasts"), [(0.0, True), (-1.0, True), (1.0, False)])
def test_a_swing_lasts_if_it_does_not_decay(decay, lasts):
    assert swinging(decay).keeps_swinging(1e-5) is lasts


def test_a_swing_of_less_than_ten_steps_is_rounding():
    assert not swinging(0.0).keeps_swinging(1e-3)


def test_bisection_finds_the_gain_from_which_on_a_swing_lasts():
    found = gain_until_swinging(lambda gain: swinging(0.5 * (7.0 - gain)), 1e-5, low=1.0, high=100.0)
    assert found == pytest.approx(7.0, rel=0.06)  # nine tenths in a second is a decay of 0.1


def test_a_swing_at_the_lowest_gain_is_a_limit_of_nothing_and_none_at_the_highest_no_limit():
    assert gain_until_swinging(lambda _: swinging(0.0), 1e-5, low=1.0, high=2.0) == 0.0
    assert gain_until_swinging(lambda _: swinging(1.0), 1e-5, low=1.0, high=2.0) == np.inf


def test_three_devices_are_refused():
    with pytest.raises(ParameterError, match="give one or two devices and as many of each"):
        simulate_loop(
            (RIGID,) * 3, LoopSettings(), gain=1.0, damping=0.0, start=(0.0,) * 3, speed=(0.0,) * 3,
            hand=np.zeros((10, 3)),
        )  # fmt: skip
