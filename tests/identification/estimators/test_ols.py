"""Least squares: ordinary, weighted, iterated, cross-validated.

EMPS: the estimates that the authors of the benchmark publish, from their recording, with the band chosen by us.
"""

from pathlib import Path

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.signals import process
from identification.estimators.weighted_least_squares import irls, ols, wls
from identification.regression.base_parameters import base_parameters
from identification.regression.regressor import gap_regressor, torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import EstimationError, IdentifiabilityError, LogError
from phantom_dyn.model.robot import Robot
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


def test_an_effect_that_cannot_be_distinguished_from_a_link_is_named(pendulum, swing, make_log, rubbing):
    motion = swing(pendulum, 200)
    fit = ols(
        torque_regressor(
            pendulum, make_log(pendulum, motion, rubbing(pendulum, motion)), [(effect_named("rotor_inertia"), "pin")]
        )
    )
    expected = "Not separable from other parameters in this recording: pin.rotor_inertia.inertia"
    assert any(expected in warning for warning in fit.warnings)


def test_a_motion_at_rest_without_gravity_is_refused(pendulum, make_log):
    still = Motion(np.arange(50) * 0.01, *np.zeros((3, 50, 1)))
    log = make_log(pendulum, still, np.ones((50, 1)))
    with pytest.raises(IdentifiabilityError, match=r"excites none of the 1 parameters \(pin.viscous_friction.coeff"):
        ols(gap_regressor(pendulum, log, [(effect_named("viscous_friction"), "pin")]))


def test_as_many_equations_as_unknowns_give_no_uncertainty(pendulum, swing, make_log, rubbing):
    motion = swing(pendulum, 1)
    fit = ols(torque_regressor(pendulum, make_log(pendulum, motion, rubbing(pendulum, motion))))
    assert np.isnan(fit.cov).all()
    expected = "no more equations than unknowns, so that no uncertainty can be given"
    assert any(expected in warning for warning in fit.warnings)


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


@pytest.mark.parametrize("estimator", [wls, irls])
def test_without_noise_it_still_solves(arm, swing, make_log, rubbing, friction, estimator):
    motion = swing(arm, 200)
    fit = estimator(torque_regressor(arm, make_log(arm, motion, rubbing(arm, motion)), friction(arm)))
    np.testing.assert_allclose(fit.theta[-6:], [0.4, 0.6] * 3, atol=1e-6)


def test_too_few_samples_to_judge_the_noise_are_refused(pendulum, swing, make_log, rubbing):
    motion = swing(pendulum, 1)
    with pytest.raises(IdentifiabilityError, match="1 samples leave no equation to judge the noise by: record more"):
        wls(torque_regressor(pendulum, make_log(pendulum, motion, rubbing(pendulum, motion))))


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


def test_weights_that_do_not_settle_are_an_error(pendulum, spoilt, friction):
    with pytest.raises(EstimationError, match=r"weights did not settle within 1 iterations: look for a joint"):
        irls(torque_regressor(pendulum, spoilt, friction(pendulum)), iterations=1)


def test_iterated_weights_of_as_many_equations_as_unknowns_give_no_uncertainty(pendulum, swing, make_log, rubbing):
    motion = swing(pendulum, 1)
    assert np.isnan(irls(torque_regressor(pendulum, make_log(pendulum, motion, rubbing(pendulum, motion)))).cov).all()


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


def test_a_poor_condition_is_a_warning(arm, swing, make_log, rubbing):
    # A wiggle of a few hundredths hardly parts moments from inertias.
    motion = swing(arm, 300)
    small = type(motion)(motion.t, 0.02 * motion.q, 0.02 * motion.v, 0.02 * motion.a)
    fit = ols(torque_regressor(arm, make_log(arm, small, rubbing(arm, small))))
    assert any("small errors in the motion change the estimates a lot" in warning for warning in fit.warnings)


def test_a_motion_with_a_gap_in_its_numbers_cannot_be_predicted(arm, fitted, swing):
    motion = swing(arm, 10)
    broken = type(motion)(motion.t, np.where(motion.q > 0, np.nan, motion.q), motion.v, motion.a)
    with pytest.raises(LogError, match="is not finite at sample"):
        fitted[0].predict(arm, broken)


SYMMETRIC = [(effect_named(name), "axis") for name in ("viscous_friction", "coulomb_friction", "torque_offset")]
DIRECTIONAL = [(effect_named("direction_dependent_friction"), "axis")]


@pytest.fixture(scope="module")
def emps() -> Robot:
    return load_robot("emps")


@pytest.fixture(scope="module")
def recording(emps: Robot, data_folder: Path) -> Recording:
    data = np.load(data_folder / "emps" / "emps_train.npz")
    return Recording("emps", emps.joint_names, data["t"], data["q_meas"][:, None], data["force"][:, None])


@pytest.fixture(scope="module")
def log(emps: Robot, recording: Recording) -> Log:
    return process(recording, emps)


def test_the_published_mass_and_friction_come_back_within_half_a_per_cent(emps, log):
    # Published: M, Fv, Fc.
    theta = ols(torque_regressor(emps, log, SYMMETRIC)).theta
    np.testing.assert_allclose(theta[:3], [95.1089, 203.5034, 20.3935], rtol=0.005)


def test_the_published_offset_comes_back_within_0_2_newton(emps, log):
    # Published: -3.1648 N added to the force; our offset is the torque that the drive has to cancel.
    assert ols(torque_regressor(emps, log, SYMMETRIC)).theta[3] == pytest.approx(3.1648, abs=0.2)


def test_the_published_relative_error_comes_back_within_0_2_points(emps, log):
    assert ols(torque_regressor(emps, log, SYMMETRIC)).relative_error[0] == pytest.approx(4.0834, abs=0.2)


def test_the_published_direction_dependent_friction_comes_back_within_half_a_per_cent(emps, log):
    # Published: M, Fc+, Fc-, Fv+, Fv- in the order of our coefficients.
    theta = ols(torque_regressor(emps, log, DIRECTIONAL)).theta
    np.testing.assert_allclose(theta, [95.1540, 20.1440, 20.6277, 166.7061, 240.4236], rtol=0.005)


def test_the_published_error_of_direction_dependent_friction_comes_back_within_0_2_points(emps, log):
    assert ols(torque_regressor(emps, log, DIRECTIONAL)).relative_error[0] == pytest.approx(3.1117, abs=0.2)


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_a_band_one_fifth_off_changes_nothing_of_this(emps, recording, log, factor):
    other = process(recording, emps, cutoff_hz=factor * log.band.cutoff_hz)
    theta = ols(torque_regressor(emps, other, SYMMETRIC)).theta
    np.testing.assert_allclose(theta[:3], [95.1089, 203.5034, 20.3935], rtol=0.005)


def test_the_published_values_lie_within_two_deviations(emps, log):
    fit = wls(torque_regressor(emps, log, SYMMETRIC))
    assert np.all(np.abs(fit.theta - [95.1089, 203.5034, 20.3935, 3.1648]) < 2 * fit.std())
