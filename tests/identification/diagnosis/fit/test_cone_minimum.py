"""The best body that can exist. Oracles: cvxpy with Clarabel on the same cone, and a minimum without a cone."""

import cvxpy as cp
import numpy as np
import pytest

from identification.diagnosis.fit.cone_minimum import ENTRIES, STANDARD, best_bodies
from identification.estimators.consistent.consistent_bodies import PSEUDO, pseudo_inertia

# A box about the origin that holds a ball of unit mass, with the centre of mass off its middle.
GIVEN = np.array([1.0, 0.1, -0.05, 0.2, 0.5, 0.0, 0.6, 0.0, 0.0, 0.4])
REACH = np.array([[1.0, *(sign * (np.arange(3) == axis))] + [0.0] * 6 for axis in range(3) for sign in (1.0, -1.0)])


def quadratic(rng, wanted):
    """A loss of given minimum, whose directions differ by six orders of magnitude."""
    rows = rng.standard_normal((30, 10)) * 10.0 ** rng.uniform(-3, 3, 10)
    a = rows.T @ rows
    return a, a @ wanted


def loss(a, b, x):
    return 0.5 * x @ a @ x - b @ x


@pytest.mark.parametrize("seed", range(8))
def test_the_best_body_is_that_of_cvxpy(seed):
    rng = np.random.default_rng(seed)
    a, b = quadratic(rng, 3.0 * rng.standard_normal(10))
    found = best_bodies(a, b, GIVEN[None], REACH[None])
    x = cp.Variable(10)
    root = np.linalg.cholesky(a)
    limits = [sum((GIVEN + x)[k] * PSEUDO[k] for k in range(10)) >> 0, REACH @ (GIVEN + x) >= 0]
    cp.Problem(cp.Minimize(cp.sum_squares(root.T @ x - np.linalg.solve(root, b))), limits).solve(solver=cp.CLARABEL)
    free = loss(a, b, np.linalg.solve(a, b))
    assert np.linalg.eigvalsh(pseudo_inertia(GIVEN + found))[0] > 0.0
    assert (REACH @ (GIVEN + found)).min() > 0.0
    assert abs(loss(a, b, found) - loss(a, b, x.value)) < 1e-4 * (loss(a, b, x.value) - free)


def test_a_minimum_that_exists_is_found_as_it_is(rng):
    a, b = quadratic(rng, 0.05 * GIVEN)
    found = best_bodies(a, b, GIVEN[None], REACH[None])
    assert loss(a, b, found) - loss(a, b, 0.05 * GIVEN) < 1e-5


def test_entries_and_parameters_are_inverse_to_each_other(rng):
    body = rng.standard_normal(10)
    entries = pseudo_inertia(body)[np.triu_indices(4)]
    assert np.allclose(ENTRIES @ body, entries)
    assert np.allclose(STANDARD @ entries, body)


def test_a_given_body_on_the_edge_of_the_cone_stays_as_it_is(rng):
    """A point mass: no body near it exists in all directions."""
    point = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    a, b = quadratic(rng, 3.0 * rng.standard_normal(10))
    assert np.array_equal(best_bodies(a, b, point[None], REACH[None]), np.zeros(10))
