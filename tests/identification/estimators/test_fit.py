from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.weighted_least_squares import ols
from identification.regression.regressor import gap_regressor, torque_regressor
from phantom_dyn.errors import LogError


@pytest.fixture
def fitted(arm, swing, make_log, rubbing, friction, rng):
    motion = swing(arm, 500)
    log = make_log(arm, motion, rubbing(arm, motion) + 0.1 * rng.normal(size=(500, 3)))
    return ols(torque_regressor(arm, log, friction(arm))), log


def test_it_predicts_the_torque_of_a_new_motion(arm, fitted, swing, rubbing):
    # Known truth: 800 samples, of which the fit has seen 500; its error is a fraction of the noise of 0.1.
    motion = swing(arm, 800)
    error = fitted[0].predict(arm, motion) - rubbing(arm, motion)
    assert np.sqrt(np.mean(error**2)) < 0.03


def test_a_fit_of_the_gap_adds_the_given_model_to_its_prediction(arm, swing, make_log, rubbing, friction):
    motion = swing(arm, 200)
    log = make_log(arm, motion, rubbing(arm, motion))
    fit = ols(gap_regressor(arm, log, friction(arm)))
    np.testing.assert_allclose(fit.predict(arm, motion), log.tau, atol=1e-9)


def test_the_relative_error_is_that_of_its_prediction(arm, fitted):
    fit, log = fitted
    error = np.linalg.norm(fit.predict(arm, log.motion) - log.tau, axis=0) / np.linalg.norm(log.tau, axis=0)
    np.testing.assert_allclose(fit.relative_error, 100 * error)


def test_the_relative_deviation_is_in_per_cent_of_the_value(fitted):
    fit = fitted[0]
    np.testing.assert_allclose(fit.relative_std() * np.abs(fit.theta), 100 * np.sqrt(np.diag(fit.cov)))


def test_a_poor_condition_is_a_warning(arm, swing, make_log, rubbing):
    # A wiggle of a few hundredths hardly parts moments from inertias.
    motion = swing(arm, 300)
    small = type(motion)(motion.t, 0.02 * motion.q, 0.02 * motion.v, 0.02 * motion.a)
    fit = ols(torque_regressor(arm, make_log(arm, small, rubbing(arm, small))))
    assert any("small errors in the motion move the estimates by much" in warning for warning in fit.warnings)


def test_the_summary_names_every_estimate_and_every_regrouping(fitted):
    fit = fitted[0]
    text = fit.summary()
    assert all(line in text for line in (*fit.names, *fit.base.regroupings()))


def test_a_motion_with_a_gap_in_its_numbers_cannot_be_predicted(arm, fitted, swing):
    motion = swing(arm, 10)
    broken = type(motion)(motion.t, np.where(motion.q > 0, np.nan, motion.q), motion.v, motion.a)
    with pytest.raises(LogError, match="is not finite at sample"):
        fitted[0].predict(arm, broken)
