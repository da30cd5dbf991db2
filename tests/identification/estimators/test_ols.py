from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.weighted_least_squares import ols
from identification.regression.base_parameters import base_parameters
from identification.regression.regressor import gap_regressor, torque_regressor
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import IdentifiabilityError
from phantom_dyn.motion import Motion


def test_without_noise_the_truth_comes_back(arm, swing, make_log, friction, rubbing):
    motion = swing(arm, 400)
    effects = friction(arm)
    log = make_log(arm, motion, rubbing(arm, motion))
    fit = ols(torque_regressor(arm, log, effects))
    truth = np.concatenate([standard_parameters(arm), [0.4, 0.6] * 3])
    np.testing.assert_allclose(fit.theta, base_parameters(torque_regressor(arm, log, effects)).values(truth), atol=1e-7)


def test_with_noise_the_truth_lies_within_four_deviations(arm, swing, make_log, friction, rubbing, rng):
    motion = swing(arm, 800)
    effects = friction(arm)
    log = make_log(arm, motion, rubbing(arm, motion) + 0.1 * rng.normal(size=(800, 3)))
    fit = ols(torque_regressor(arm, log, effects))
    truth = fit.base.values(np.concatenate([standard_parameters(arm), [0.4, 0.6] * 3]))
    assert np.all(np.abs(fit.theta - truth) < 4 * fit.std())


def test_one_parameter_is_the_closed_form(pendulum, swing, make_log, rubbing, rng):
    # Closed form: c = v.r / v.v and its deviation sigma / |v|.
    motion = swing(pendulum, 300)
    log = make_log(pendulum, motion, rubbing(pendulum, motion) + 0.1 * rng.normal(size=(300, 1)))
    regressor = gap_regressor(pendulum, log, [(effect_named("viscous_friction"), "pin")])
    fit = ols(regressor)
    v, r = motion.v[:, 0], regressor.y[:, 0]
    value = v @ r / (v @ v)
    sigma = np.sqrt(np.sum((r - v * value) ** 2) / 299)
    np.testing.assert_allclose([fit.theta[0], fit.sigma[0]], [value, sigma])
    np.testing.assert_allclose(fit.cov_white[0, 0], sigma**2 / (v @ v))


def test_the_noise_of_each_joint_is_found(arm, swing, make_log, rubbing, friction, rng):
    # Closed form: a deviation from 3000 samples has one of 1.3 per cent itself; four of these.
    motion = swing(arm, 3000)
    noise = np.array([0.3, 0.2, 0.1])
    log = make_log(arm, motion, rubbing(arm, motion) + noise * rng.normal(size=(3000, 3)))
    np.testing.assert_allclose(ols(torque_regressor(arm, log, friction(arm))).sigma, noise, rtol=0.052)


def test_several_logs_are_fitted_together(arm, swing, make_log, rubbing, friction):
    motion = swing(arm, 400)
    tau = rubbing(arm, motion)
    whole = ols(torque_regressor(arm, make_log(arm, motion, tau), friction(arm)))
    parts = [
        make_log(arm, Motion(motion.t[s], motion.q[s], motion.v[s], motion.a[s]), tau[s])
        for s in (slice(0, 150), slice(150, 400))
    ]
    np.testing.assert_allclose(ols(torque_regressor(arm, parts, friction(arm))).theta, whole.theta, atol=1e-8)


def test_an_effect_that_cannot_be_told_from_a_link_is_named(pendulum, swing, make_log, rubbing):
    motion = swing(pendulum, 200)
    fit = ols(
        torque_regressor(
            pendulum, make_log(pendulum, motion, rubbing(pendulum, motion)), [(effect_named("rotor_inertia"), "pin")]
        )
    )
    assert "Not separable from other parameters in this recording: pin.rotor_inertia.inertia" in fit.summary()


def test_a_motion_at_rest_without_gravity_is_refused(pendulum, make_log):
    still = Motion(np.arange(50) * 0.01, *np.zeros((3, 50, 1)))
    log = make_log(pendulum, still, np.ones((50, 1)))
    with pytest.raises(IdentifiabilityError, match=r"excites none of the 1 parameters \(pin.viscous_friction.coeff"):
        ols(gap_regressor(pendulum, log, [(effect_named("viscous_friction"), "pin")]))


def test_as_many_equations_as_unknowns_give_no_uncertainty(pendulum, swing, make_log, rubbing):
    motion = swing(pendulum, 1)
    fit = ols(torque_regressor(pendulum, make_log(pendulum, motion, rubbing(pendulum, motion))))
    assert np.isnan(fit.cov).all()
    assert "no more equations than unknowns, so that no uncertainty can be given" in fit.summary()
