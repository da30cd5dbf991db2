"""What a reader of a fit is warned of, on equations whose flaw is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

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
    assert "within its uncertainty: it may not be there" in said[0]


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
