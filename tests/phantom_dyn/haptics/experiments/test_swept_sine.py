"""Swept-sine experiments: the sampled model without noise, known truth with it, closed forms of the sweep."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.published import LHIFAM
from phantom_dyn.haptics.experiments.frequency_identification import NAMES, fit_two_mass
from phantom_dyn.haptics.experiments.swept_sine import Sweep, response_of_periods, simulate_swept_sine
from phantom_dyn.haptics.experiments.white_noise import simulate_white_noise

T = 1e-3
SWEEP = Sweep(2 * math.pi * 2, 2 * math.pi * 300, 10.0)


def experiment(axis, rng, *, noise, sweep=SWEEP, delay=0.0):
    return simulate_swept_sine(axis, sweep, period=T, delay=delay, force=15.0, position_noise=noise, rng=rng)


@pytest.mark.parametrize("delay", [0.0, 1.3e-3])
def test_without_noise_the_response_is_that_of_the_sampled_device(rng, delay):
    found = experiment(LHIFAM, rng, noise=0.0, delay=delay).frequency_response()
    model = discretise(LHIFAM, period=T, delay=delay).response(found.frequency)
    np.testing.assert_allclose(found.response, model, rtol=2e-5)
    assert found.coherence.min() > 1 - 1e-6


def test_a_rigid_device_that_drifts_off_has_its_mass_in_the_response(rng):
    """Closed form: a mass of 2 kg behind a hold, 1/(2 m) T^2 (z + 1) / (z - 1)^2."""
    found = experiment(RigidAxis(2.0, 0.0), rng, noise=0.0).frequency_response()
    z = np.exp(1j * found.frequency * T)
    np.testing.assert_allclose(found.response, T**2 / 4 * (z + 1) / (z - 1) ** 2, rtol=1e-6)


def test_scatter_about_the_model_is_the_deviation_that_is_stated(rng):
    found = experiment(LHIFAM, rng, noise=1e-5, sweep=Sweep(SWEEP.lowest, SWEEP.highest, 10.0, 12)).frequency_response()
    apart = found.response / discretise(LHIFAM, period=T).response(found.frequency) - 1
    # The median of a square of a standard normal number is 0.455.
    assert np.median((apart.real / found.deviation) ** 2) == pytest.approx(0.455, rel=0.12)


def test_the_six_parameters_are_recovered(rng):
    found = fit_two_mass(experiment(LHIFAM, rng, noise=2e-5).frequency_response())
    truth = np.array([getattr(LHIFAM, name) for name in NAMES])
    assert np.all(np.abs(found.values - truth) < 4 * found.deviations)
    assert found.axis.cable_stiffness == pytest.approx(LHIFAM.cable_stiffness, rel=0.005)
    assert 0.8 < found.misfit < 1.3


def test_as_long_as_white_noise_of_a_third_the_force_it_finds_the_stiffness_better(rng):
    """The same greatest force, three deviations of the noise, for the same 50 s."""
    swept = fit_two_mass(experiment(LHIFAM, rng, noise=2e-5).frequency_response())
    white = simulate_white_noise(LHIFAM, period=T, force=5.0, position_noise=2e-5, duration=50.0, rng=rng)
    noisy = fit_two_mass(white.frequency_response(segment=4.0).between(SWEEP.lowest, SWEEP.highest))
    assert swept.deviations[4] < 0.7 * noisy.deviations[4]


def test_the_sweep_rises_from_its_lowest_to_its_highest_frequency():
    """Closed form: zero crossings of the first and of the last swing, f1 (f2/f1)^(t/P)."""
    sweep = Sweep(20.0, 200.0, 10.0)
    force = sweep.force(3.0, 1e-4)
    crossings = 1e-4 * np.flatnonzero(np.diff(np.signbit(force)))
    assert np.abs(force).max() == pytest.approx(3.0, rel=1e-3)
    for k in (2, -2):
        middle, apart = 0.5 * (crossings[k] + crossings[k - 1]), crossings[k] - crossings[k - 1]
        assert math.pi / apart == pytest.approx(20.0 * 10 ** (middle / 10.0), rel=2e-2)


def test_noise_lowers_the_coherence_where_the_device_moves_least(rng):
    found = experiment(LHIFAM, rng, noise=2e-4).frequency_response()
    slow, fast = found.between(0, 2 * math.pi * 5), found.between(2 * math.pi * 200, 2 * math.pi * 300)
    assert np.median(slow.coherence) > 0.99 > 0.6 > np.median(fast.coherence)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((10.0, 5.0, 10.0), "give a higher frequency at its end"),
        ((10.0, 50.0, 1.0), "at least four swings of that frequency, 2.51 s"),
        ((10.0, 50.0, 10.0, 1), "whole number of 2 or more"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused(arguments, words):
    with pytest.raises(ParameterError, match=words):
        Sweep(*arguments)


def test_a_sweep_past_half_the_sampling_is_refused():
    with pytest.raises(ParameterError, match=r"ends below 3141\.6 rad/s"):
        Sweep(10.0, 4000.0, 10.0).force(1.0, T)


def test_periods_of_unequal_length_are_refused():
    with pytest.raises(ParameterError, match="give 5 periods of equal length"):
        response_of_periods(np.ones(101), np.ones(101), period=T, periods=4)


def test_a_motor_that_stands_still_is_refused():
    with pytest.raises(ParameterError, match="force never changes"):
        response_of_periods(np.zeros(100), np.arange(100.0) ** 2, period=T, periods=4)
