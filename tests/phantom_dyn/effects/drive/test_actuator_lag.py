from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.effects.drive.actuator_lag import ActuatorLag, lag_law
from phantom_dyn.effects.operation import Operation
from phantom_dyn.signals.recursive import lagging_linear

EFFECT = ActuatorLag()
THETA = np.array([0.02])
W = 10.0  # rad/s


@pytest.fixture(scope="module")
def sine(arm, smooth) -> Operation:
    """The drives are to give sines of 3, 2 and 1 N m."""
    return replace(smooth, expected=np.sin(W * smooth.t)[:, None] * [3.0, 2.0, 1.0])


def low_passed(t: np.ndarray, time_constant: float) -> np.ndarray:
    """Closed form: answer of a first-order low pass to sin(W t) after the start has faded."""
    gain = 1 / np.sqrt(1 + (W * time_constant) ** 2)
    return gain * np.sin(W * t - np.arctan(W * time_constant))


def test_the_command_leads_a_sine_as_a_low_pass_lags(arm, sine):
    # Closed form: gain sqrt(1 + (w T)^2), phase atan(w T).
    command = sine.expected - EFFECT.torque(arm, sine, None, THETA)
    lead = np.hypot(1, W * 0.02) * np.sin(W * sine.t + np.arctan(W * 0.02))
    np.testing.assert_allclose(command[1:-1], (lead[:, None] * [3.0, 2.0, 1.0])[1:-1], atol=1e-4)


def test_a_simulated_drive_is_a_low_pass(arm, sine, given_in_steps):
    command = np.sin(W * sine.t)[:, None] * np.ones(3)
    given = given_in_steps(EFFECT.simulated(arm, None, THETA), sine.t, command)
    np.testing.assert_allclose(given[300:, 1], low_passed(sine.t[300:], 0.02), atol=2e-3)


def test_only_the_named_drive_lags(arm, given_in_steps, rng):
    command = rng.normal(size=(30, 3))
    given = given_in_steps(EFFECT.simulated(arm, "tilt", THETA), np.arange(30) * 0.01, command)
    np.testing.assert_array_equal(given[:, [0, 2]], command[:, [0, 2]])
    assert np.abs(given[1:, 1] - command[1:, 1]).min() > 0


def test_it_starts_at_the_first_command(arm, given_in_steps):
    given = given_in_steps(EFFECT.simulated(arm, None, THETA), np.arange(5) * 0.01, np.full((5, 3), 1.7))
    np.testing.assert_allclose(given, 1.7, rtol=1e-14)


def test_a_ramp_is_followed_a_time_constant_late():
    # Closed form: t - T (1 - exp(-t / T)) from balance at a torque of 2.
    t = np.arange(50) * 0.01
    expected = 2.0 + 3.0 * (t - 0.02 * (1.0 - np.exp(-t / 0.02)))
    np.testing.assert_allclose(lagging_linear(2.0 + 3.0 * t, 0.01, 0.02), expected, rtol=1e-12)


def test_without_a_time_constant_a_series_is_given_as_it_is(rng):
    tau = rng.normal(size=9)
    np.testing.assert_array_equal(lagging_linear(tau, 0.01, 0.0), tau)


@pytest.mark.parametrize(
    ("now", "asked", "dt", "time_constant", "after"),
    # Closed form: 1/e of a step of 2 is left after one time constant, and 1 - 1/e of it on average.
    [
        (1.0, 3.0, 0.02, 0.02, (3.0 - 2.0 / np.e, 3.0 - 2.0 * (1.0 - 1.0 / np.e))),
        (np.nan, 3.0, 0.02, 0.02, (3.0, 3.0)),
        (1.0, 3.0, 0.02, 0.0, (3.0, 3.0)),
        (1.0, 3.0, 0.0, 0.02, (1.0, 1.0)),
    ],
    ids=["step", "first", "no lag", "no time"],
)
def test_a_step_of_torque_is_left_exponentially(now, asked, dt, time_constant, after):
    assert lag_law(now, asked, dt, time_constant) == pytest.approx(after)


def test_a_single_sample_has_no_slope(arm, sine):
    series = ("t", "q", "v", "a", "tau", "expected", "logged", "temperature")
    one = replace(sine, **{name: getattr(sine, name)[:1] for name in series})
    assert not EFFECT.torque(arm, one, None, THETA).any()


def test_no_drive_is_early_nor_late_by_a_second(arm):
    assert EFFECT.coefficient_bounds(arm, None, ()) == ((0.0, 1.0),)
