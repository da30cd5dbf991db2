from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.weighted_least_squares import irls, ols
from identification.regression.regressor import torque_regressor
from phantom_dyn.errors import EstimationError


@pytest.fixture
def spoilt(pendulum, swing, make_log, rubbing, rng):
    """5 % of the samples are off by up to 50 N m."""
    motion = swing(pendulum, 500)
    tau = rubbing(pendulum, motion) + 0.05 * rng.normal(size=(500, 1))
    tau[rng.choice(500, 25, replace=False)] += rng.uniform(20, 50, size=(25, 1))
    return make_log(pendulum, motion, tau)


def test_outliers_do_not_move_it(pendulum, spoilt, friction):
    fit = irls(torque_regressor(pendulum, spoilt, friction(pendulum)))
    np.testing.assert_allclose(fit.theta[-2:], [0.4, 0.6], atol=0.03)


def test_outliers_move_ordinary_least_squares(pendulum, spoilt, friction):
    # Or else the test before proves nothing.
    error = ols(torque_regressor(pendulum, spoilt, friction(pendulum))).theta[-2:] - [0.4, 0.6]
    assert np.abs(error).max() > 0.1


def test_its_noise_is_that_of_the_good_samples(pendulum, spoilt, friction):
    # The bad 5 % widen the median of the absolute residual by a tenth; least squares sees 8 N m.
    assert irls(torque_regressor(pendulum, spoilt, friction(pendulum))).sigma[0] == pytest.approx(0.05, rel=0.25)


def test_on_normal_noise_it_scatters_little_more_than_least_squares(pendulum, swing, make_log, rubbing, friction, rng):
    # Published: the loss is 95 % efficient, so that deviations are 1 / sqrt(0.95) times as large.
    motion = swing(pendulum, 2000)
    log = make_log(pendulum, motion, rubbing(pendulum, motion) + 0.1 * rng.normal(size=(2000, 1)))
    robust, ordinary = (
        irls(torque_regressor(pendulum, log, friction(pendulum))),
        ols(torque_regressor(pendulum, log, friction(pendulum))),
    )
    ratio = np.sqrt(np.diag(robust.cov_white) / np.diag(ordinary.cov_white))
    np.testing.assert_allclose(ratio, 1 / np.sqrt(0.95), rtol=0.03)


def test_without_noise_it_still_solves(arm, swing, make_log, rubbing, friction):
    motion = swing(arm, 200)
    fit = irls(torque_regressor(arm, make_log(arm, motion, rubbing(arm, motion)), friction(arm)))
    np.testing.assert_allclose(fit.theta[-6:], [0.4, 0.6] * 3, atol=1e-6)


def test_weights_that_do_not_settle_are_an_error(pendulum, spoilt, friction):
    with pytest.raises(EstimationError, match=r"weights did not settle within 1 iterations: look for a joint"):
        irls(torque_regressor(pendulum, spoilt, friction(pendulum)), iterations=1)


def test_as_many_equations_as_unknowns_give_no_uncertainty(pendulum, swing, make_log, rubbing):
    motion = swing(pendulum, 1)
    assert np.isnan(irls(torque_regressor(pendulum, make_log(pendulum, motion, rubbing(pendulum, motion)))).cov).all()
