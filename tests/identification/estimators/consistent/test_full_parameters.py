from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.consistent.full_parameters import full_parameters, selection
from identification.estimators.weighted_least_squares import ols
from identification.regression.regressor import gap_regressor, torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion


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
    np.testing.assert_allclose(full_parameters(arm, fit).theta, fit.theta, atol=1e-8)


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
    assert 0 < np.abs(full.moved).max() < 5


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
