from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.estimators.weighted_least_squares import ols
from identification.experiments.cea_identification import (
    Conditions,
    equations,
    exciting_motion,
    identify,
    record,
    simulate_identification,
)
from identification.regression.regressor import torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.devices.cea import GRAVITY, INERTIAL, LinkLengths
from phantom_dyn.devices.cea_dynamics import NAMES, VALUES, regressor
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.catalogue import effect_named

SHORT = Conditions(duration=40.0)


@pytest.fixture(scope="module")
def result():
    return simulate_identification(np.random.default_rng(4))


def test_the_identification_has_the_published_15000_equations(result):
    assert result.fit.rows == pytest.approx(15000, rel=0.005)
    assert result.fit.names == tuple(INERTIAL)


def test_all_16_parameters_of_table_4_are_within_their_intervals(result):
    # Known truth: Table 4; 99.7 % for each of the 16.
    assert (np.abs(result.fit.theta - VALUES) < 3 * result.fit.std()).all()


def test_all_16_parameters_are_within_the_published_intervals(result):
    # Published: the relative deviations of Table 4, with the simulation's own added.
    published = np.array([parameter.std for parameter in INERTIAL.values()])
    assert (np.abs(result.fit.theta - VALUES) < 2 * np.hypot(published, result.fit.std())).all()


@pytest.mark.whole
def test_95_per_cent_intervals_hold_the_truth_in_about_95_per_cent_of_the_draws(rng):
    # Known truth; 12 recordings of 16 parameters each.
    inside = []
    for _ in range(12):
        fit = simulate_identification(rng, SHORT).fit
        inside.append(np.abs(fit.theta - VALUES) < 1.96 * fit.std())
    assert 0.90 < np.mean(inside) < 0.99


def test_without_noise_the_parameters_are_recovered(rng):
    # Known truth; what is left is the error of differentiating sampled triangles.
    fit = simulate_identification(rng, replace(SHORT, torque_noise=0.0, encoder_step=0.0)).fit
    np.testing.assert_allclose(fit.theta, VALUES, rtol=0.02)


def test_the_condition_number_is_no_worse_than_the_published_one(result):
    assert 10 < result.fit.condition < 60


def test_sines_alone_excite_friction_and_gravity_less(rng):
    # The source's reason for mixing: condition number of the friction and offset columns.
    motion = exciting_motion(SHORT, rng)
    slow = np.sin(2 * np.pi * np.outer(motion.t, [0.9, 1.1, 1.3]))
    sines = replace(motion, q=0.1 * slow, v=np.gradient(0.1 * slow, motion.t, axis=0), a=0 * slow)
    columns = [k for k, name in enumerate(NAMES) if name[0] in "FO" or name.startswith("M")]
    mixed, plain = (np.linalg.cond(regressor(m)[:, :, columns].reshape(-1, len(columns))) for m in (motion, sines))
    assert plain > 2 * mixed


def test_the_cross_test_error_is_that_of_the_noise(rng):
    # Known truth: torque noise of 0.05 N m at 200 Hz, of which a fifth lies below 20 Hz, over the torque of the motion.
    train, test = (record(exciting_motion(SHORT, rng), SHORT, rng) for _ in range(2))
    torque = equations(test, SHORT)[1]
    expected = 100 * 0.05 * np.sqrt(0.2) / np.sqrt(np.mean(torque**2, axis=0))
    np.testing.assert_allclose(identify(train, test, SHORT).cross_error, expected, rtol=0.1)


def test_the_cross_test_shows_a_wrong_direction_of_gravity(rng):
    train, test = (record(exciting_motion(SHORT, rng), SHORT, rng) for _ in range(2))
    right, wrong = (
        identify(train, test, replace(SHORT, gravity=gravity)).cross_error for gravity in (GRAVITY, (-9.81, 0.0, 0.0))
    )
    assert (wrong > 1.5 * right).any()


@pytest.fixture(scope="module")
def general():
    """All base parameters, friction and offsets by the general estimator on the projected tree, and their truth."""
    rng = np.random.default_rng(8)
    log = record(exciting_motion(SHORT, rng), SHORT, rng)
    robot = replace(load_robot("cea_branch"), viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))
    kinds = ("viscous_friction", "coulomb_friction", "torque_offset")
    fit = ols(
        torque_regressor(robot, log, [(effect_named(kind), joint) for joint in robot.joint_names for kind in kinds])
    )
    friction = [VALUES[NAMES.index(name)] for name in ("FV1", "FS1", "FV2R", "FS2", "OFF2", "FV5R", "FS5R", "OFF5")]
    friction.insert(2, 0.0)
    # The catalogue's offset is a torque that the drive cancels; that of the source is part of the drive's.
    signed = np.array(friction) * np.tile([1, 1, -1], 3)
    return fit, fit.base.values(np.concatenate([standard_parameters(robot), signed]))


def test_the_general_estimator_finds_all_base_parameters_within_their_intervals(general):
    # Known truth; 21 inertial parameters and 9 of friction and offset, four deviations.
    fit, truth = general
    assert fit.rank == 30
    assert (np.abs(fit.theta - truth) < 4 * fit.std()).all()


def test_what_table_4_leaves_out_has_a_large_relative_deviation_when_it_is_identified(general):
    # Published: that is how the source chose its 16.
    fit, truth = general
    missing = np.abs(truth) < 1e-9
    assert missing.sum() == 14
    assert fit.relative_std()[missing].min() > 25
    assert np.median(fit.relative_std()[~missing]) < 5


def test_the_parameters_are_recovered_with_other_link_lengths(rng):
    # Known truth; the lengths are not published, so that they are free.
    fit = simulate_identification(rng, replace(SHORT, lengths=LinkLengths(0.25, 0.2, 0.05))).fit
    assert (np.abs(fit.theta - VALUES) < 3.5 * fit.std()).all()


def test_the_summary_shows_every_parameter_the_condition_number_and_the_error_of_each_axis(result):
    text = result.summary()
    assert all(f"\n{name} " in text for name in NAMES)
    assert f"condition number {result.fit.condition:.1f}" in text
    assert text.endswith("q1 {:.2f} %, q2 {:.2f} %, q5 {:.2f} %".format(*result.cross_error))
