"""Safety logic of a driver: closed forms of one thermal mass, and what a driver does when its computer is late."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.drives import warming
from phantom_dyn.haptics.device.safety import Guard, ThermalMotor, armed, guarded, run_guard

MOTOR = ThermalMotor(resistance=2.0, thermal_resistance=10.0, time_constant=200.0)
GUARD = Guard(MOTOR, current_per_force=0.5, slowest=250.0, warmest=60.0, cool=50.0)


def test_the_rise_is_that_of_one_thermal_mass():
    """Oracle: `warming`, the curve that the published rises are drawn on."""
    t = np.linspace(0.0, 600.0, 7)
    curve = warming(heat_pulses=0.0, heat_linear=2.0 * 1.5**2, resistance=10.0, time_constant=200.0, t=t).linear
    np.testing.assert_allclose([MOTOR.rise_after(0.0, 1.5, time) for time in t], curve, rtol=1e-12)


def test_a_driver_lets_a_cool_motor_and_a_timely_computer_have_their_force():
    trace = run_guard(GUARD, 1e-3, np.linspace(-2.0, 2.0, 100))
    np.testing.assert_array_equal(trace.force, np.linspace(-2.0, 2.0, 100))


def test_the_current_goes_off_when_the_closed_form_reaches_the_warmest_rise():
    """Closed form: towards R_th R i^2 = 180 K the motor is at 60 K after tau ln(180 / (180 - 60))."""
    dt = 0.05
    trace = run_guard(Guard(MOTOR, 0.5, 1.0, 60.0, 50.0), dt, np.full(4000, 3.0 / 0.5))
    off = dt * int(np.argmax(trace.hot))
    assert off == pytest.approx(200.0 * math.log(180 / 120), abs=2 * dt)
    assert trace.rise.max() == pytest.approx(60.0, abs=0.1)


def test_a_hot_motor_comes_back_when_it_has_cooled_to_the_lower_rise():
    """Closed form: without current the rise falls from 60 K to 50 K in tau ln(60/50)."""
    dt = 0.05
    trace = run_guard(Guard(MOTOR, 0.5, 1.0, 60.0, 50.0), dt, np.full(6000, 6.0))
    changes = dt * np.flatnonzero(np.diff(trace.hot.astype(int)))
    assert changes[1] - changes[0] == pytest.approx(200.0 * math.log(60 / 50), rel=0.01)


def test_a_driver_that_hears_nothing_holds_the_force_for_one_slowest_period_and_then_gives_none():
    """250 Hz: after four cycles of 1 ms without an update, and not before."""
    commands = np.concatenate([[1.0], np.full(10, np.nan)])
    trace = run_guard(GUARD, 1e-3, commands)
    np.testing.assert_array_equal(trace.force, [1.0] * 5 + [0.0] * 6)


def test_a_computer_that_comes_back_late_gets_no_force_until_the_driver_is_armed():
    commands = np.concatenate([[1.0], np.full(10, np.nan), np.ones(5)])
    assert not run_guard(GUARD, 1e-3, commands).force[5:].any()
    state = armed()
    for command in (1.0, *([None] * 10)):
        state, force = guarded(GUARD, state, 1e-3, command)
    assert (state.late, force) == (True, 0.0)
    assert guarded(GUARD, armed(state), 1e-3, 2.0)[1] == 2.0


def test_arming_does_not_cool_the_motor():
    state = armed()
    for _ in range(5):
        state, _ = guarded(GUARD, state, 1e-3, 6.0)
    assert armed(state).rise == state.rise > 0


@pytest.mark.parametrize(
    ("limits", "words"),
    [((250.0, 50.0, 60.0), "give a cooler rise to come back at"), ((0.0, 60.0, 50.0), "slowest update rate is 0")],
)
def test_limits_that_cannot_be_are_refused(limits, words):
    with pytest.raises(ParameterError, match=words):
        Guard(MOTOR, 0.5, *limits)


def test_a_command_that_is_no_number_is_refused():
    with pytest.raises(ParameterError, match="command is inf"):
        guarded(GUARD, armed(), 1e-3, math.inf)
