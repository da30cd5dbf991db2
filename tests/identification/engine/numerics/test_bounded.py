"""Minima within bounds, compiled: against plain NumPy and LAPACK, and by the conditions of a minimum."""

from __future__ import annotations

import numpy as np
import pytest

from identification.engine.numerics import bounded
from identification.engine.numerics.bounded import bounded_solve, bounded_solve_without, solve, solve_each


@pytest.fixture(params=[1, 3, 4, 5, 11, 40])
def problem(request, rng):
    """Products of a random least-squares problem in units that differ, with bounds of which about a third bind."""
    size = request.param
    x, y = rng.normal(size=(3 * size + 2, size)) * 10.0 ** rng.uniform(-4, 4, size), rng.normal(size=3 * size + 2)
    reach = 0.5 * np.abs(np.linalg.lstsq(x, y, rcond=None)[0]) * 10.0 ** rng.uniform(-0.5, 1.5, size)
    return x.T @ x, x.T @ y, -reach, np.where(rng.random(size) < 0.3, np.inf, reach)


def test_the_compiled_minimum_is_that_of_lapack(problem, monkeypatch):
    compiled = bounded_solve(*problem)
    monkeypatch.setattr(bounded, "_minima", getattr(bounded._minima, "py_func", bounded._minima))
    monkeypatch.setattr(bounded, "_free_minimum", bounded._free_minimum_plain)
    np.testing.assert_allclose(compiled, bounded_solve(*problem), rtol=1e-8)


@pytest.mark.parametrize("seed", range(10))
def test_no_unknown_lowers_the_loss_where_unknowns_are_nearly_alike(seed):
    # Oracle: the conditions of a minimum. Exchanging all bounds at once goes in circles in many of these.
    rng = np.random.default_rng(seed)
    size = 60
    x = rng.normal(size=(80, 12)) @ rng.normal(size=(12, size)) + 1e-2 * rng.normal(size=(80, size))
    a, b = x.T @ x, x.T @ (30.0 * rng.normal(size=80))
    lower, upper = -rng.random(size), rng.random(size)
    lower[:3] = upper[:3]  # no unknown at all
    start = np.where(rng.random(size) < 0.4, lower, np.where(rng.random(size) < 0.5, upper, np.nan))
    found = bounded_solve(a, b, lower, upper, start)
    slope, square = a @ found - b, np.diag(a)
    step = np.clip(found - slope / square, lower, upper) - found
    assert ((found >= lower) & (found <= upper)).all()
    assert -(slope * step + 0.5 * square * step**2).min() < 1e-9 * abs(found @ (slope - b))


def test_where_a_minimum_starts_does_not_change_it(problem, rng):
    a, b, lower, upper = problem
    near = np.where(rng.random(len(b)) < 0.5, lower, np.where(np.isfinite(upper), upper, np.nan))
    np.testing.assert_allclose(
        bounded_solve(a, b, lower, upper, near=near), bounded_solve(a, b, lower, upper), rtol=1e-8
    )


def test_minima_without_a_part_are_those_of_the_rest(problem):
    a, b, lower, upper = problem
    parts = np.array([0.2, 0.5])
    found = bounded_solve_without(a, b, parts[:, None, None] * a, parts[:, None] * b[::-1], lower, upper, lower)
    for share, x in zip(parts, found, strict=True):
        expected = bounded_solve((1 - share) * a, b - share * b[::-1], lower, upper)
        np.testing.assert_allclose(x, expected, rtol=1e-8)


def test_several_systems_at_once_are_each_by_itself(rng):
    # Oracle: the same one by one; rows of very different size.
    root = rng.normal(size=(5, 4, 9)) * np.array([1.0, 1e3, 1e-4, 1.0])[None, :, None]
    a, b = root @ root.transpose(0, 2, 1), rng.normal(size=(5, 4, 3))
    np.testing.assert_allclose(
        solve_each(a, b), [solve(one, right) for one, right in zip(a, b, strict=True)], rtol=1e-9
    )
