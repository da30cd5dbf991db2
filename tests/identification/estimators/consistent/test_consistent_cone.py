"""The cone of physically consistent parameters and regions of links."""

import contextlib
import warnings

import cvxpy as cp
import numpy as np
import pytest

from identification.estimators.consistent.consistent import full_parameters, selection
from identification.estimators.consistent.consistent_bodies import PSEUDO, pseudo_inertia, reference_body
from identification.estimators.consistent.consistent_program import (
    Program,
    is_possible,
    nearest_unconstrained,
    solve_program,
)
from identification.estimators.weighted_least_squares import ols
from identification.regression.regressor import gap_regressor, torque_regressor
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import EstimationError, ParameterError
from phantom_dyn.model.inertia import body_parameters
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

CAD = body_parameters(2.0, np.array([0.1, 0.0, 0.2]), np.diag([0.05, 0.06, 0.03]))

ALONE = ((reference_body(CAD),), np.zeros(0), np.zeros(0))  # one body anywhere, no coefficients


def one_body(rng, *, rows=14, coefficients=1, shift=3.0, **kwargs):
    """Equations of one body that ask for what no body can have, and of coefficients below zero."""
    width = 10 + coefficients
    factor = rng.normal(size=(rows, width)) * 20
    wanted = np.concatenate([CAD * rng.uniform(1 - shift, 1 + shift, 10), np.full(coefficients, -0.3)])
    free = np.full(coefficients, np.inf)
    return Program(factor, factor @ wanted, (reference_body(CAD),), 0 * free[:0] if not coefficients else
                   np.zeros(coefficients), free, **kwargs)  # fmt: skip


def by_cvxpy(program):
    """The same program written for cvxpy, from the definition of each part."""
    pi = cp.Variable(program.factor.shape[1])
    (body,) = program.bodies
    scaled = sum(pi[k] / body.scale[k] * PSEUDO[k] for k in range(10))
    root = np.linalg.inv(body.whitening)
    begun = root @ root.T
    matrix = cp.Variable((4, 4), symmetric=True)
    distance = 0.5 * cp.sum_squares(body.whitening @ (matrix - begun) @ body.whitening.T)
    within = [matrix == scaled, matrix >> program.margin * np.eye(4), pi[10:] >= program.lower]
    cost = 0.5 * cp.sum_squares(program.factor @ pi - program.target) + program.weight * distance
    problem = cp.Problem(cp.Minimize(cost), within)
    # At its usual tolerance of 1e-8 the minimum is flat enough to be 1e-4 off, and rounding decides where.
    for tolerance in (1e-10, 1e-9):
        exact = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), tolerance)
        with contextlib.suppress(cp.SolverError), warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a solution that may be inaccurate, see the status
            problem.solve(solver="CLARABEL", **exact)
            if problem.status == cp.OPTIMAL:
                break
    return pi.value


def test_the_solution_is_that_of_cvxpy(rng):
    program = one_body(rng, weight=2.0)
    np.testing.assert_allclose(solve_program(program).pi, by_cvxpy(program), atol=3e-5)


def cost(program, pi):
    """What is minimised, by its definition: residuals and the distance of the one body from its reference."""
    (body,) = program.bodies
    relative = body.whitening @ pseudo_inertia(pi[:10] / body.scale) @ body.whitening.T
    distance = 0.5 * np.sum((relative - np.eye(4)) ** 2)
    return 0.5 * np.sum((program.factor @ pi - program.target) ** 2) + program.weight * distance


def test_nothing_else_that_is_possible_costs_less(rng):
    # Oracle: the definition of the cost at possible points on the way to the solution and beside it.
    program = one_body(rng, weight=2.0)
    best = np.r_[
        (solution := solve_program(program).pi)[:10], np.maximum(solution[10:], 0.0)
    ]  # the solver's last digit
    others = [np.r_[CAD * share, 0.0] for share in (0.5, 1.0, 2.0)]
    tried = [best + part * (other - best) for other in others for part in (1e-3, 1e-2, 0.1, 1.0)]
    assert all(is_possible(program, pi) for pi in tried)
    assert min(cost(program, pi) for pi in tried) > cost(program, best)


def test_equations_of_an_impossible_body_give_one_that_can_exist(rng):
    # Oracle: eigenvalues of the central inertia's pseudo-inertia, and which law was in the way.
    program = one_body(rng)
    point = solve_program(program)
    assert np.linalg.eigvalsh(pseudo_inertia(point.pi[:10]))[0] > 0
    assert point.held_bodies == (0,)


def test_a_coefficient_below_its_bound_is_held_at_it(rng):
    point = solve_program(one_body(rng))
    assert point.held_bounds == (0,)
    assert point.pi[10] == pytest.approx(0.0, abs=1e-6)


def test_without_equations_the_reference_comes_back():
    program = Program(np.zeros((0, 10)), np.zeros(0), *ALONE,
                      1.0)  # fmt: skip
    np.testing.assert_allclose(solve_program(program).pi, CAD, atol=1e-5)


def test_a_possible_truth_without_noise_comes_back_whatever_the_prior(rng):
    truth = CAD * 1.2
    factor = rng.normal(size=(10, 10)) * 1e9
    program = Program(factor, factor @ truth, *ALONE, 1.0)
    np.testing.assert_allclose(solve_program(program).pi, truth, rtol=1e-4, atol=1e-6)


def test_exact_equations_are_kept_to_the_last_digit(rng):
    # Mass and first moments of a lighter body; the inertia that goes with them is free.
    program = Program(np.eye(10)[:4], 0.3 * CAD[:4], *ALONE, exact=True)
    point = solve_program(program)
    np.testing.assert_allclose(point.pi[:4], 0.3 * CAD[:4], rtol=1e-9, atol=1e-12)
    assert np.linalg.eigvalsh(pseudo_inertia(point.pi))[0] > 0


def test_exact_equations_of_a_negative_mass_have_no_solution():
    program = Program(np.eye(10)[:1], -np.ones(1), *ALONE, exact=True)
    with pytest.raises(EstimationError, match="No physically possible bodies satisfy these equations"):
        solve_program(program)


def test_the_closed_form_is_the_point_of_the_equations_nearest_to_the_reference(rng):
    # Optimality: the step from the reference has no part along what the equations leave free.
    program = one_body(rng, rows=6, coefficients=0, shift=0.1)
    nearest = nearest_unconstrained(program)
    np.testing.assert_allclose(program.factor @ nearest, program.target, atol=1e-9)
    (body,) = program.bodies
    free = np.linalg.svd(program.factor * body.scale)[2][6:]
    step = body.metric @ ((nearest - CAD) / body.scale)
    np.testing.assert_allclose(body.metric.T @ step @ free.T, 0, atol=1e-7)


def test_only_what_all_constraints_allow_is_possible(rng):
    program = one_body(rng)
    assert is_possible(program, np.r_[body_parameters(2.0, np.array([0.1, 0, 0.2]), 0.004 * np.eye(3)), 0.1])
    assert not is_possible(program, np.r_[CAD, -0.1])
    assert not is_possible(program, np.r_[-CAD, 0.1])


@pytest.fixture
def fitted(arm, swing, make_log, rubbing, friction, rng):
    """A fit of the arm with noise of a given deviation."""
    motion = swing(arm, 400)
    return lambda sigma: ols(
        torque_regressor(
            arm, make_log(arm, motion, rubbing(arm, motion) + sigma * rng.normal(size=(400, 3))), friction(arm)
        )
    )


def test_those_of_the_robot_come_back_without_noise(arm, fitted):
    full = full_parameters(arm, fitted(0.0))
    np.testing.assert_allclose(full.pi, np.r_[standard_parameters(arm), [0.4, 0.6] * 3], atol=1e-6)


def test_possible_base_parameters_are_kept(arm, fitted):
    fit = fitted(0.02)
    np.testing.assert_allclose(fit.base.values(full_parameters(arm, fit).pi), fit.theta, atol=1e-8)


def test_a_changed_ur10_predicts_the_torque_of_any_motion(make_log, rng):
    # Known truth: bodies 20 % heavier than the given ones; another motion than that of the fit.
    given = load_robot("example:ur10")
    truth = with_parameters(given, 0.2 * standard_parameters(given))
    motion, other = (Motion(np.arange(100) * 0.01, *rng.normal(size=(3, 100, 6))) for _ in range(2))
    full = full_parameters(
        given, ols(torque_regressor(given, make_log(given, motion, inverse_dynamics(truth, motion))))
    )
    again = with_parameters(given, full.pi - standard_parameters(given))
    np.testing.assert_allclose(inverse_dynamics(again, other), inverse_dynamics(truth, other), atol=1e-5)


def test_impossible_base_parameters_move_by_few_deviations_to_possible_bodies(arm, fitted, all_possible):
    fit = fitted(5.0)
    full = full_parameters(arm, fit)
    assert all_possible(full.pi[: fit.first_effect])
    assert 0 < np.abs(full.shift).max() < 5


def test_selection_is_what_base_parameters_are_made_with(fitted, rng):
    base = fitted(0.1).base
    pi = rng.normal(size=len(base.names))
    np.testing.assert_allclose(selection(base) @ pi, base.values(pi), atol=1e-12)


def test_a_pendulum_keeps_what_it_does_not_show(pendulum, swing, make_log):
    # A joint about a fixed axis shows its inertia and first moments about it alone.
    motion = swing(pendulum, 100)
    full = full_parameters(
        pendulum, ols(torque_regressor(pendulum, make_log(pendulum, motion, inverse_dynamics(pendulum, motion))))
    )
    np.testing.assert_allclose(full.pi, standard_parameters(pendulum), atol=1e-6)


def test_a_fit_without_the_rigid_body_is_refused(arm, swing, make_log, rubbing, friction):
    motion = swing(arm, 200)
    fit = ols(gap_regressor(arm, make_log(arm, motion, rubbing(arm, motion)), friction(arm)))
    with pytest.raises(ParameterError, match="give a fit of this robot with its rigid body among the unknowns"):
        full_parameters(arm, fit)


def test_a_fit_without_covariance_is_refused(pendulum, swing, make_log):
    motion = swing(pendulum, 2)
    fit = ols(torque_regressor(pendulum, make_log(pendulum, motion, motion.q)))
    if np.isfinite(fit.cov).all():
        pytest.fail("two samples left an equation over")
    with pytest.raises(ParameterError, match="has no covariance"):
        full_parameters(pendulum, fit)
