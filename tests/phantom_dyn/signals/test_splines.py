"""Splines through samples at a uniform rate, against scipy.interpolate, whose import a command does without."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_interp_spline

from phantom_dyn.signals.splines import Cubic, quintic_derivatives

RATE = 200.0


@pytest.mark.parametrize("count", [6, 18, 19, 20, 25, 400])
def test_derivatives_are_those_of_the_quintic_spline_of_scipy(rng, count):
    x, t = np.cumsum(rng.normal(size=(count, 3)), axis=0), np.arange(count) / RATE
    spline = make_interp_spline(t, x, k=5)
    for found, order in zip(quintic_derivatives(x, RATE), (1, 2), strict=True):
        wanted = spline(t, order)
        np.testing.assert_allclose(found, wanted, atol=1e-9 * np.abs(wanted).max())


def test_derivatives_of_a_polynomial_of_fifth_degree_are_exact():
    t = np.arange(60) / RATE
    law = np.polynomial.Polynomial([0.3, -1.0, 2.0, 5.0, -7.0, 11.0])
    slope, bend = quintic_derivatives(law(t)[:, None], RATE)
    np.testing.assert_allclose(slope[:, 0], law.deriv()(t), atol=1e-8)
    np.testing.assert_allclose(bend[:, 0], law.deriv(2)(t), atol=1e-5)


@pytest.mark.parametrize("count", [4, 5, 300])
def test_values_and_slopes_are_those_of_the_cubic_spline_of_scipy(rng, count):
    t = 2.5 + np.arange(count) / RATE
    x = np.cumsum(rng.normal(size=count))
    wanted, found = CubicSpline(t, x), Cubic.through(x, t[0], 1 / RATE)
    # Beyond both ends, too.
    at = rng.uniform(t[0] - 2 / RATE, t[-1] + 2 / RATE, size=(100, 3))
    np.testing.assert_allclose(found(at), wanted(at), atol=1e-9 * max(np.abs(wanted(at)).max(), 1.0))
    np.testing.assert_allclose(found.derivative(at), wanted(at, 1), atol=1e-8 * np.abs(wanted(at, 1)).max())
