from __future__ import annotations

import numpy as np
import pytest

from identification.experiments.parallelogram_friction import (
    MOVING,
    Friction,
    fit_friction_test,
    friction_test_motion,
    loop_friction,
    passive_friction,
)
from phantom_dyn import load_robot
from phantom_dyn.devices.cea import FRICTION_TESTS
from phantom_dyn.devices.cea_dynamics import NAMES, VALUES, regressor
from phantom_dyn.dynamics.tree_motion import joint_velocity
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.motion import Motion

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
