"""Base parameters of the CEA branch, a closed chain, beside those of its source."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import identification.regression.regressor
from identification.data.log import Band, Log
from identification.data.signals import low_pass
from identification.regression.base_parameters import BaseParameters, base_parameters_of_matrix
from identification.regression.regressor import gap_regressor, known_torque, torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.devices.cea import INERTIAL, LENGTHS
from phantom_dyn.dynamics.dynamics import inverse_dynamics, rigid_body_regressor, standard_parameters
from phantom_dyn.dynamics.tree_motion import joint_velocity
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.inertia import STANDARD_NAMES, STANDARD_UNITS
from phantom_dyn.model.robot import Robot
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


# Names of the source for Pinocchio's ten parameters, whose order and signs are the same.
KHALIL = dict(zip(STANDARD_NAMES, ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ"), strict=True))
INERTIAL_NAMES = [f"{name}{link}" for link in range(1, 7) for name in KHALIL.values()]

# Known regroupings of this device (symbolic, from the constraint equations); all other base parameters stand alone.
REGROUPINGS = """
ZZ1R = ZZ1 + Ia1 + YY2 + YY3 + XX4 + YY5 + YY6 + d3^2 M3 + (d3^2+d4^2) M4 + d6^2 M6
MY1R = MY1 + MZ2 + MZ3 + MZ4 + MZ5 + MZ6
XX2R = XX2 - YY2 + XX6 - YY6 - d3^2 M3 - d3^2 M4
XY2R = XY2 + XY6
YZ2R = YZ2 + YZ6
XZ2R = XZ2 + XZ6 - d3 MZ3 - d3 MZ4
ZZ2R = ZZ2 + Ia2 + ZZ6 + d3^2 M3 + d3^2 M4
MX2R = MX2 + MX6 + d3 M3 + d3 M4
XX3R = XX3 - YY3 + XX5 - YY5 - d4^2 M4 - d6^2 M6
XY3R = XY3 + XY5
YZ3R = YZ3 + YZ5
XZ3R = XZ3 + XZ5 - d4 MZ4 - d6 MZ6
ZZ3R = ZZ3 + ZZ5 + Ia5 + d4^2 M4 + d6^2 M6
MX3R = MX3 + d4 M4 + d6/d3 MX6
MX5R = MX5 + d6 M6 - d6/d3 MX6
FV5R = FV5 + FV4
FS5R = FS5 + FS4
"""

# Section V.D: 20 inertial parameters and 9 of friction and offset.
PUBLISHED = (
    "ZZ1 MX1 MY1 XX2 XY2 XZ2 YZ2 ZZ2 MX2 MY2 XX3 XY3 XZ3 YZ3 ZZ3 MX3 MY3 MX5 MY5 MY6 "
    "FV1 FS1 OFF1 FV2 FS2 OFF2 FV5 FS5 OFF5"
).split()


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("cea_branch")


def columns(robot: Robot, rng, gravity=(0.0, -9.81, 0.0)) -> tuple[np.ndarray, list[str], list[str]]:
    """60 inertial columns, rotor inertias, friction and offset of the active joints, friction of q3 and q4."""
    turned = replace(robot)
    turned.model.gravity = pin.Motion(np.array(gravity), np.zeros(3))
    N = 200
    motion = Motion(np.arange(N) * 0.01, *rng.uniform(-2, 2, (3, N, 3)))
    parts = [rigid_body_regressor(turned, motion)]
    names, units = list(INERTIAL_NAMES), list(STANDARD_UNITS * 6)
    for row, joint in enumerate(robot.joint_names):
        v, a = motion.v[:, row], motion.a[:, row]
        part = np.zeros((N, 3, 4))
        part[:, row] = np.stack([a, v, np.sign(v), np.ones(N)], axis=1)
        parts.append(part)
        names += [f"{kind}{joint[1]}" for kind in ("Ia", "FV", "FS", "OFF")]
        units += ["kg m^2", "N m s/rad", "N m", "N m"]
    for joint in ("q3", "q4"):
        v, shown = joint_velocity(robot, motion, joint)
        parts.append(np.stack([v, np.sign(v)], axis=1)[:, None, :] * shown[:, :, None])
        names += [f"FV{joint[1]}", f"FS{joint[1]}"]
        units += ["N m s/rad", "N m"]
    W = np.concatenate(parts, axis=2)
    return W.reshape(-1, W.shape[2]), names, units


def base_of(robot: Robot, rng, gravity=(0.0, -9.81, 0.0), count: int | None = None) -> BaseParameters:
    W, names, units = columns(robot, rng, gravity)
    return base_parameters_of_matrix(W[:, :count], names[:count], units[:count])


def terms(text: str) -> dict[str, float]:
    """Coefficients of the right-hand side of a regrouping."""
    d3, d4, d6 = LENGTHS.d3, LENGTHS.d4, LENGTHS.d6
    known = {"d3^2": d3**2, "d4^2": d4**2, "d6^2": d6**2, "(d3^2+d4^2)": d3**2 + d4**2, "d6/d3": d6 / d3}
    known |= {"d3": d3, "d4": d4, "d6": d6, "": 1.0}
    out = {}
    for sign, factor, name in re.findall(r"(?:^|(?<= ))([+-]?) ?(?:(\S+) )?([A-Z][A-Za-z]+\d)(?= |$)", text):
        out[name] = (-1 if sign == "-" else 1) * (known[factor] if factor in known else float(factor))
    return out


def test_there_are_76_columns(robot, rng):
    assert columns(robot, rng)[0].shape[1] == 76


@pytest.mark.parametrize(
    ("gravity", "inertial", "everything"),
    [
        ((0.0, 0.0, -9.81), 19, 30),  # axis 1 vertical
        ((0.0, -9.81, 0.0), 21, 32),
        ((-9.81, 0.0, 0.0), 21, 32),
        ((3.0, -5.0, -7.0), 21, 32),
    ],
)
def test_the_number_of_base_parameters_depends_on_whether_axis_1_is_vertical(robot, rng, gravity, inertial, everything):
    assert base_of(robot, rng, gravity, 60).rank == inertial
    assert base_of(robot, rng, gravity).rank == everything


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (0.0, -9.81, 0.0)])
def test_the_rank_is_that_of_the_singular_values(robot, rng, gravity):
    # Oracle: NumPy; a wide gap lies between the smallest that count and rounding.
    W = columns(robot, rng, gravity)[0]
    norms = np.linalg.norm(W, axis=0)
    s = np.linalg.svd(W[:, norms > 1e-9] / norms[norms > 1e-9], compute_uv=False)
    rank = base_of(robot, rng, gravity).rank
    assert s[rank - 1] > 1e-3
    assert s[rank] < 1e-13


def test_the_printed_regroupings_are_the_known_ones(robot, rng):
    known = dict(line.split(" = ") for line in REGROUPINGS.strip().splitlines())
    printed = dict(line.split(" = ") for line in base_of(robot, rng).regroupings())
    assert printed.keys() == known.keys()
    for name, text in printed.items():
        assert terms(text) == pytest.approx(terms(known[name]), rel=1e-5), name


def test_the_base_parameters_are_the_known_ones(robot, rng):
    alone = {"MX1", "MY2", "MY3", "MY4", "MY5", "MY6", "FV1", "FS1", "OFF1", "FV2", "FS2", "OFF2", "OFF5", "FV3", "FS3"}
    regrouped = {line.split(" = ")[0] for line in REGROUPINGS.strip().splitlines()}
    assert set(base_of(robot, rng).base_names) == alone | regrouped


def test_the_published_list_lacks_my4_and_the_friction_of_joint_3(robot, rng):
    kept = {name.removesuffix("R") for name in base_of(robot, rng).base_names}
    assert len(PUBLISHED) == 20 + 9
    assert kept - set(PUBLISHED) == {"MY4", "FV3", "FS3"}
    assert set(PUBLISHED) < kept


def test_the_claim_that_link_4_regroups_with_link_1_does_not_hold_for_my4(robot, rng):
    # The source regroups all of link 4; a radial first moment turns with gravity and regroups into nothing.
    W, names, _ = columns(robot, rng)
    at = [names.index(name) for name in names[:60] if name != "MY4"]
    without = np.linalg.matrix_rank(W[:, at], tol=1e-9)
    assert np.linalg.matrix_rank(W[:, :60], tol=1e-9) == without + 1


def test_without_my4_the_20_published_inertial_parameters_are_a_base(robot, rng):
    W, names, units = columns(robot, rng)
    at = [k for k, name in enumerate(names[:60]) if name != "MY4"]
    base = base_parameters_of_matrix(W[:, at], [names[k] for k in at], [units[k] for k in at])
    assert {base.names[k] for k in base.independent} == set(PUBLISHED[:20])


def test_rotor_inertias_add_no_rank(robot, rng):
    base = base_of(robot, rng)
    assert {"Ia1", "Ia2", "Ia5"} <= {base.names[k] for k in base.dependent}


def test_friction_of_joint_6_is_that_of_joint_3(robot, rng):
    # They turn at opposite speeds: the same torque on the motors.
    motion = Motion(np.zeros(30), *rng.normal(size=(3, 30, 3)))
    (v3, shown3), (v6, shown6) = (joint_velocity(robot, motion, name) for name in ("q3", "q6"))
    np.testing.assert_allclose(np.sign(v3)[:, None] * shown3, np.sign(v6)[:, None] * shown6)


def test_the_robot_file_has_the_inertial_base_parameters_of_table_4_and_no_others(robot, rng):
    # Published values; what Table 4 leaves out is zero.
    W, names, units = columns(robot, rng)
    base = base_parameters_of_matrix(W[:, :60], names[:60], units[:60])
    values = dict(zip(base.base_names, base.values(standard_parameters(robot)), strict=True))
    wanted = {name: INERTIAL[name].value if name in INERTIAL else 0.0 for name in values}
    assert sum(value != 0 for value in wanted.values()) == 8
    assert values == pytest.approx(wanted, abs=1e-12)
