from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.weighted_least_squares import ols, wls
from identification.regression.regressor import torque_regressor
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.errors import IdentifiabilityError


def test_with_one_joint_it_is_ordinary_least_squares(pendulum, swing, make_log, rubbing, friction, rng):
    motion = swing(pendulum, 300)
    log = make_log(pendulum, motion, rubbing(pendulum, motion) + 0.1 * rng.normal(size=(300, 1)))
    ordinary, weighted = (
        ols(torque_regressor(pendulum, log, friction(pendulum))),
        wls(torque_regressor(pendulum, log, friction(pendulum))),
    )
    np.testing.assert_allclose(weighted.theta, ordinary.theta, rtol=1e-9)
    np.testing.assert_allclose(weighted.cov, ordinary.cov, rtol=1e-9)


def test_with_equal_residuals_it_is_ordinary_least_squares(arm, swing, make_log, rubbing, friction, rng):
    motion = swing(arm, 400)
    noise = rng.normal(size=(400, 3))
    effects = friction(arm)
    flat = ols(torque_regressor(arm, make_log(arm, motion, rubbing(arm, motion) + 0.01 * noise), effects))
    # Each joint's noise is scaled until the first fit sees the same deviation on all of them.
    for _ in range(20):
        noise = noise / flat.sigma
        flat = ols(torque_regressor(arm, make_log(arm, motion, rubbing(arm, motion) + 0.01 * noise), effects))
    weighted = wls(torque_regressor(arm, make_log(arm, motion, rubbing(arm, motion) + 0.01 * noise), effects))
    np.testing.assert_allclose(weighted.theta, flat.theta, atol=1e-6)


def test_it_scatters_less_than_ordinary_least_squares_where_noise_differs(arm, swing, make_log, rubbing, friction, rng):
    # Gauss-Markov: with the noise known up to its estimate, the weighted estimate is the better one.
    motion = swing(arm, 300)
    clean = rubbing(arm, motion)
    effects = friction(arm)
    errors = {ols: [], wls: []}
    for _ in range(15):
        log = make_log(arm, motion, clean + np.array([1.0, 0.01, 0.1]) * rng.normal(size=clean.shape))
        for fit_with, out in errors.items():
            fit = fit_with(torque_regressor(arm, log, effects))
            truth = fit.base.values(np.concatenate([standard_parameters(arm), [0.4, 0.6] * 3]))
            out.append((fit.theta - truth)[-4:])
    ordinary, weighted = (np.sqrt(np.mean(np.square(e))) for e in errors.values())
    assert weighted < 0.7 * ordinary


def test_without_noise_it_still_solves(arm, swing, make_log, rubbing, friction):
    motion = swing(arm, 200)
    fit = wls(torque_regressor(arm, make_log(arm, motion, rubbing(arm, motion)), friction(arm)))
    np.testing.assert_allclose(fit.theta[-6:], [0.4, 0.6] * 3, atol=1e-6)


def test_too_few_samples_to_judge_the_noise_are_refused(pendulum, swing, make_log, rubbing):
    motion = swing(pendulum, 1)
    with pytest.raises(IdentifiabilityError, match="1 samples leave no equation to judge the noise by: record more"):
        wls(torque_regressor(pendulum, make_log(pendulum, motion, rubbing(pendulum, motion))))
