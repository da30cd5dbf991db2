"""Estimates that are physically consistent."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from identification.estimators.consistent.cone_program import Shape, cone_program
from identification.estimators.consistent.consistent import consistent
from identification.estimators.consistent.consistent_bodies import (
    pseudo_inertia,
    reference_bodies,
    reference_body,
    standard_of,
)
from identification.estimators.weighted_least_squares import wls
from identification.regression.regressor import gap_regressor, torque_regressor
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import IdentifiabilityError, ParameterError
from phantom_dyn.model.inertia import body_parameters
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS


@pytest.fixture(scope="module")
def ur10():
    return load_robot("example:ur10")


@pytest.fixture
def driven_on(pendulum, swing, make_log):
    """A recording whose friction drives the pendulum on by 0.3 N m s."""
    motion = swing(pendulum, 300)
    viscous = pendulum.viscous_friction[0] + 0.3
    return make_log(pendulum, motion, inverse_dynamics(pendulum, motion) - viscous * motion.v)


@pytest.fixture
def noisy(arm, swing, make_log, rubbing, rng):
    """A recording of the arm with noise of a given deviation."""
    motion = swing(arm, 400)
    return lambda sigma: make_log(arm, motion, rubbing(arm, motion) + sigma * rng.normal(size=(400, 3)))


def test_where_no_constraint_acts_it_is_weighted_least_squares(arm, noisy, friction):
    log = noisy(0.02)
    weighted, fit = (
        wls(torque_regressor(arm, log, friction(arm))),
        consistent(torque_regressor(arm, log, friction(arm))),
    )
    np.testing.assert_allclose(fit.theta, weighted.theta, atol=1e-8)
    np.testing.assert_array_equal(fit.cov, weighted.cov)
    assert fit.held == ()


def test_base_parameters_are_those_of_the_full_ones(arm, noisy, friction):
    fit = consistent(torque_regressor(arm, noisy(3.0), friction(arm)))
    np.testing.assert_allclose(fit.base.values(fit.pi), fit.theta, atol=1e-12)


def test_bodies_can_exist_whatever_the_noise(arm, noisy, friction):
    # Oracle: eigenvalues of each pseudo-inertia.
    fit = consistent(torque_regressor(arm, noisy(30.0), friction(arm)))
    assert np.linalg.eigvalsh(pseudo_inertia(fit.pi[:30].reshape(3, 10))).min() > 0


def test_bodies_that_are_held_are_named_and_so_is_what_it_means_for_deviations(arm, noisy, friction):
    fit = consistent(torque_regressor(arm, noisy(30.0), friction(arm)))
    assert any("asks for a body that cannot exist; its mass distribution is held at the edge" in s for s in fit.held)
    assert fit.warnings[-1].startswith("The deviations are those without these constraints")


def test_friction_below_zero_is_held_where_it_is_zero_with_the_modelled(pendulum, driven_on):
    # Known truth: a recording that is driven on by 0.3 N m s.
    fit = consistent(
        torque_regressor(pendulum, driven_on, [(effect_named("viscous_friction"), pendulum.joint_names[0])])
    )
    assert fit.pi[-1] == pytest.approx(-pendulum.viscous_friction[0], abs=1e-5)
    assert any("viscous_friction.coefficient is held at its bound of" in sentence for sentence in fit.held)


def test_a_value_that_is_held_is_not_called_impossible_too(pendulum, driven_on):
    effects = [(effect_named("viscous_friction"), pendulum.joint_names[0])]
    assert any(
        "beyond its lower bound" in said for said in wls(torque_regressor(pendulum, driven_on, effects)).warnings
    )
    assert not any(
        "beyond its lower bound" in said for said in consistent(torque_regressor(pendulum, driven_on, effects)).warnings
    )


def test_the_full_parameters_of_a_ur10_come_back(ur10, make_log, rng):
    # Known truth: what no recording separates is taken from the given bodies, which are the true ones here.
    motion = Motion(np.arange(200) * 0.01, *rng.normal(size=(3, 200, 6)))
    log = make_log(ur10, motion, inverse_dynamics(ur10, motion) + 0.5 * motion.a)
    effects = [(effect_named("rotor_inertia"), joint) for joint in ur10.joint_names[1:]]
    tau = log.tau - np.column_stack([0.5 * motion.a[:, 0], np.zeros((200, 5))])
    fit = consistent(torque_regressor(ur10, make_log(ur10, motion, tau), effects))
    np.testing.assert_allclose(fit.pi, np.r_[standard_parameters(ur10), np.full(5, 0.5)], atol=1e-5)


def test_a_noisy_ur10_is_nearer_to_the_truth_than_weighted_least_squares(ur10, make_log, rng, all_possible):
    motion = Motion(np.arange(300) * 0.01, *rng.normal(size=(3, 300, 6)))
    tau = inverse_dynamics(ur10, motion)
    log = make_log(ur10, motion, tau + 5 * rng.normal(size=tau.shape))
    weighted, fit = (
        wls(torque_regressor(ur10, log)),
        consistent(torque_regressor(ur10, log), prior=4.0),
    )
    truth = fit.base.values(standard_parameters(ur10))
    size = np.linalg.cholesky(np.linalg.inv(weighted.cov)).T
    assert np.linalg.norm(size @ (fit.theta - truth)) < 0.8 * np.linalg.norm(size @ (weighted.theta - truth))
    assert all_possible(fit.pi[:60])


def test_a_strong_prior_keeps_the_given_bodies(arm, noisy):
    fit = consistent(torque_regressor(arm, noisy(3.0)), prior=1e10)
    np.testing.assert_allclose(fit.pi, standard_parameters(arm), atol=1e-3)


def test_a_prior_makes_deviations_smaller_and_a_weak_one_leaves_them(arm, noisy):
    log = noisy(3.0)
    weighted = wls(torque_regressor(arm, log))
    assert (consistent(torque_regressor(arm, log), prior=400.0).std() < weighted.std()).all()
    np.testing.assert_allclose(consistent(torque_regressor(arm, log), prior=1e-8).std(), weighted.std(), rtol=1e-3)


@pytest.mark.nightly
@pytest.mark.whole
def test_intervals_cover_the_truth_where_no_constraint_acts(swing, make_log, rubbing, friction, rng):
    # 95 % intervals of all base parameters over 200 draws of coloured noise; the columns are those of one motion.
    arm = load_robot(ROBOTS / "planar2.urdf")
    motion = swing(arm, 200)
    clean = rubbing(arm, motion)
    made = torque_regressor(arm, make_log(arm, motion, clean), friction(arm))
    truth, inside = None, []
    for _ in range(200):
        white = 0.02 * rng.normal(size=(202, 2))
        noisy = replace(made, logs=(make_log(arm, motion, clean + (white[2:] + white[1:-1] + white[:-2]) / 3),))
        vars(noisy)["W"] = made.W
        fit = consistent(noisy)
        truth = fit.base.values(np.r_[standard_parameters(arm), [0.4, 0.6] * 2]) if truth is None else truth
        assert fit.held == ()
        inside.append(np.abs(fit.theta - truth) < norm.ppf(0.975) * fit.std())
    assert 0.92 <= np.mean(inside) <= 0.98


def test_equations_of_the_gap_alone_are_refused(arm, noisy, friction):
    with pytest.raises(ParameterError, match="hold no rigid body: make them with torque_regressor"):
        consistent(gap_regressor(arm, noisy(0.1), friction(arm)))


def test_one_sample_is_refused(pendulum, swing, make_log):
    motion = swing(pendulum, 1)
    with pytest.raises(IdentifiabilityError, match="1 samples leave no equation to judge the noise by"):
        consistent(torque_regressor(pendulum, make_log(pendulum, motion, motion.q)))


def some_body(rng, principal):
    rotation = Rotation.random(rng=rng).as_matrix()
    return body_parameters(rng.uniform(0.5, 3), 0.3 * rng.normal(size=3), rotation @ np.diag(principal) @ rotation.T)


def test_the_pseudo_inertia_of_points_is_the_sum_of_their_outer_products(rng):
    # Oracle: its definition, and the inertia of points sum m (x.x 1 - x x^T).
    masses, points = rng.uniform(0.1, 1, 6), rng.normal(size=(6, 3))
    lifted = np.column_stack([points, np.ones(6)])
    center = masses @ points / masses.sum()
    away = points - center
    inertia = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(masses, away, strict=True))
    given = pseudo_inertia(body_parameters(masses.sum(), center, inertia))
    np.testing.assert_allclose(given, lifted.T * masses @ lifted, atol=1e-12)


def test_parameters_come_back_from_their_pseudo_inertia(rng):
    standard = rng.normal(size=10)
    np.testing.assert_allclose(standard_of(pseudo_inertia(standard)), standard, atol=1e-15)


@pytest.mark.parametrize(("principal", "possible"), [((1, 2, 2.9), True), ((1, 2, 3.1), False), ((-0.1, 2, 2), False)])
def test_the_pseudo_inertia_is_positive_exactly_where_principal_inertias_are_possible(rng, principal, possible):
    # Oracle: positive principal inertias that keep the triangle inequality (Wittenburg).
    standard = some_body(rng, principal)
    assert (np.linalg.eigvalsh(pseudo_inertia(standard))[0] > 0) == possible


def test_a_possible_body_is_its_own_reference(rng):
    standard = some_body(rng, (0.1, 0.12, 0.13))
    np.testing.assert_array_equal(reference_body(standard).standard, standard)


@pytest.mark.parametrize("broken", [body_parameters(2.0, np.array([0.3, 0, 0]), np.zeros((3, 3))), np.zeros(10)])
def test_a_point_and_a_body_of_nothing_get_a_possible_reference(broken):
    reference = reference_body(broken)
    assert np.linalg.eigvalsh(pseudo_inertia(reference.standard / reference.scale))[0] > 0


def test_the_reference_has_no_distance_to_itself_and_a_share_of_it_has_that_share_twice(rng):
    # The square root of the trace of (P0^-1 dP)^2 is s sqrt(4) for dP = s P0.
    reference = reference_body(some_body(rng, (0.1, 0.12, 0.13)))
    step = 0.05 * reference.standard / reference.scale
    assert np.linalg.norm(reference.metric @ step) == pytest.approx(0.1)


def test_a_reference_that_is_not_finite_is_refused():
    with pytest.raises(ParameterError, match="reference body are not finite"):
        reference_bodies(np.full(10, np.nan))


SHAPE = Shape(unknowns=3, bodies=(), inequalities=1)


def half_space(normal, least) -> list[np.ndarray]:
    """The point nearest to the origin with ``normal @ u >= least``."""
    return [np.array([normal]), np.array([least])]


@pytest.mark.parametrize(("normal", "least"), [([1.0, 0.0, 0.0], 2.0), ([3.0, 0.0, 4.0], 10.0)])
def test_the_numbers_are_those_of_the_call(normal, least):
    at, bound_multipliers, _, status = cone_program(SHAPE).solved(half_space(normal, least), 1e-10)
    wanted = least * np.array(normal) / np.dot(normal, normal)
    np.testing.assert_allclose(at, wanted, atol=1e-8)
    np.testing.assert_allclose(bound_multipliers, least / np.dot(normal, normal), rtol=1e-6)
    assert status == "optimal"


def test_what_was_solved_before_leaves_no_trace():
    # Oracle: the same call again; a solver that begins at the last solution ends at other digits.
    first = cone_program(SHAPE).solved(half_space([1.0, 2.0, 3.0], 1.0), 1e-7)[0]
    cone_program(SHAPE).solved(half_space([-5.0, 0.5, 1.0], 7.0), 1e-7)
    np.testing.assert_array_equal(cone_program(SHAPE).solved(half_space([1.0, 2.0, 3.0], 1.0), 1e-7)[0], first)


def test_a_shape_has_one_program():
    assert cone_program(SHAPE) is cone_program(Shape(3, (), 1))
