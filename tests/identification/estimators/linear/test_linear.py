"""Linear fits: cautions and scatter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.engine.autocorrelation import integrated_autocorrelation_time
from identification.estimators.linear.least_squares import base_of, solve
from identification.estimators.linear.scatter import (
    autocorrelation,
    coloured_scatter,
    joint_noise,
    scatter_of_rows,
    white_scatter,
)
from identification.estimators.weighted_least_squares import ols, wls
from identification.regression.regressor import gap_regressor, torque_regressor
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import position_limits
from phantom_dyn.motion import Motion
from places import ROBOTS

VISCOUS, COULOMB, OFFSET = (
    effect_named(f"{name}") for name in ("viscous_friction", "coulomb_friction", "torque_offset")
)


def friction_fit(robot, log, *effects):
    return ols(gap_regressor(robot, log, [(effect, robot.joint_names[0]) for effect in effects]))


@pytest.fixture
def rubbing_by(pendulum, swing, make_log, rng):
    """A log of the pendulum with this much viscous and Coulomb friction, and noise of 0.1 N m."""

    def log(viscous: float, coulomb: float):
        motion = swing(pendulum, 400)
        tau = inverse_dynamics(pendulum, motion) + viscous * motion.v + coulomb * np.sign(motion.v)
        return make_log(pendulum, motion, tau + 0.1 * rng.normal(size=tau.shape))

    return log


def test_a_sound_fit_is_warned_of_nothing(pendulum, rubbing_by):
    assert friction_fit(pendulum, rubbing_by(0.4, 0.6), VISCOUS, COULOMB).warnings == ()


def test_friction_that_is_not_there_is_at_its_bound(pendulum, rubbing_by):
    # The gap is what the model has too much.
    said = friction_fit(pendulum, rubbing_by(0.4, -pendulum.coulomb_friction[0]), VISCOUS, COULOMB).warnings
    assert len(said) == 1
    assert "coulomb_friction.torque is" in said[0]
    assert "at its lower bound of" in said[0]
    assert "within its uncertainty: its effect may be absent" in said[0]


def test_friction_that_pushes_is_impossible(pendulum, rubbing_by):
    said = " ".join(friction_fit(pendulum, rubbing_by(-1.0, 0.6), VISCOUS, COULOMB).warnings)
    assert f"beyond its lower bound of {-pendulum.viscous_friction[0]:.4g}, which is impossible" in said
    assert "impossible: something that the model lacks takes its place" in said


def test_columns_that_hardly_differ_are_ill_conditioned_and_named(pendulum, make_log, rng):
    # Closed form: v = 1 + e w with w of unit size; the condition number of v and 1 is 2 / e.
    w = np.sin(np.arange(400) * 0.1)[:, None]
    v = 1.0 + 1e-4 * w
    motion = Motion(np.arange(400) * 0.01, np.cumsum(v, axis=0) * 0.01, v, np.zeros((400, 1)))
    tau = inverse_dynamics(pendulum, motion) + 1e-3 * rng.normal(size=(400, 1))
    fit = friction_fit(pendulum, make_log(pendulum, motion, tau), VISCOUS, OFFSET)
    assert fit.cond == pytest.approx(2 / (1e-4 * np.std(w)), rel=0.05)
    said = " ".join(fit.warnings)
    assert "The condition number is" in said
    assert "viscous_friction.coefficient, pin.torque_offset" in said or "torque_offset.torque, pin.viscous" in said


def test_a_joint_that_leans_on_its_stop_is_named(pendulum, swing, make_log):
    motion = swing(pendulum, 400)
    stop = position_limits(pendulum)[1][0]
    q, v, a = (np.array(x) for x in (motion.q, motion.v, motion.a))
    q[300:], v[300:], a[300:] = stop, 0.0, 0.0
    resting = Motion(motion.t, q, v, a)
    said = " ".join(
        friction_fit(pendulum, make_log(pendulum, resting, inverse_dynamics(pendulum, resting) + v), VISCOUS).warnings
    )
    assert f"pin rests at its upper limit of {stop:.4g} rad in 25 % of the samples" in said
    assert "leave these stretches out (--exclude) or record with less range" in said


def test_a_joint_that_passes_close_to_its_stop_is_not_named(pendulum, swing, make_log):
    motion = swing(pendulum, 400)
    stop = position_limits(pendulum)[1][0]
    scaled = Motion(motion.t, motion.q * stop / motion.q.max(), motion.v, motion.a)
    log = make_log(pendulum, scaled, inverse_dynamics(pendulum, scaled) + 0.4 * motion.v)
    assert not any("rests at" in said for said in friction_fit(pendulum, log, VISCOUS).warnings)


def test_a_joint_without_limits_has_no_stop_to_rest_at(pendulum, swing, make_log, tmp_path):
    (tmp_path / "robot.urdf").write_text((ROBOTS / "pendulum.urdf").read_text().replace("revolute", "continuous"))
    endless = load_robot(tmp_path / "robot.urdf")
    motion = swing(pendulum, 400)
    q, v, a = (np.array(x) for x in (motion.q, motion.v, motion.a))
    q[300:], v[300:], a[300:] = q[300], 0.0, 0.0
    resting = Motion(motion.t, q, v, a)
    log = make_log(endless, resting, inverse_dynamics(endless, resting) + v)
    assert not any("rests at" in said for said in friction_fit(endless, log, VISCOUS).warnings)


def test_a_drive_at_its_limit_is_named(pendulum, rubbing_by):
    log = rubbing_by(0.4, 0.6)
    limit = float(np.quantile(np.abs(log.tau), 0.9))
    weak = replace(pendulum, actuators=(replace(pendulum.actuators[0], torque_limit=limit),))
    clipped = replace(log, tau=np.clip(log.tau, -limit, limit))
    said = " ".join(friction_fit(weak, clipped, VISCOUS).warnings)
    assert f"the drive of pin is at its limit of {limit:.4g} N m in 10 % of the samples" in said


def test_a_torque_that_the_fit_misses_altogether_is_named(arm, swing, make_log, rng):
    # The noise of the turntable, a hundred times the torque of the others, is spread over all by a fit without weights.
    motion = swing(arm, 200)
    tau = inverse_dynamics(arm, motion)
    tau[:, 0] += 1e3 * np.abs(tau).max() * rng.normal(size=200)
    said = " ".join(ols(torque_regressor(arm, make_log(arm, motion, tau))).warnings)
    joints = [joint for joint in arm.joint_names[1:] if f"The fit misses the torque of {joint} by" in said]
    assert joints
    assert "check its sign and gain, or use an estimator that weighs joints by their noise" in said


def test_weights_that_settle_keep_a_loud_joint_from_spoiling_the_others(arm, swing, make_log, rng):
    # Known truth: without the settling, the others keep a share of the first fit's misfit for noise of their own.
    motion = swing(arm, 400)
    clean = inverse_dynamics(arm, motion)
    noise = np.array([100.0, 0.01, 0.01]) * rng.normal(size=clean.shape)
    sigma = wls(torque_regressor(arm, make_log(arm, motion, clean + noise))).sigma
    np.testing.assert_allclose(sigma, [100.0, 0.01, 0.01], rtol=0.15)


TRUTH = np.array([0.4, 0.6, -0.3])


def coverage(pendulum, motion, make_log, noise) -> tuple[float, float]:
    """Share of 95 % intervals that hold the truth: with the memory of the residual, and with the white formula."""
    effects = [(effect_named(f"{name}"), "pin") for name in ("viscous_friction", "coulomb_friction", "torque_offset")]
    clean = inverse_dynamics(pendulum, motion) + np.column_stack([motion.v, np.sign(motion.v), -motion.v**0]) @ [
        [0.4], [0.6], [-0.3]
    ]  # fmt: skip
    inside, white = [], []
    for draw in noise:
        fit = ols(gap_regressor(pendulum, make_log(pendulum, motion, clean + draw[:, None]), effects))
        error = np.abs(fit.theta - TRUTH)
        inside.append(error < 1.96 * fit.std())
        white.append(error < 1.96 * np.sqrt(np.diag(fit.cov_white)))
    return float(np.mean(inside)), float(np.mean(white))


@pytest.mark.whole
def test_intervals_hold_the_truth_in_95_per_cent_of_draws(pendulum, swing, make_log, rng):
    motion = swing(pendulum, 300)
    coloured, white = coverage(pendulum, motion, make_log, 0.2 * rng.normal(size=(200, 300)))
    assert 0.92 < white < 0.98
    assert 0.92 < coloured < 0.99


@pytest.mark.nightly
@pytest.mark.whole
def test_intervals_hold_the_truth_with_noise_that_has_a_memory(pendulum, swing, make_log, rng):
    # First-order autoregression with a memory of ten samples: the white formula is far off.
    motion = swing(pendulum, 600)
    noise = lfilter([1.0], [1.0, -0.9], 0.1 * rng.normal(size=(150, 1600)), axis=1)[:, 1000:]
    coloured, white = coverage(pendulum, motion, make_log, noise)
    assert coloured > 0.90
    assert white < 0.70


def test_the_correlation_factor_of_an_autoregression_is_the_closed_form(rng):
    # Closed form: (1 + a) / (1 - a).
    noise = lfilter([1.0], [1.0, -0.8], rng.normal(size=200_000))
    assert integrated_autocorrelation_time(autocorrelation(noise, (0, 200_000))) == pytest.approx(9.0, rel=0.1)


def test_the_correlation_factor_of_white_noise_is_one(rng):
    assert integrated_autocorrelation_time(autocorrelation(rng.normal(size=50_000), (0, 50_000))) == pytest.approx(
        1.0, abs=0.05
    )


def test_noise_that_alternates_is_not_called_better_than_white():
    noise = np.tile([1.0, -1.0], 500)
    assert integrated_autocorrelation_time(autocorrelation(noise, (0, 1000))) == 1.0


def test_recordings_do_not_remember_each_other():
    # Constant within each recording: the memory reaches over one recording, not over both.
    steps = np.repeat([1.0, -1.0], 100)
    assert len(autocorrelation(steps, (0, 100, 200))) <= 100


def test_the_noise_counts_the_equations_that_are_left_over():
    # Closed form: sum of squares over N minus the parameters used.
    assert joint_noise(np.full((10, 1), 2.0), np.array([6.0]))[0] == pytest.approx(np.sqrt(40 / 4))


def test_no_equation_left_over_means_unknown_noise():
    assert np.isnan(joint_noise(np.zeros((3, 1)), np.array([3.0]))[0])


def test_noise_without_a_memory_gives_the_white_scatter(arm, swing, make_log, rubbing, friction):
    # Closed form: Parseval; the sum over frequencies is the sum over samples.
    motion = swing(arm, 101)
    regressor = gap_regressor(arm, make_log(arm, motion, rubbing(arm, motion)), friction(arm))
    base = base_of(regressor)
    solution = solve(regressor, base, np.ones_like(regressor.y))
    scatter = np.array([1.0, 2.0, 3.0])
    coloured = coloured_scatter(regressor, base, solution, scatter, [np.ones(1)] * 3)
    np.testing.assert_allclose(coloured, white_scatter(solution, scatter), atol=1e-12)


def test_rows_without_a_memory_scatter_by_their_squares(rng):
    # Closed form: the sum over samples and joints of variance times x x^T.
    rows, scatter = rng.normal(size=(50, 2, 3)), np.array([1.0, 4.0])
    found = scatter_of_rows(rows, scatter, [np.ones(1)] * 2)
    np.testing.assert_allclose(found, np.einsum("j,njk,njl->kl", scatter, rows, rows), rtol=1e-12)
