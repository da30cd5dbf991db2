"""Minima of changed problems: against the same problems solved as a whole, which are tested against LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.numerics.bounded import bounded_solve
from identification.diagnosis.numerics.tableau import tableau

KNOWN, ALL = 40, 60


@pytest.fixture(params=range(6))
def problem(request):
    """Products of a least-squares problem in units that differ, with bounds of which about half bind."""
    rng = np.random.default_rng(request.param)
    x = rng.normal(size=(3 * ALL, ALL)) * 10.0 ** rng.uniform(-3, 3, ALL)
    a = x.T @ x
    unit = 1.0 / np.sqrt(np.diag(a))
    b = x.T @ (x @ (unit * rng.normal(size=ALL)) + rng.normal(size=3 * ALL))
    return a, b, -unit * rng.uniform(0.0, 2.0, ALL), unit * rng.uniform(0.0, 2.0, ALL), rng


def changed(a, b, lower, upper, rng, near=np.nan):
    """A solved problem of the first unknowns changed by some that enter and leave; which they are, and the rest."""
    known = tableau(a[:KNOWN, :KNOWN], b[:KNOWN], lower[:KNOWN], upper[:KNOWN], np.full(KNOWN, np.nan))
    new, gone = KNOWN + rng.permutation(ALL - KNOWN)[:7], rng.permutation(KNOWN)[:5]
    pieces = known.pieces(a[new][:, :KNOWN], np.diag(a)[new], b[new])
    entering = known.joined(*pieces, a[np.ix_(new, new)])
    index = np.concatenate([np.arange(KNOWN), new])
    start = np.where(rng.random(ALL) < 0.5, lower, upper)[index] * near
    found = known.changed(entering, gone, (lower[index], upper[index]), start)
    return known, found, index, np.setdiff1d(index, gone)


@pytest.mark.parametrize("near", [np.nan, 1.0])
def test_the_minimum_of_a_changed_problem_is_that_of_the_problem_solved_as_a_whole(problem, near):
    a, b, lower, upper, rng = problem
    _, found, index, kept = changed(a, b, lower, upper, rng, near)
    expected = np.zeros(ALL)
    expected[kept] = bounded_solve(a[np.ix_(kept, kept)], b[kept], lower[kept], upper[kept])
    unit = np.sqrt(np.diag(a))
    np.testing.assert_allclose((found.x * unit[index]), (expected * unit)[index], atol=1e-8)


def test_what_a_change_gains_is_the_difference_of_the_two_minima(problem):
    a, b, lower, upper, rng = problem
    known, found, index, _ = changed(a, b, lower, upper, rng)

    def loss(x, which):
        return x @ a[np.ix_(which, which)] @ x - 2.0 * b[which] @ x

    before = loss(known.x * known.scale, np.arange(KNOWN))
    assert found.less == pytest.approx(before - loss(found.x, index), rel=1e-8)


def test_slopes_are_those_of_the_loss_where_a_bound_holds_and_zero_elsewhere(problem):
    a, b, lower, upper, rng = problem
    _, found, index, kept = changed(a, b, lower, upper, rng)
    unit = np.sqrt(np.diag(a))[index]
    free = (found.x > lower[index]) & (found.x < upper[index]) & np.isin(index, kept)
    np.testing.assert_allclose(
        found.slope / unit, np.where(free, 0.0, (a @ _spread(found.x, index) - b)[index] / unit), atol=1e-6
    )


def _spread(x, index):
    out = np.zeros(ALL)
    out[index] = x
    return out
