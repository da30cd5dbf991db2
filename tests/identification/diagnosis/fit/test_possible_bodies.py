# pyright: reportAttributeAccessIssue=false
"""Bodies that can exist. Oracles: cvxpy on the same cone, known bodies, and a fit without constraints.

The best body that can exist. Oracles: cvxpy with Clarabel on the same cone, and a minimum without a cone.
"""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pinocchio as pin
import pytest

from identification.diagnosis.fit.cone_minimum import ENTRIES, STANDARD, best_bodies
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.possible_bodies import ActiveConstraints, body_of, impossible_bodies, possible_minimum
from identification.engine.numerics.bounded import bounded_solve
from identification.estimators.consistent.consistent_bodies import PSEUDO, pseudo_inertia
from phantom_dyn.model.inertia import point_mass_parameters


def made_up(rng, bodies, others=4):
    """A quadratic whose minimum belongs to no body, in which each body's unit changes about as much as the others."""
    scale = np.concatenate([*(body.given.scale for body in bodies), np.ones(others)])
    x = rng.standard_normal((3 * len(scale), len(scale))) * 10.0 ** rng.uniform(-1, 2, len(scale)) / scale
    wanted = 2.0 * rng.standard_normal(len(scale)) * scale
    low, high = np.full(len(scale), -np.inf), np.full(len(scale), np.inf)
    low[-others:], high[-others:] = -0.5, 0.5
    return x.T @ x, x.T @ (x @ wanted), (low, high)


def by_cvxpy(a, b, bounds, bodies):
    scale = 1.0 / np.sqrt(np.diag(a))
    root = np.linalg.cholesky(a * np.outer(scale, scale))
    u = cp.Variable(len(b))
    x, limits = cp.multiply(scale, u), []
    for k, body in enumerate(bodies):
        own = (body.given.standard + x[10 * k : 10 * k + 10]) / body.given.scale
        limits += [sum(own[i] * PSEUDO[i] for i in range(10)) >> 0, (body.reach * body.given.scale) @ own >= 0]
    bounded = np.flatnonzero(np.isfinite(bounds[0]))
    limits += [x[bounded] >= bounds[0][bounded], x[bounded] <= bounds[1][bounded]]
    cost = cp.sum_squares(root.T @ u - np.linalg.solve(root, b * scale))
    cp.Problem(cp.Minimize(cost), limits).solve(solver=cp.CLARABEL)
    return np.array(u.value) * scale


@pytest.mark.parametrize("count", [1, 2])
def test_the_minimum_is_that_of_cvxpy_on_the_same_cone(planar2, rng, count):
    bodies = [body_of(planar2, k + 1, tuple(range(10 * k, 10 * k + 10))) for k in range(count)]
    a, b, bounds = made_up(rng, bodies)
    free = bounded_solve(a, b, *bounds)
    assert any(not body.is_possible(free[list(body.columns)]) for body in bodies)
    found, _ = possible_minimum(a, b, bounds, free, [(body, np.array(body.columns)) for body in bodies])
    wanted = by_cvxpy(a, b, bounds, bodies)

    def loss(x):
        return x @ a @ x - 2.0 * b @ x

    assert all(body.is_possible(found[list(body.columns)]) for body in bodies)
    assert np.all((found >= bounds[0] - 1e-9) & (found <= bounds[1] + 1e-9))
    assert loss(found) - loss(wanted) < 1e-5 * (loss(wanted) - loss(free))


def test_the_minimum_is_the_same_whatever_a_search_for_it_begins_to_hold(planar2, rng):
    bodies = [body_of(planar2, k + 1, tuple(range(10 * k, 10 * k + 10))) for k in range(2)]
    a, b, bounds = made_up(rng, bodies)
    free, places = bounded_solve(a, b, *bounds), [(body, np.array(body.columns)) for body in bodies]
    found, _ = possible_minimum(a, b, bounds, free, places)
    bounded = np.isfinite(bounds[0])
    wrong = ActiveConstraints((False, True), bounded & (found > bounds[0]), np.zeros_like(bounded))
    again, binding = possible_minimum(a, b, bounds, free, places, wrong)
    assert again @ a @ again - 2.0 * b @ again == pytest.approx(found @ a @ found - 2.0 * b @ found, rel=1e-6)
    np.testing.assert_array_equal(binding.low, bounded & (again <= bounds[0]))


def test_a_load_within_reach_makes_a_body_that_exists_and_its_absence_none(planar2):
    body = body_of(planar2, 2, tuple(range(10)))
    own = planar2.model.inertias[2]
    assert body.is_possible(np.zeros(10))
    assert body.is_possible(point_mass_parameters(0.5 * own.mass, own.lever))
    assert not body.is_possible(point_mass_parameters(-1.5 * own.mass, own.lever))
    # Coefficients that overflowed are no body; their eigenvalues would not converge.
    assert not body.is_possible(np.full(10, np.nan))
    assert not body.is_possible(np.full(10, np.inf))


def test_the_centre_of_a_body_stays_within_reach(planar2):
    body = body_of(planar2, 1, tuple(range(10)))
    longest = np.linalg.norm(planar2.model.jointPlacements[2].translation)
    mass = 10.0 * planar2.model.inertias[1].mass
    assert body.is_possible(point_mass_parameters(mass, np.array([0.0, 0.0, 0.0])))
    assert not body.is_possible(point_mass_parameters(mass, np.full(3, 3.0 * longest)))


def test_an_impossible_given_body_is_replaced_by_the_nearest_possible_one(planar2):
    model = planar2.model.copy()
    # Its principal inertias break the triangle inequality, as those of many vendors' files do.
    model.inertias[1] = pin.Inertia(1.0, np.array([0.1, 0.0, 0.0]), np.diag([1e-3, 1e-3, 5e-3]))
    assert body_of(replace(planar2, model=model), 1, tuple(range(10))).is_possible(np.zeros(10))


@pytest.fixture(scope="module")
def odd(lab, planar2):
    """The arm with a torque on its elbow that falls with acceleration: an inertia below zero would explain it."""
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    inertia = float(planar2.model.inertias[2].toDynamicParameters()[6])
    torque = 30.0 * inertia * motion.a * [0.0, 1.0]
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


def of_elbow(prepared):
    return next(t for t in prepared.columns.terms if t.effect_joint == ("inertial_parameters", "elbow"))


def test_a_fit_states_bodies_that_exist_and_what_impossible_ones_would_have_gained(odd, planar2):
    term = of_elbow(odd)
    found, nothing = fit(odd.problem, (term,)), fit(odd.problem, ())
    bodies = odd.problem.bodies_of((term,))
    assert impossible_bodies(bodies, found.theta) == ()
    assert all(impossible_bodies(bodies, theta) == () for theta in found.fold_theta)
    assert found.denied_gain > nothing.objective - found.objective


def test_a_wrong_link_that_exists_costs_nothing(lab, planar2):
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    load = lab.acting(planar2, motion, "payload", None, 1.0, 0.1, 0.0, -0.2)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, load),))
    found = fit(prepared.problem, (of_elbow(prepared),))
    assert found.denied_gain < 30.0 < fit(prepared.problem, ()).objective - found.objective


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
