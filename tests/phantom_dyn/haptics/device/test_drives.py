"""Heat of drives: the figures of Cavusoglu, Feygin and Tendick (2002), closed forms and a quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.drives import (
    PUBLISHED_RISE_LINEAR,
    PUBLISHED_RISE_PULSES,
    Winding,
    duty_of_heat_ratio,
    switched_current,
    warming,
)


def test_published_rises_imply_a_duty_cycle_of_42_percent():
    ratio = PUBLISHED_RISE_PULSES / PUBLISHED_RISE_LINEAR
    assert ratio == pytest.approx(2.379, abs=5e-4)
    assert duty_of_heat_ratio(ratio) == pytest.approx(0.42, abs=5e-3)


def test_without_inductance_the_switched_current_has_the_papers_ratio():
    assert switched_current(Winding(2.0), voltage=24, duty=0.25, frequency=20e3).ratio == pytest.approx(4.0, rel=1e-12)


def test_full_duty_is_a_linear_drive():
    result = switched_current(Winding(2.0, 1e-4), voltage=24, duty=1.0, frequency=20e3)
    assert result.ratio == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(("inductance", "ratio"), [(1e-9, 4.0), (1.0, 1.0)])
def test_the_winding_decides_between_the_papers_ratio_and_one(inductance, ratio):
    result = switched_current(Winding(2.0, inductance), voltage=24, duty=0.25, frequency=20e3)
    assert result.ratio == pytest.approx(ratio, rel=1e-3)


def test_switched_current_repeats_and_its_mean_and_heat_are_those_of_its_trace():
    winding = Winding(2.0, 1e-4)
    result = switched_current(winding, voltage=24, duty=0.3, frequency=10e3)
    assert result.current[0] == pytest.approx(result.current[-1], rel=1e-12)
    assert trapezoid(result.current, result.t) * 10e3 == pytest.approx(result.mean, rel=1e-5)
    assert trapezoid(result.current**2, result.t) * 10e3 * 2.0 == pytest.approx(result.heat, rel=1e-5)


def test_switched_current_solves_the_equation_of_the_winding():
    result = switched_current(Winding(2.0, 1e-4), voltage=24, duty=0.3, frequency=10e3)
    on = solve_ivp(lambda t, i: (24 - 2.0 * i) / 1e-4, (0, 3e-5), result.current[:1], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(on.y[0, -1], result.current.max(), rtol=1e-6)


def test_warming_ends_at_heat_times_resistance():
    result = warming(heat_pulses=4.0, heat_linear=1.0, resistance=10.0, time_constant=100.0, t=np.array([0.0, 1e4]))
    np.testing.assert_allclose([result.pulses, result.linear], [[0, 40], [0, 10]], rtol=1e-12)


def test_less_heat_than_a_linear_drive_is_refused():
    with pytest.raises(ParameterError, match="belongs to no duty cycle"):
        duty_of_heat_ratio(0.9)


def test_a_winding_without_resistance_is_refused():
    with pytest.raises(ParameterError, match="give ohms above 0"):
        Winding(0.0)


def test_a_negative_inductance_is_refused():
    with pytest.raises(ParameterError, match="give henry of 0 or more"):
        Winding(1.0, -1.0)


def test_pulses_of_no_voltage_are_refused():
    with pytest.raises(ParameterError, match="voltage of the pulses is 0"):
        switched_current(Winding(1.0), voltage=0.0, duty=0.5, frequency=1e4)


def test_a_thermal_time_constant_of_nothing_is_refused():
    with pytest.raises(ParameterError, match=r"thermal time constant is 0\.0: give a number above 0"):
        warming(heat_pulses=1.0, heat_linear=1.0, resistance=1.0, time_constant=0.0, t=np.zeros(1))
