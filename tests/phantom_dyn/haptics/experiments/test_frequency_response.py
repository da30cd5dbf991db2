"""Empirical transfer functions: against the exact response of the sampled device, and known noise."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.published import LHIFAM
from phantom_dyn.haptics.experiments.frequency_response import estimate_frequency_response
from phantom_dyn.haptics.experiments.white_noise import simulate_white_noise

T = 1e-3


def measured(rng, noise=2e-6, duration=60.0, delay=0.0):
    experiment = simulate_white_noise(
        LHIFAM, period=T, delay=delay, force=5.0, position_noise=noise, duration=duration, rng=rng
    )
    return experiment.frequency_response(segment=4.0)


@pytest.mark.parametrize("delay", [0.0, 0.4e-3])
def test_it_is_the_exact_response_within_its_deviations(rng, delay):
    # Oracle: the sampled device, hold and delay included.
    found = measured(rng, delay=delay).between(5.0, 1500.0)
    error = np.abs(found.response / discretise(LHIFAM, period=T, delay=delay).response(found.frequency) - 1)
    # Real and imaginary part have the deviation each: the squares sum up to two.
    assert np.mean((error / found.deviation) ** 2) == pytest.approx(2.0, rel=0.2)


def test_95_per_cent_of_the_magnitudes_are_in_their_intervals(rng):
    found = measured(rng).between(5.0, 1500.0)
    exact = 20 * np.log10(np.abs(discretise(LHIFAM, period=T).response(found.frequency)))
    low, high = found.interval
    assert np.mean((low <= exact) & (exact <= high)) == pytest.approx(0.95, abs=0.03)


def test_coherence_falls_with_noise_where_the_device_answers_least(rng):
    quiet, loud = measured(rng, noise=1e-7), measured(rng, noise=1e-5)
    high = (quiet.frequency > 2000) & (quiet.frequency < 2500)
    assert quiet.coherence[high].mean() > 0.99
    assert loud.coherence[high].mean() < 0.3


def test_longer_recordings_scatter_less(rng):
    short, long = measured(rng, duration=30.0), measured(rng, duration=120.0)
    assert long.averages == pytest.approx(4 * short.averages, rel=0.15)
    assert np.median(long.deviation) == pytest.approx(0.5 * np.median(short.deviation), rel=0.15)


@pytest.mark.parametrize("scale", [1e-300, 1e-200, 1e200])
def test_the_size_of_numbers_makes_no_difference(rng, scale):
    # Closed form: the response of a linear device and its coherence do not depend on how strongly it was driven.
    force, position = rng.standard_normal((2, 1000))
    at_one = estimate_frequency_response(force, position, period=T, segment=0.1)
    at_scale = estimate_frequency_response(scale * force, scale * position, period=T, segment=0.1)
    np.testing.assert_allclose(at_scale.response, at_one.response, rtol=1e-9)
    np.testing.assert_allclose(at_scale.coherence, at_one.coherence, rtol=1e-9)


def test_a_constant_force_is_refused():
    with pytest.raises(ParameterError, match="The force never changes"):
        estimate_frequency_response(np.ones(1000), np.zeros(1000), period=T, segment=0.1)


def test_too_short_a_recording_is_refused():
    with pytest.raises(ParameterError, match="100 forces and 100 positions were given for segments of 80 samples"):
        estimate_frequency_response(np.ones(100), np.zeros(100), period=T, segment=0.08)
