"""One fit with priors and bounds. Oracle: SciPy's bounded least squares on the samples, the priors as further rows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from identification.engine.fits.minimum import minimum_of

SAMPLES, COLUMNS, FOLDS = 120, 6, 4


@pytest.fixture
def samples(rng):
    x = rng.normal(size=(SAMPLES, COLUMNS))
    return x, x @ rng.normal(size=COLUMNS) + rng.normal(size=SAMPLES), np.arange(SAMPLES) % FOLDS


PRECISION = np.array([0.0, 0.0, 5.0, 20.0, 1.0, 0.0])
BOUNDS = np.full(COLUMNS, -0.4), np.full(COLUMNS, 0.5)


def by_scipy(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    rows = np.vstack([x, np.diag(np.sqrt(PRECISION))])
    return lsq_linear(rows, np.concatenate([y, np.zeros(COLUMNS)]), BOUNDS, tol=1e-14).x


def found(samples, folds=None):
    x, y, _ = samples
    return minimum_of(x.T @ x, x.T @ y, float(y @ y), PRECISION, BOUNDS, np.full(COLUMNS, np.nan), folds)


def test_coefficients_are_the_least_squares_within_bounds_with_priors(samples):
    x, y, _ = samples
    expected = by_scipy(x, y)
    assert np.any((expected < BOUNDS[0] + 1e-9) | (expected > BOUNDS[1] - 1e-9))
    np.testing.assert_allclose(found(samples).x, expected, atol=1e-6)


def test_the_objective_is_the_squares_that_are_left_and_the_priors(samples):
    x, y, _ = samples
    fit = found(samples)
    assert fit.objective == pytest.approx(np.sum((y - x @ fit.x) ** 2) + np.sum(PRECISION * fit.x**2))


def test_fits_without_a_fold_have_not_seen_it(samples):
    x, y, fold = samples
    parts = [(x[fold == k], y[fold == k]) for k in range(FOLDS)]
    folds = np.array([a.T @ a for a, _ in parts]), np.array([a.T @ b for a, b in parts])
    expected = [by_scipy(x[fold != k], y[fold != k]) for k in range(FOLDS)]
    np.testing.assert_allclose(found(samples, folds).without, expected, atol=1e-6)


def test_nothing_is_held_out_without_folds(samples):
    assert found(samples).without.shape == (0, COLUMNS)
