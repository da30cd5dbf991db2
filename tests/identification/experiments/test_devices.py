"""Experiments on devices: CEA branch, parallelogram."""

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
from identification.experiments.parallelogram_friction import (
    MOVING,
    Friction,
    fit_friction_test,
    friction_test_motion,
    loop_friction,
    passive_friction,
)
from identification.regression.regressor import torque_regressor
from phantom_dyn.devices.cea import FRICTION_TESTS, GRAVITY, INERTIAL, LinkLengths
from phantom_dyn.devices.cea_dynamics import NAMES, VALUES, regressor
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.dynamics.tree_motion import joint_velocity
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

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


@pytest.mark.nightly
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
    relative = 100 * fit.std() / np.abs(fit.theta)
    assert relative[missing].min() > 25
    assert np.median(relative[~missing]) < 5


def test_the_parameters_are_recovered_with_other_link_lengths(rng):
    # Known truth; the lengths are not published, so that they are free.
    fit = simulate_identification(rng, replace(SHORT, lengths=LinkLengths(0.25, 0.2, 0.05))).fit
    assert (np.abs(fit.theta - VALUES) < 3.5 * fit.std()).all()


def test_the_summary_shows_every_parameter_the_condition_number_and_the_error_of_each_axis(result):
    text = result.summary()
    assert all(f"\n{name} " in text for name in NAMES)
    assert f"condition number {result.fit.condition:.1f}" in text
    assert text.endswith("q1 {:.2f} %, q2 {:.2f} %, q5 {:.2f} %".format(*result.cross_error))


ARM, FOREARM = Friction(0.021, 0.120), Friction(0.018, 0.120)  # published: test t1 of Table 3

NOISE = 0.02

FRICTIONLESS = np.where([name.startswith(("FV", "FS")) for name in NAMES], 0.0, VALUES)


def measured(test, passive: Friction, rng, noise=NOISE) -> tuple[Motion, np.ndarray]:
    """Torque of the branch in a test: inertia, gravity, offsets and friction, the last by (16) and (17)."""
    motion = friction_test_motion(test)
    tau = regressor(motion) @ FRICTIONLESS + noise * rng.normal(size=motion.q.shape)
    tau[:, 1:] += np.stack(
        loop_friction(motion.v[:, 1], motion.v[:, 2], arm=ARM, forearm=FOREARM, passive=passive), axis=1
    )
    return motion, tau


def all_tests(passive: Friction, rng):
    return {test: fit_friction_test(test, *measured(test, passive, rng)) for test in MOVING}


def test_the_identities_are_the_friction_of_every_joint_projected_on_the_motors(rng):
    # Oracle: virtual work on the closed chain; (16), (17), 3R = 3 + 6 and 5R = 5 + 4.
    robot = load_robot("cea_branch")
    motion = Motion(np.zeros(50), *rng.normal(size=(3, 50, 3)))
    each = {name: Friction(*rng.uniform(0.01, 0.2, 2)) for name in ("q2", "q3", "q4", "q5", "q6")}
    tau = np.zeros((50, 3))
    for name, friction in each.items():
        v, shown = joint_velocity(robot, motion, name)
        tau += friction.torque(v)[:, None] * shown
    both = [
        Friction(each[a].viscous + each[b].viscous, each[a].coulomb + each[b].coulomb)
        for a, b in (("q5", "q4"), ("q3", "q6"))
    ]
    found = loop_friction(motion.v[:, 1], motion.v[:, 2], arm=each["q2"], forearm=both[0], passive=both[1])
    np.testing.assert_allclose(np.stack(found, axis=1), tau[:, 1:], atol=1e-14)
    np.testing.assert_array_equal(tau[:, 0], 0)


def test_equal_speeds_hide_the_passive_joints():
    v = np.linspace(-1, 1, 11)
    tau2, tau5 = loop_friction(v, v, arm=ARM, forearm=FOREARM, passive=Friction(1.0, 1.0))
    np.testing.assert_array_equal(tau2, ARM.torque(v))
    np.testing.assert_array_equal(tau5, FOREARM.torque(v))


@pytest.mark.parametrize(("test", "held"), [("t1", [0]), ("t2", [0, 2]), ("t3", [0, 1])])
def test_joints_outside_a_test_hold_still(test, held):
    motion = friction_test_motion(test)
    assert not motion.v[:, held].any()
    assert motion.v.any(axis=0).sum() == 3 - len(held)


def test_in_t1_both_joints_move_alike():
    motion = friction_test_motion("t1")
    np.testing.assert_array_equal(motion.v[:, 1], motion.v[:, 2])


def test_friction_without_noise_is_found_under_gravity_inertia_and_offset(rng):
    # Known truth; what a test shows beside friction is in its nuisances.
    fits = fit_friction_test("t1", *measured("t1", Friction(), rng, noise=0.0))
    np.testing.assert_allclose(fits[1].theta, [ARM.viscous, ARM.coulomb], rtol=1e-9)
    np.testing.assert_allclose(fits[2].theta, [FOREARM.viscous, FOREARM.coulomb], rtol=1e-9)


@pytest.mark.parametrize("test", MOVING)
def test_gravity_centrifugal_torque_and_offset_leave_nothing_at_constant_speed(test, rng):
    # Closed form: the nuisances are all that rigid bodies do while one joint, or two alike, move steadily.
    fits = fit_friction_test(test, *measured(test, Friction(), rng, noise=0.0))
    assert all(fit.sigma < 1e-11 for fit in fits.values())


def test_t1_finds_the_active_joints_whatever_the_passive_ones_do(rng):
    # Published values as truth; three deviations.
    fits = fit_friction_test("t1", *measured("t1", Friction(0.01, 0.05), rng))
    for joint in (1, 2):
        for name in fits[joint].names:
            value, std = fits[joint].value(name)
            assert abs(value - FRICTION_TESTS[name].value) < 3 * std


def test_t2_and_t3_find_the_active_and_the_passive_joints_together(rng):
    # Known truth: F2 + F3R and F5R + F3R.
    fits = all_tests(Friction(0.005, 0.03), rng)
    for fit, truth in ((fits["t2"][1], (0.026, 0.150)), (fits["t3"][2], (0.023, 0.150))):
        assert (np.abs(fit.theta - truth) < 3 * fit.std()).all()


def test_the_unknowns_are_named_as_in_table_3(rng):
    fits = all_tests(Friction(), rng)
    named = [name for test in fits.values() for fit in test.values() for name in fit.names]
    assert named == ["FV2t1", "FC2t1", "FV5t1", "FC5t1", "FV2t2", "FC2t2", "FV5t3", "FC5t3"]
    assert set(named) < set(FRICTION_TESTS)


def test_the_condition_number_is_about_the_published_6(rng):
    for fit in fit_friction_test("t1", *measured("t1", Friction(), rng)).values():
        assert 4 < fit.condition < 8


def test_a_sine_excites_friction_less_than_triangles_of_several_speeds():
    # The source's reason for triangles: the condition number of velocity and sign.
    triangles = np.concatenate([np.repeat([s, -s], 100) for s in (0.1, 0.2, 0.4, 0.8)])
    sine = 0.4 * np.sin(2 * np.pi * np.arange(0.5, 200) / 200)
    steady, swinging = (np.linalg.cond(np.stack([v, np.sign(v)], axis=1)) for v in (triangles, sine))
    assert swinging > 1.5 * steady


def test_friction_of_the_passive_joints_is_found(rng):
    # Known truth.
    found = passive_friction(all_tests(Friction(0.01, 0.02), rng))
    for (value, std), truth in zip(found.values(), (0.01, 0.02), strict=True):
        assert abs(value - truth) < 3 * std
        assert value > 5 * std


def test_passive_joints_without_friction_are_within_their_deviation_of_zero(rng):
    for value, std in passive_friction(all_tests(Friction(), rng)).values():
        assert abs(value) < 3 * std


def test_one_speed_hardly_parts_viscous_from_coulomb_friction(rng):
    motion = friction_test_motion("t2", speeds=(0.4,))
    one = fit_friction_test("t2", motion, rng.normal(size=motion.q.shape))[1]
    several = fit_friction_test("t2", *measured("t2", Friction(), rng))[1]
    assert one.scaled_condition > 10 * several.scaled_condition


def test_a_joint_that_does_not_move_is_refused():
    motion = friction_test_motion("t2")
    with pytest.raises(LogError, match="Joint 5 in test t3: no constant speed was recorded: move the joint"):
        fit_friction_test("t3", motion, np.zeros(motion.q.shape))


def test_an_unknown_test_is_refused():
    with pytest.raises(ParameterError, match="no friction test 't4': take one of t1, t2, t3"):
        friction_test_motion("t4")
