from __future__ import annotations

import numpy as np
import pytest

from identification.experiments.linear_fit import fit_linear, without_nuisance
from phantom_dyn.errors import IdentifiabilityError, ParameterError

NAMES, UNITS = ("a", "b", "c"), ("N m", "N m", "N m")


def problem(rng, rows=400, noise=0.3):
    W, theta = rng.normal(size=(rows, 3)) * [1, 10, 0.1], np.array([1.0, -2.0, 3.0])
    return W, W @ theta + noise * rng.normal(size=rows), theta


def test_the_estimate_is_that_of_numpy(rng):
    W, y, _ = problem(rng)
    np.testing.assert_allclose(fit_linear(W, y, NAMES, UNITS).theta, np.linalg.lstsq(W, y, rcond=None)[0])


def test_the_covariance_is_equation_6(rng):
    W, y, _ = problem(rng)
    fit = fit_linear(W, y, NAMES, UNITS)
    np.testing.assert_allclose(fit.cov, fit.sigma**2 * np.linalg.inv(W.T @ W))


def test_the_noise_is_found_with_the_square_that_equation_5_lost(rng):
    # Known truth: 0.3 on 20000 rows. As printed, ||Y - WX|| / (r - b) would be 0.0021 for the variance.
    W, y, _ = problem(rng, rows=20000)
    fit = fit_linear(W, y, NAMES, UNITS)
    assert fit.sigma == pytest.approx(0.3, rel=0.02)
    printed = np.linalg.norm(y - W @ fit.theta) / (20000 - 3)
    assert printed < 0.05 * fit.sigma**2


def test_95_per_cent_intervals_hold_the_truth_in_95_per_cent_of_the_draws(rng):
    # Known truth; 1200 intervals, so that the share scatters by 0.6 %.
    inside = []
    for _ in range(400):
        W, y, theta = problem(rng, rows=40)
        fit = fit_linear(W, y, NAMES, UNITS)
        inside.append(np.abs(fit.theta - theta) < 2.026 * fit.std())  # Student's t, 37 degrees of freedom
    assert np.mean(inside) == pytest.approx(0.95, abs=0.025)


def test_rows_with_a_memory_count_for_less(rng):
    # Closed form: every row four times over.
    W, y, _ = problem(rng)
    again = fit_linear(np.repeat(W, 4, axis=0), np.repeat(y, 4), NAMES, UNITS, memory=4.0)
    np.testing.assert_allclose(again.std(), fit_linear(W, y, NAMES, UNITS).std(), rtol=0.01)


def test_the_condition_number_is_that_of_numpy(rng):
    W, y, _ = problem(rng)
    fit = fit_linear(W, y, NAMES, UNITS)
    assert fit.condition == pytest.approx(np.linalg.cond(W))
    assert fit.scaled_condition == pytest.approx(np.linalg.cond(W / np.linalg.norm(W, axis=0)))


def test_relative_deviations_are_over_the_size_of_the_value(rng):
    # (7) as printed gives a negative deviation for the second, which is negative.
    W, y, _ = problem(rng)
    fit = fit_linear(W, y, NAMES, UNITS)
    np.testing.assert_allclose(fit.relative_std(), 100 * fit.std() / np.abs(fit.theta))
    assert (fit.relative_std() > 0).all()


def test_nuisance_taken_out_beforehand_leaves_the_estimates_of_the_whole(rng):
    # Closed form: the theorem of Frisch, Waugh and Lovell.
    W, y, _ = problem(rng)
    free = without_nuisance(np.column_stack([W[:, :2], y]), W[:, 2:])
    part = fit_linear(free[:, :2], free[:, 2], NAMES[:2], UNITS[:2])
    np.testing.assert_allclose(part.theta, fit_linear(W, y, NAMES, UNITS).theta[:2])


def test_a_value_comes_with_its_deviation(rng):
    W, y, _ = problem(rng)
    fit = fit_linear(W, y, NAMES, UNITS)
    assert fit.value("b") == (fit.theta[1], fit.std()[1])


def test_an_unknown_that_is_not_there_is_refused(rng):
    W, y, _ = problem(rng)
    with pytest.raises(ParameterError, match="The fit has no unknown 'd': its unknowns are a, b, c"):
        fit_linear(W, y, NAMES, UNITS).value("d")


def test_columns_that_depend_on_each_other_are_refused(rng):
    W, y, _ = problem(rng)
    W[:, 2] = W[:, 0] - 3 * W[:, 1]
    with pytest.raises(IdentifiabilityError, match="does not part the unknowns a, b, c"):
        fit_linear(W, y, NAMES, UNITS)


def test_a_column_of_zeros_is_refused(rng):
    W, y, _ = problem(rng)
    W[:, 2] = 0
    with pytest.raises(IdentifiabilityError, match="record a motion that excites each"):
        fit_linear(W, y, NAMES, UNITS)


def test_as_many_equations_as_unknowns_are_too_few(rng):
    W, y, _ = problem(rng, rows=3)
    with pytest.raises(IdentifiabilityError, match="3 equations are too few for 3 unknowns"):
        fit_linear(W, y, NAMES, UNITS)
