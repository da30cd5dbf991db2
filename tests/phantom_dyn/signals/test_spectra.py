"""Densities against scipy.signal, whose import a command does without, and against the power of a sine."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

from phantom_dyn.signals.spectra import cross_density, power_density

RATE = 250.0


@pytest.fixture
def noise():
    return np.random.default_rng(5).normal(size=(3000, 2)) + 4.0 + 0.01 * np.arange(3000)[:, None]


@pytest.mark.parametrize("length", [8, 333, 1024, 3000])
@pytest.mark.parametrize("window", ["hann", "blackman", "blackmanharris"])
@pytest.mark.parametrize("linear", [False, True])
def test_the_density_is_that_of_scipy(noise, length, window, linear):
    detrend = "linear" if linear else "constant"
    wanted = signal.welch(noise, RATE, window=window, nperseg=length, detrend=detrend, axis=0)
    found = power_density(noise, RATE, length, window=window, linear=linear)
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-14)
    np.testing.assert_allclose(found[1], wanted[1], rtol=1e-9, atol=1e-12 * wanted[1].max())


def test_one_series_has_the_density_of_a_column(noise):
    np.testing.assert_array_equal(power_density(noise[:, 1], RATE, 256)[1], power_density(noise, RATE, 256)[1][:, 1])


def test_the_cross_density_is_that_of_scipy(noise):
    wanted = signal.csd(noise[:, 0], noise[:, 1], RATE, nperseg=333)
    found = cross_density(noise[:, 0], noise[:, 1], RATE, 333)
    np.testing.assert_allclose(found[1], wanted[1], rtol=0, atol=1e-12 * np.abs(wanted[1]).max())


def test_a_long_series_in_pieces_has_the_same_density():
    long = np.random.default_rng(1).normal(size=600_000)
    wanted = signal.welch(long, RATE, nperseg=512)[1]
    np.testing.assert_allclose(power_density(long, RATE, 512)[1], wanted, rtol=1e-9)


def test_the_command_does_without_scipy_signal():
    # Half of what the imports of a diagnosis took was scipy.signal and, in it, scipy.stats.
    line = (
        "import identification.pipeline, sys; print([m for m in sys.modules if m in ('scipy.signal', 'scipy.stats')])"
    )
    done = subprocess.run([sys.executable, "-c", line], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
