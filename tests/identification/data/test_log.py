from __future__ import annotations

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.data.signals import low_pass
from phantom_dyn.motion import Motion

RATE = 200.0


def log_of(count: int, band: Band, invalid: tuple[int, ...] = ()) -> Log:
    zeros = np.zeros((count, 1))
    valid = np.ones(count, dtype=bool)
    valid[list(invalid)] = False
    return Log("made up", ("axis",), Motion(np.arange(count) / RATE, zeros, zeros, zeros), zeros, band, valid)


def test_the_kernel_is_symmetric():
    kernel = low_pass(10.0, RATE).kernel
    assert len(kernel) % 2 == 1
    np.testing.assert_allclose(kernel, kernel[::-1], atol=1e-18)


@pytest.mark.parametrize("cutoff", [3.0, 10.0, 37.0, 90.0])
@pytest.mark.parametrize("count", [400, 401, 403])
def test_a_ramp_comes_out_as_it_was_at_the_samples_that_are_named(cutoff, count):
    # Closed form: a symmetric kernel of sum one leaves a straight line, so there is no delay and no wrong index.
    log = log_of(count, low_pass(cutoff, RATE))
    ramp = 3.0 + 0.25 * np.arange(count)
    np.testing.assert_allclose(log.band(ramp), ramp[log.samples], rtol=1e-12)


@pytest.mark.parametrize("cutoff", [3.0, 10.0, 37.0])
def test_the_output_is_the_convolution_where_the_kernel_fits(rng, cutoff):
    # numpy.convolve, then every step-th sample.
    band = low_pass(cutoff, RATE)
    x = rng.normal(size=501)
    np.testing.assert_allclose(band(x), np.convolve(x, band.kernel, mode="valid")[:: band.step], atol=1e-12)


def test_every_axis_after_time_is_filtered_alike(rng):
    band = low_pass(10.0, RATE)
    x = rng.normal(size=(400, 2, 3))
    assert band(x).shape == (len(band.samples(400)), 2, 3)
    np.testing.assert_allclose(band(x)[:, 1, 2], band(x[:, 1, 2]), atol=1e-15)


def test_a_linear_relation_survives(rng):
    # The same filter on both sides: torque = columns @ theta before and after.
    band = low_pass(10.0, RATE)
    columns, theta = rng.normal(size=(600, 4)), rng.normal(size=4)
    np.testing.assert_allclose(band(columns @ theta), band(columns) @ theta, atol=1e-13)


def test_an_impulse_comes_out_at_its_own_sample():
    log = log_of(400, low_pass(10.0, RATE))
    at = int(log.samples[len(log.samples) // 2])
    impulse = np.zeros(400)
    impulse[at] = 1.0
    assert log.samples[np.argmax(log.band(impulse))] == at


def test_a_band_that_lets_everything_through_changes_nothing(rng):
    band = low_pass(90.0, RATE)
    x = rng.normal(size=(50, 2))
    np.testing.assert_array_equal(band(x), x)


@pytest.mark.parametrize(("hz", "gain"), [(4.0, 1.0), (10.0, 0.5), (25.0, 0.0)])
def test_the_edge_halves_and_what_is_above_is_gone(hz, gain):
    band = low_pass(10.0, RATE)
    response = band.kernel @ np.exp(-2j * np.pi * hz / RATE * np.arange(len(band.kernel)))
    assert abs(response) == pytest.approx(gain, abs=0.01)


@pytest.mark.parametrize("cutoff", [3.0, 7.0, 20.0])
def test_the_samples_in_the_band_keep_two_and_a_half_per_period(cutoff):
    band = low_pass(cutoff, RATE)
    assert RATE / band.step >= 2.5 * cutoff
    assert RATE / (band.step + 1) < 2.5 * cutoff


def test_samples_whose_kernel_touches_an_invalid_one_are_invalid_and_no_others():
    # Brute force over every kernel.
    log = log_of(900, low_pass(10.0, RATE), invalid=(150, 151, 152, 600))
    half = log.band.half
    expected = [bool(log.valid[k - half : k + half + 1].all()) for k in log.samples]
    np.testing.assert_array_equal(log.valid_in_band, expected)
    assert not all(expected)


def test_the_arrays_of_a_log_cannot_be_written_to():
    log = log_of(40, low_pass(10.0, RATE))
    with pytest.raises(ValueError, match="read-only"):
        log.valid[0] = False
