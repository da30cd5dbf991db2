"""Numerics of the engine."""

import numpy as np
import pytest

from identification.engine.numerics import bounded, tableau_changes
from identification.engine.numerics.bounded import bounded_solve, bounded_solve_without, solve, solve_each
from identification.engine.numerics.spans import orthogonal_part, orthonormal
from identification.engine.numerics.tableau import tableau
from identification.engine.numerics.tableau_changes import changed


@pytest.fixture(params=[1, 3, 4, 5, 11, 40])
def problem(request, rng):
    """Products of a random least-squares problem in units that differ, with bounds of which about a third bind."""
    size = request.param
    x, y = rng.normal(size=(3 * size + 2, size)) * 10.0 ** rng.uniform(-4, 4, size), rng.normal(size=3 * size + 2)
    reach = 0.5 * np.abs(np.linalg.lstsq(x, y, rcond=None)[0]) * 10.0 ** rng.uniform(-0.5, 1.5, size)
    return x.T @ x, x.T @ y, -reach, np.where(rng.random(size) < 0.3, np.inf, reach)


def test_the_minimum_is_that_of_lapack_among_the_free_unknowns(problem, monkeypatch):
    def by_lapack(matrices, b, fixed, x, *_):
        free, a = ~fixed, matrices[0]
        x[free] = np.linalg.solve(a[np.ix_(free, free)], b[free] - a[free] @ np.where(fixed, x, 0.0))

    compiled = bounded_solve(*problem)
    monkeypatch.setattr(bounded, "_minima", getattr(bounded._minima, "py_func", bounded._minima))
    monkeypatch.setattr(bounded, "_free_minimum", by_lapack)
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


def test_a_basis_has_as_many_columns_as_there_are_directions(rng):
    x = rng.normal(size=(30, 3))
    matrix = np.column_stack([x, 1e6 * x[:, 0] - x[:, 1], np.zeros(30)])
    basis = orthonormal(matrix, 1e-9)
    assert basis.shape == (30, np.linalg.matrix_rank(matrix))
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)


def test_no_columns_have_an_empty_basis():
    assert orthonormal(np.zeros((5, 2)), 1e-9).shape == (5, 0)


def test_what_is_outside_of_a_span_is_what_least_squares_leaves(rng):
    x, y = rng.normal(size=(30, 4)), rng.normal(size=(30, 2))
    np.testing.assert_allclose(orthogonal_part(y, orthonormal(x, 1e-9)), y - x @ np.linalg.lstsq(x, y)[0], atol=1e-12)


KNOWN, ALL = 40, 60


@pytest.fixture(params=range(6))
def tableau_problem(request):
    """Products of a least-squares problem in units that differ, with bounds of which about half bind."""
    rng = np.random.default_rng(request.param)
    x = rng.normal(size=(3 * ALL, ALL)) * 10.0 ** rng.uniform(-3, 3, ALL)
    a = x.T @ x
    unit = 1.0 / np.sqrt(np.diag(a))
    b = x.T @ (x @ (unit * rng.normal(size=ALL)) + rng.normal(size=3 * ALL))
    return a, b, -unit * rng.uniform(0.0, 2.0, ALL), unit * rng.uniform(0.0, 2.0, ALL), rng


def change(a, b, lower, upper, rng, near=np.nan):
    """A solved problem of the first unknowns changed by some that enter and leave; which they are, and the rest."""
    known = tableau(a[:KNOWN, :KNOWN], b[:KNOWN], lower[:KNOWN], upper[:KNOWN], np.full(KNOWN, np.nan))
    new, gone = KNOWN + rng.permutation(ALL - KNOWN)[:7], rng.permutation(KNOWN)[:5]
    pieces = known.entering_parts(a[new][:, :KNOWN], np.diag(a)[new], b[new])
    entering = known.entering_of(*pieces, a[np.ix_(new, new)])
    index = np.concatenate([np.arange(KNOWN), new])
    start = np.where(rng.random(ALL) < 0.5, lower, upper)[index] * near
    found = changed(known, entering, gone, (lower[index], upper[index]), start)
    return known, found, index, np.setdiff1d(index, gone)


@pytest.mark.parametrize("near", [np.nan, 1.0])
def test_the_minimum_of_a_changed_problem_is_that_of_the_problem_solved_as_a_whole(tableau_problem, near):
    a, b, lower, upper, rng = tableau_problem
    _, found, index, kept = change(a, b, lower, upper, rng, near)
    expected = np.zeros(ALL)
    expected[kept] = bounded_solve(a[np.ix_(kept, kept)], b[kept], lower[kept], upper[kept])
    unit = np.sqrt(np.diag(a))
    np.testing.assert_allclose((found.x * unit[index]), (expected * unit)[index], atol=1e-8)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_steps_within_the_bounds_end_at_the_minimum_wherever_they_begin(tableau_problem, share):
    # All unknowns begin at a bound, the share of them at the upper one: most are held at the wrong end.
    a, b, lower, upper, rng = tableau_problem
    known = tableau(a, b, lower, upper, np.full(ALL, np.nan))
    nothing = known.entering_of(*known.entering_parts(np.zeros((0, ALL)), np.zeros(0), np.zeros(0)), np.zeros((0, 0)))
    low, high, free = lower / known.scale, upper / known.scale, np.zeros(ALL, dtype=bool)
    bounds = tableau_changes._Constraints(low, high, free, np.full(ALL, known.rounding))
    start = np.where(rng.random(ALL) < share, high, low)
    found, _, converged = tableau_changes._active_set_steps(known, nothing, ~free, start, bounds)
    assert converged
    np.testing.assert_allclose(found.x, bounded_solve(a, b, lower, upper) / known.scale, atol=1e-8)


def test_a_problem_without_a_free_unknown_is_solved_without_a_word_on_the_terminal(capfd):
    # Closed form: each of three unknowns wants to be 2 and may be 1.
    found = tableau(np.eye(3), np.full(3, 2.0), np.zeros(3), np.ones(3), np.full(3, np.nan))
    np.testing.assert_allclose(found.x, 1.0)
    assert capfd.readouterr() == ("", "")


def test_twins_that_enter_leave_what_one_of_them_leaves(tableau_problem):
    a, b, lower, upper, _ = tableau_problem
    known = tableau(a[:KNOWN, :KNOWN], b[:KNOWN], lower[:KNOWN], upper[:KNOWN], np.full(KNOWN, np.nan))
    left = []
    for count in (1, 3):
        new = np.full(count, KNOWN)
        entering = known.entering_of(
            *known.entering_parts(a[new][:, :KNOWN], np.diag(a)[new], b[new]), a[np.ix_(new, new)]
        )
        # Without bounds of their own, so that three can do no more than one.
        far = np.full(count, np.inf)
        ends = np.append(lower[:KNOWN], -far), np.append(upper[:KNOWN], far)
        left.append(changed(known, entering, np.zeros(0, dtype=int), ends, np.full(KNOWN + count, np.nan)).value)
    assert left[1] == pytest.approx(left[0], rel=1e-9)


def test_the_value_of_a_change_is_that_of_the_quadratic_form_at_its_minimum(tableau_problem):
    a, b, lower, upper, rng = tableau_problem
    _, found, index, _ = change(a, b, lower, upper, rng)
    x = found.x
    assert found.value == pytest.approx(x @ a[np.ix_(index, index)] @ x - 2.0 * b[index] @ x, rel=1e-9)


def test_a_change_that_rounding_spoils_says_so(tableau_problem):
    a, b, lower, upper, rng = tableau_problem
    known, found, _, _ = change(a, b, lower, upper, rng)
    # An inverse that is wrong by more than itself stands for one that has lost its digits.
    spoilt = known._replace(response=known.response * (1.0 + 3.0 * rng.normal(size=known.response.shape)))
    nothing = spoilt.entering_of(
        *spoilt.entering_parts(np.zeros((0, KNOWN)), np.zeros(0), np.zeros(0)), np.zeros((0, 0))
    )
    gone = np.flatnonzero(~known.held)[:5]
    again = changed(spoilt, nothing, gone, (lower[:KNOWN], upper[:KNOWN]), np.full(KNOWN, np.nan))
    assert found.converged
    assert not again.converged


def test_slopes_are_those_of_the_loss_where_a_bound_holds_and_zero_elsewhere(tableau_problem):
    a, b, lower, upper, rng = tableau_problem
    _, found, index, kept = change(a, b, lower, upper, rng)
    unit = np.sqrt(np.diag(a))[index]
    free = (found.x > lower[index]) & (found.x < upper[index]) & np.isin(index, kept)
    np.testing.assert_allclose(
        found.slope / unit, np.where(free, 0.0, (a @ _spread(found.x, index) - b)[index] / unit), atol=1e-6
    )


def _spread(x, index):
    out = np.zeros(ALL)
    out[index] = x
    return out
