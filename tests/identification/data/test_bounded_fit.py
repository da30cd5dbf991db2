"""Least squares within bounds, against scipy.optimize, whose import a command does without."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear, nnls

from identification.data.bounded_fit import bounded_fit


@pytest.mark.parametrize("reach", [0.05, 0.5, 5.0])
@pytest.mark.parametrize("size", [1, 3, 12, 40])
def test_a_fit_is_that_of_scipy(rng, size, reach):
    for _ in range(5):
        columns, target = rng.normal(size=(size + 5, size)), rng.normal(size=size + 5)
        low = np.where(rng.random(size) < 0.3, -np.inf, -reach * rng.random(size))
        high = np.where(rng.random(size) < 0.3, np.inf, reach * rng.random(size))
        wanted = lsq_linear(columns, target, (low, high), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(bounded_fit(columns, target, low, high), wanted, atol=1e-7)


def test_coefficients_that_are_not_negative_are_those_of_scipy(rng):
    columns, target = rng.normal(size=(200, 6)), rng.normal(size=200)
    found = bounded_fit(columns, target, np.zeros(6), np.full(6, np.inf))
    np.testing.assert_allclose(found, nnls(columns, target)[0], atol=1e-9)


def test_columns_that_are_nearly_the_same_are_shared_within_bounds(rng):
    # Oracle: scipy. A pull towards nothing decides between them.
    one = rng.normal(size=30)
    columns = np.vstack([np.column_stack([one, one + 1e-7 * rng.normal(size=30)]), 1e-3 * np.eye(2)])
    target, low, high = np.concatenate([3.0 * one, np.zeros(2)]), np.zeros(2), np.array([1.0, np.inf])
    wanted = lsq_linear(columns, target, (low, high), method="bvls", tol=1e-14).x
    np.testing.assert_allclose(bounded_fit(columns, target, low, high), wanted, rtol=1e-5)
