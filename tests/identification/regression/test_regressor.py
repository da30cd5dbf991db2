from dataclasses import replace

import numpy as np
import pytest

import identification.regression.regressor
from identification.data.log import Band, Log
from identification.data.signals import low_pass
from identification.regression.regressor import gap_regressor, known_torque, torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics, rigid_body_regressor, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.motion import Motion
from places import ROBOTS

UNFILTERED = Band(100.0, 50.0, np.ones(1), 1)


def some_log(robot, rng, samples=40, band=UNFILTERED, name="some") -> Log:
    motion = Motion(np.arange(samples) * 0.01, *rng.normal(size=(3, samples, robot.nv)))
    return Log(name, robot.joint_names, motion, inverse_dynamics(robot, motion), band, np.ones(samples, dtype=bool))


def test_the_given_parameters_solve_the_equations(arm, rng):
    # Oracle: pin.rnea, armature and modelled friction, through inverse_dynamics.
    regressor = torque_regressor(arm, some_log(arm, rng))
    np.testing.assert_allclose(regressor.W @ standard_parameters(arm), regressor.y, atol=1e-10)


def test_armature_is_known_and_no_part_of_the_rigid_body_columns(arm, rng):
    model = arm.model.copy()
    model.armature = np.array([0.1, 0.2, 0.3])
    heavier = replace(arm, model=model)
    log = some_log(arm, rng)
    expected = known_torque(arm, log.motion, rigid_body=True) + log.motion.a * [0.1, 0.2, 0.3]
    np.testing.assert_allclose(known_torque(heavier, log.motion, rigid_body=True), expected)


def test_the_model_leaves_no_gap_to_its_own_torque(arm, rng):
    regressor = gap_regressor(arm, some_log(arm, rng), [(effect_named("viscous_friction"), "turn")])
    np.testing.assert_allclose(regressor.y, 0.0, atol=1e-12)


def test_columns_are_named_by_body_then_by_joint_effect_and_coefficient(arm, rng):
    regressor = torque_regressor(arm, some_log(arm, rng), [(effect_named("viscous_friction"), "turn")])
    assert (regressor.names[0], regressor.names[19]) == ("column.m", "beam.Izz")
    assert (regressor.names[-1], regressor.units[-1]) == ("turn.viscous_friction.coefficient", "N m s/rad")


def test_an_effect_fills_the_row_of_its_joint_only(arm, rng):
    log = some_log(arm, rng)
    joint = arm.joint_names[1]
    column = torque_regressor(arm, log, [(effect_named("viscous_friction"), joint)]).W[:, :, -1]
    np.testing.assert_array_equal(column, np.column_stack([0 * log.motion.t, log.motion.v[:, 1], 0 * log.motion.t]))


def test_columns_and_torque_go_through_the_same_filter(arm, rng):
    # Oracle: the filter is linear, so that the given parameters solve the filtered equations.
    regressor = torque_regressor(arm, some_log(arm, rng, 300, low_pass(10.0, 100.0)))
    np.testing.assert_allclose(regressor.W @ standard_parameters(arm), regressor.y, atol=1e-10)


def test_blocks_are_the_whole_regressor_in_pieces(arm, rng, monkeypatch):
    band = low_pass(10.0, 100.0)
    logs = [some_log(arm, rng, 300, band), some_log(arm, rng, 250, band)]
    effects = [(effect_named("coulomb_friction"), "turn"), (effect_named("payload"), None)]
    whole = torque_regressor(arm, logs, effects).W
    monkeypatch.setattr(identification.regression.regressor, "WHOLE_LIMIT", 0)
    monkeypatch.setattr(identification.regression.regressor, "_BLOCK", 60)
    blocks = list(torque_regressor(arm, logs, effects).blocks())
    assert len(blocks) > len(logs)
    np.testing.assert_allclose(np.concatenate(blocks), whole, atol=1e-12)


def test_no_block_spans_two_logs(arm, rng):
    regressor = torque_regressor(arm, [some_log(arm, rng, 30), some_log(arm, rng, 20)])
    assert [len(block) for block in regressor.blocks()] == [30, 20]


def test_samples_that_are_not_valid_make_no_rows(arm, rng):
    log = some_log(arm, rng)
    valid = np.ones(40, dtype=bool)
    valid[10:15] = False
    full, cut = torque_regressor(arm, log), torque_regressor(arm, replace(log, valid=valid))
    np.testing.assert_array_equal(cut.W, full.W[valid])
    np.testing.assert_array_equal(cut.y, full.y[valid])


def test_one_sample_of_a_robot_with_one_joint_keeps_three_axes(rng):
    pendulum = load_robot(ROBOTS / "pendulum.urdf")
    assert torque_regressor(pendulum, some_log(pendulum, rng, 1)).W.shape == (1, 1, 10)


def test_a_shape_is_held_at_the_given_value(arm, rng):
    log = some_log(arm, rng)
    stribeck = effect_named("stribeck_friction")
    column = gap_regressor(arm, log, [(stribeck, "turn", (0.3,))]).W
    expected = stribeck.signature(arm, Operation.of(arm, log.motion), "turn", (0.3,)).columns
    np.testing.assert_array_equal(column[:, 0], expected[:, 0])


def test_a_shape_of_one_number_may_be_given_as_that_number(arm, rng):
    log, stribeck = some_log(arm, rng), effect_named("stribeck_friction")
    number, whole = (gap_regressor(arm, log, [(stribeck, "turn", shape)]) for shape in (0.3, (0.3,)))
    assert number.terms == whole.terms
    np.testing.assert_array_equal(number.W, whole.W)


def test_columns_that_follow_the_torque_are_made_of_the_given_models(arm, rng):
    # Closed form: what a lag of one second needs is the time derivative of the modelled torque.
    log = some_log(arm, rng)
    column = gap_regressor(arm, log, [(effect_named("actuator_lag"), "turn")]).W[:, 0, 0]
    np.testing.assert_allclose(column, np.gradient(inverse_dynamics(arm, log.motion)[:, 0], log.motion.t))


def test_an_effect_without_the_shape_it_needs_is_refused(arm, rng):
    asked = r"stribeck_friction is not linear .* give its shape as the third entry, .*, for instance \([\d.]+,\)\.$"
    with pytest.raises(ParameterError, match=asked):
        torque_regressor(arm, some_log(arm, rng), [(effect_named("stribeck_friction"), "turn")])


def test_a_log_of_another_robot_is_refused(arm, rng):
    log = replace(some_log(arm, rng), joint_names=("a", "b", "c"))
    with pytest.raises(LogError, match=r"some has the joints a, b, c and the robot turn, .*give the log of this robot"):
        torque_regressor(arm, log)


def test_a_log_without_a_valid_sample_is_refused(arm, rng):
    log = replace(some_log(arm, rng), valid=np.zeros(40, dtype=bool))
    with pytest.raises(LogError, match="No valid sample is left to fit: give a longer recording"):
        torque_regressor(arm, log)


def test_a_regressor_too_large_to_keep_says_so(arm, rng, monkeypatch):
    monkeypatch.setattr(identification.regression.regressor, "WHOLE_LIMIT", 10)
    with pytest.raises(ParameterError, match=r"go through blocks\(\) instead"):
        _ = torque_regressor(arm, some_log(arm, rng)).W


def test_the_motion_is_not_finite_is_refused(arm, rng):
    log = some_log(arm, rng)
    v = log.motion.v.copy()
    v[3, 1] = np.nan
    with pytest.raises(LogError, match="v of joint number 1 is not finite at sample 3"):
        _ = torque_regressor(arm, replace(log, motion=replace(log.motion, v=v))).W


def test_the_rigid_body_columns_are_those_of_pinocchio(arm, rng):
    log = some_log(arm, rng)
    np.testing.assert_array_equal(torque_regressor(arm, log).W, rigid_body_regressor(arm, log.motion))
