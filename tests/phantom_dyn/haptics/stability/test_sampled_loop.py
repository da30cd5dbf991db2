"""Loops of a sampled device and a digital filter: closed forms, eigenvalues, and python-control."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.signal import butter, dlsim

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import Operator, RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.stability.sampled_loop import DigitalFilter, SampledLoop, critical_gain

PERIOD = 1e-3
LHIFAM = RigidAxis(5.4, 3.5)
TWO_MASS = TwoMassAxis(0.318, 5.082, 0.1, 3.4, 38e3, 11.0)
AVERAGE = DigitalFilter(np.concatenate([[1.0], np.zeros(9), [-1.0]]) / (10 * PERIOD), np.ones(1))


def test_wall_of_a_rigid_device_is_as_stiff_as_the_exact_eigenvalues_say():
    """7000.8 N/m for 5.4 kg and 3.5 N s/m, beside 7000 of the linear condition."""
    result = critical_gain(SampledLoop((discretise(LHIFAM, period=PERIOD),)))
    assert result.gain == pytest.approx(7000.8, abs=0.5)


@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 1e-3, 2.7e-3])
@pytest.mark.parametrize("scaled", [DigitalFilter(np.ones(1), np.ones(1)), DigitalFilter(*butter(2, 0.2)), AVERAGE])
def test_spectral_radius_passes_one_at_the_critical_gain(delay, scaled):
    axis = TWO_MASS.held_by(Operator(0.1, 1.0, 100.0))
    fixed = DigitalFilter(np.array([1.0, -1.0]) / PERIOD, np.ones(1))
    loop = SampledLoop((discretise(axis, period=PERIOD, delay=delay),), scaled, fixed)
    gain = critical_gain(loop).gain
    assert loop.spectral_radius(0.999 * gain) < 1 < loop.spectral_radius(1.001 * gain)


def test_lowest_margin_is_that_of_python_control():
    plant = discretise(LHIFAM, period=PERIOD)
    b, a = butter(2, 0.2)
    system = control.StateSpace(plant.transition, plant.newer[:, None], plant.output[None, :], 0, PERIOD)
    margins = control.stability_margins(system * control.TransferFunction(b, a, PERIOD), returnall=True, method="frd")
    assert critical_gain(SampledLoop((plant,), DigitalFilter(b, a))).gain == pytest.approx(min(margins[0]), rel=1e-5)


def test_closed_loop_steps_as_device_and_filter_do(rng):
    """One step of the matrix against the two recursions written out, under a delay of 1.3 periods."""
    plant = discretise(LHIFAM, period=PERIOD, delay=1.3e-3)
    b, a = butter(2, 0.2)
    loop = SampledLoop((plant,), DigitalFilter(b, a))
    x = rng.normal(size=2)
    forces = rng.normal(size=2)
    filtered_state = rng.normal(size=2)
    step = loop.closed_loop(100.0) @ np.concatenate([x, forces, filtered_state])
    A, B, C, D = loop.scaled.matrices()
    y = plant.output @ x
    u = -100.0 * (C @ filtered_state + D * y)
    expected = plant.transition @ x + plant.newer * forces[0] + plant.older * forces[1]
    np.testing.assert_allclose(step, [*expected, u, forces[0], *(A @ filtered_state + B * y)], rtol=1e-12)


def test_response_of_a_filter_is_that_of_its_matrices():
    filter_ = DigitalFilter(*butter(3, 0.1))
    A, B, C, D = filter_.matrices()
    _, impulse, _ = dlsim((A, B[:, None], C[None, :], D, PERIOD), np.eye(1, 4000)[0])
    w = np.array([10.0, 300.0])
    direct = (impulse[:, 0] * np.exp(-1j * w[:, None] * PERIOD * np.arange(4000))).sum(axis=1)
    np.testing.assert_allclose(filter_.response(w, PERIOD), direct, rtol=1e-9)


def test_two_equal_devices_in_parallel_have_half_the_critical_gain():
    plant = discretise(LHIFAM.held_by(Operator(0, 0, 50.0)), period=PERIOD)
    both = critical_gain(SampledLoop((plant, plant)))
    assert both.gain == pytest.approx(critical_gain(SampledLoop((plant,))).gain / 2, rel=1e-9)


def test_an_undamped_device_bears_no_wall():
    assert critical_gain(SampledLoop((discretise(RigidAxis(1.0, 0.0), period=PERIOD),))).gain == 0.0


def test_open_loop_is_minus_one_at_the_critical_gain():
    loop = SampledLoop((discretise(LHIFAM, period=PERIOD, delay=2e-3),))
    result = critical_gain(loop)
    assert result.gain * loop.open_loop(np.array([result.frequency]))[0] == pytest.approx(-1.0, abs=1e-9)


def test_devices_of_different_periods_are_refused():
    with pytest.raises(ParameterError, match="give all the same period and delay"):
        SampledLoop((discretise(LHIFAM, period=1e-3), discretise(LHIFAM, period=2e-3)))


def test_a_filter_that_starts_with_zero_below_is_refused():
    with pytest.raises(ParameterError, match="starts with 0"):
        DigitalFilter(np.ones(1), np.array([0.0, 1.0]))


def test_a_filter_with_a_gap_is_refused():
    with pytest.raises(ParameterError, match="give finite coefficients"):
        DigitalFilter(np.array([np.nan]), np.ones(1))


def test_a_lowest_frequency_of_nothing_is_refused():
    with pytest.raises(ParameterError, match="lowest frequency is 0"):
        critical_gain(SampledLoop((discretise(LHIFAM, period=PERIOD),)), lowest=0.0)
