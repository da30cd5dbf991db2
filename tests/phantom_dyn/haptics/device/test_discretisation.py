"""Hold and delay: against scipy's exponential, python-control, and a continuous simulation."""

from __future__ import annotations

import itertools

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.device.discretisation import discretise, split_delay
from phantom_dyn.haptics.device.frequency_kernels import frequency_grid
from phantom_dyn.haptics.device.published import LHIFAM, LHIFAM_NEW_CABLE, PHANTOM_1_5_Z

T = 1e-3


def test_transition_is_the_matrix_exponential():
    # Oracle: scipy.linalg.expm.
    np.testing.assert_allclose(discretise(LHIFAM, period=T).transition, expm(LHIFAM.state_space.A * T), atol=1e-14)


def test_hold_without_delay_is_that_of_python_control():
    s = LHIFAM.state_space
    there = control.c2d(control.ss(s.A, s.B[:, None], s.C[None], 0), T)
    w = np.array([1.0, 20.0, 125.0, 515.0, 3000.0])
    answers = [complex(there(np.exp(1j * f * T))) for f in w]
    np.testing.assert_allclose(discretise(LHIFAM, period=T).response(w), answers, rtol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.25e-3, 1e-3, 2.7e-3])
def test_samples_are_those_of_the_continuous_device(delay):
    # Oracle: integration of the differential equation with the delayed, held force.
    forces = np.array([1.0, -2.0, 0.5, 3.0, 0.0, -1.0, 0.0, 0.0])
    system, sampled = LHIFAM.state_space, discretise(LHIFAM, period=T, delay=delay)
    given = lambda k: forces[k] if 0 <= k < len(forces) else 0.0  # noqa: E731
    x = np.zeros(4)
    for k in range(len(forces)):
        x = (
            sampled.transition @ x
            + sampled.newer * given(k - sampled.steps)
            + sampled.older * given(k - sampled.steps - 1)
        )
    y = np.zeros(4)
    edges = np.unique(np.concatenate([np.arange(len(forces)) * T + delay, [0.0, len(forces) * T]]))
    edges = edges[edges <= len(forces) * T + 1e-12]
    for start, stop in itertools.pairwise(edges):
        held = given(int(np.floor((0.5 * (start + stop) - delay) / T)))
        y = solve_ivp(
            lambda _, z, held=held: system.A @ z + system.B * held,
            (start, stop),
            y,
            method="DOP853",
            rtol=1e-12,
            atol=1e-16,
        ).y[:, -1]
    np.testing.assert_allclose(x, y, rtol=1e-8, atol=1e-14)


def test_a_whole_period_of_delay_turns_the_phase_by_one_z():
    w = np.array([5.0, 300.0, 2000.0])
    late, prompt = discretise(LHIFAM, period=T, delay=3 * T), discretise(LHIFAM, period=T)
    np.testing.assert_allclose(late.response(w), prompt.response(w) * np.exp(-3j * w * T), rtol=1e-12)


def test_a_fraction_of_a_period_is_continuous_at_both_ends():
    w = np.array([5.0, 300.0, 2000.0])
    for whole in (0.0, T):
        near = discretise(LHIFAM, period=T, delay=whole + 1e-8 * T).response(w)
        np.testing.assert_allclose(near, discretise(LHIFAM, period=T, delay=whole).response(w), rtol=1e-7)


def test_response_at_low_frequency_is_that_of_device_half_a_period_and_delay():
    w, delay = np.array([0.5, 2.0]), 2.3e-3
    expected = LHIFAM.transfer_function.response(w) * np.exp(-1j * w * (0.5 * T + delay))
    np.testing.assert_allclose(discretise(LHIFAM, period=T, delay=delay).response(w), expected, rtol=1e-5)


@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 1e-3, 2.6e-3])
@pytest.mark.parametrize("axis", [LHIFAM_NEW_CABLE, PHANTOM_1_5_Z], ids=["lhifam", "phantom z"])
def test_eigenvalues_of_the_wall_are_zeros_of_its_characteristic_equation(axis, delay):
    # (20), with virtual damping: 1 + (K + B (1 - 1/z)/T) L(z) = 0, L by its polynomials.
    K, B = (3000.0, 2.0) if axis is LHIFAM_NEW_CABLE else (0.1, 1e-4)
    sampled = discretise(axis, period=T, delay=delay)
    steps, direct_now, direct_before, denominator, now, before = sampled.loop
    values = np.linalg.eigvals(sampled.closed_loop(K, B))
    z = values[(np.abs(values) > 0.3)]
    low = np.polyval(denominator, z - 1)
    high = np.polyval(now, z - 1) + np.polyval(before, z - 1) / z + (direct_now + direct_before / z) * low
    error = low + (K + B * (1 - 1 / z) / T) * high * z**-steps
    scale = np.array([np.polyval(np.abs(denominator), abs(root - 1)) for root in z])
    assert len(z) >= 4
    assert np.max(np.abs(error) / scale) < 1e-8


def test_frequency_grid_increases_to_the_nyquist_frequency():
    grid = frequency_grid(0.1, T, 5e-3, np.array([[100.0, 1.0]]))
    assert np.all(np.diff(grid) >= 0)
    assert grid[-1] == pytest.approx(np.pi / T)
    assert np.sum((grid > 99) & (grid < 101)) > 10


@pytest.mark.parametrize(("delay", "expected"), [(0.0, (0, 0.0)), (3e-3, (3, 0.0)), (2.5e-3, (2, 0.5e-3))])
def test_delay_splits_into_whole_periods_and_a_rest(delay, expected):
    assert split_delay(T, delay) == (expected[0], pytest.approx(expected[1], abs=1e-15))


@pytest.mark.parametrize(("period", "delay"), [(0.0, 0.0), (1e-3, -1e-3), (np.nan, 0.0)])
def test_impossible_times_are_refused(period, delay):
    with pytest.raises(ParameterError, match="give a positive period and a delay of 0 or more"):
        discretise(RigidAxis(1.0, 1.0), period=period, delay=delay)
