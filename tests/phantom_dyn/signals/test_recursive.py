"""Filters against scipy.signal, whose import a command does without."""

import numpy as np
import pytest
from scipy import signal

from phantom_dyn.signals.recursive import lagging, low_pass_kernel, low_passed, recursive_filter

RATE = 1000.0


@pytest.fixture
def walks():
    return np.cumsum(np.random.default_rng(3).normal(size=(2500, 3)), axis=0)


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("cutoff", [0.5, 5.0, 50.0, 390.0])
def test_a_low_pass_without_delay_is_that_of_scipy(walks, order, cutoff):
    padding = min(len(walks) - 1, int(3 * RATE / cutoff))
    sections = signal.butter(order, cutoff, fs=RATE, output="sos")
    wanted = signal.sosfiltfilt(sections, walks, axis=0, padlen=padding)
    found = low_passed(walks, cutoff, RATE, order=order, padding=int(3 * RATE / cutoff))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-8 * np.abs(walks).max())


def test_one_series_is_filtered_as_a_column_is(walks):
    alone = low_passed(walks[:, 1], 20.0, RATE, order=4)
    np.testing.assert_array_equal(alone, low_passed(walks, 20.0, RATE, order=4)[:, 1])


def test_the_usual_padding_is_that_of_scipy(walks):
    wanted = signal.sosfiltfilt(signal.butter(4, 20.0, fs=RATE, output="sos"), walks[:, 0])
    np.testing.assert_allclose(low_passed(walks[:, 0], 20.0, RATE, order=4), wanted, atol=1e-8)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_fewer_samples_than_coefficients_can_be_filtered(samples):
    b, a = (0.2, 0.3, 0.1), (1.0, -0.7, 0.3)
    x = np.array([[2.0], [5.0], [-1.0]])[:samples]
    steady = signal.lfilter_zi(b, a)[:, None] * x[0]
    wanted = signal.lfilter(b, a, x, axis=0, zi=steady)[0]
    np.testing.assert_allclose(recursive_filter(b, a, x), wanted, atol=1e-12)


def test_a_lag_answers_a_step_as_its_closed_form_does():
    t = np.arange(200) * 0.01
    step = np.where(t >= 0.5, 1.0, 0.0)
    wanted = np.where(t >= 0.5, 1.0 - np.exp(-(t - 0.5 + 0.01) / 0.3), 0.0)
    np.testing.assert_allclose(lagging(step, 0.01, 0.3), wanted, atol=1e-12)


def test_a_lag_is_at_rest_at_the_start():
    np.testing.assert_allclose(lagging(np.full(50, 7.0), 0.01, 0.3), 7.0, rtol=1e-12)


def test_the_kernel_is_that_of_scipy():
    wanted = signal.firwin(161, 25.0, fs=RATE)
    np.testing.assert_allclose(low_pass_kernel(80, 25.0, RATE), wanted, atol=1e-15)
