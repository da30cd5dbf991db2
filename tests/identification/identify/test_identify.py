"""Identification of a robot whose truth is known: values, deviations, errors, models.

Oracle: the robot that made the recording.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from identification.identify.hold_out import split_logs
from identification.identify.identified_model import JointTerms, effects_of, without_estimated
from identification.identify.identify import identify
from identification.regression.base_parameters import base_parameters
from identification.regression.regressor import torque_regressor
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.loading import load_robot


def test_friction_of_every_joint_comes_back(found, truth):
    values = {(p.joint, p.effect): p for p in found.others}
    for joint, viscous, coulomb in zip(truth.joint_names, truth.viscous_friction, truth.coulomb_friction, strict=True):
        for effect, wanted in (("viscous_friction", viscous), ("coulomb_friction", coulomb)):
            parameter = values[joint, effect]
            # A step of friction lasts the filter's kernel, which leaves a thousandth.
            assert parameter.value == pytest.approx(wanted, abs=4 * parameter.std + 2e-3 * wanted)


def test_base_parameters_of_the_links_come_back(found, arm, truth, recorded):
    fitted = without_estimated(arm, JointTerms())
    log = split_logs(arm, (recorded(truth),)).train[0]
    base = base_parameters(torque_regressor(fitted, log, effects_of(arm, JointTerms())))
    everything = np.concatenate([standard_parameters(truth), np.zeros(len(base.names) - 30)])
    wanted = dict(zip(base.base_names, base.values(everything), strict=True))
    assert {parameter.name for parameter in found.base} <= set(wanted)
    assert len(found.base) > 10
    for parameter in found.base:
        size = 4 * parameter.std + 2e-3 * abs(wanted[parameter.name])
        assert parameter.value == pytest.approx(wanted[parameter.name], abs=size), parameter.name


def test_offsets_that_are_not_there_are_not_told_from_zero(found):
    offsets = [p for p in found.others if p.effect == "torque_offset"]
    assert len(offsets) == 3
    assert sum(not p.identified for p in offsets) >= 2  # one in twenty is, by chance
    assert all("not distinguished from zero: its size is below" in p.why for p in offsets if not p.identified)


def test_the_fit_predicts_held_out_torques_much_better_than_the_given_model(found, arm):
    assert tuple(joint.joint for joint in found.joints) == arm.joint_names
    for joint in found.joints:
        assert joint.relative < 0.02
        assert joint.relative < 0.2 * joint.given


def test_the_full_model_needs_the_torques_of_the_fit(found):
    sizes = np.sqrt(np.mean(found.evidence.measured**2, axis=0))
    assert (np.array(found.departure) < 1e-3 * sizes).all()


def test_the_written_urdf_is_the_true_robot(found, truth, tmp_path, recorded):
    file = tmp_path / "corrected.urdf"
    file.write_text(found.exports[0].text)
    again, motion = load_robot(file), split_logs(truth, (recorded(truth, seed=5),)).train[0].motion
    wanted = inverse_dynamics(truth, motion)
    off = inverse_dynamics(again, motion) - wanted
    assert (np.sqrt(np.mean(off**2, axis=0)) < 5e-3 * np.sqrt(np.mean(wanted**2, axis=0))).all()


def test_both_files_were_loaded_again(found):
    assert [export.file for export in found.exports] == ["corrected.urdf", "corrected.xml"]
    for export in found.exports:
        assert export.difference <= export.tolerance
        assert export.loaded_with.split()[0] in ("Pinocchio", "MuJoCo")


def test_what_no_format_says_is_listed(found):
    urdf, mjcf = (" ".join(export.left_out) for export in found.exports)
    assert "no place for constant torques, positive along the joint [N m or N]: turn" in urdf
    assert "set qfrc_applied" in mjcf


def test_rank_and_what_it_could_be_agree_where_everything_moves(found):
    assert found.rank == found.excitable == len(found.base) + len(found.others)


def test_a_joint_at_rest_is_named_as_what_the_recording_lacks(arm, truth, recorded):
    found = identify(arm, (recorded(truth, still=("tilt",)),))
    assert found.rank < found.excitable
    assert any("it lacks" in warning and "tilt.coulomb_friction" in warning for warning in found.warnings)
    assert not any(p.joint == "tilt" for p in found.others)


def test_rotor_inertias_are_said_where_they_are_unknowns(arm, truth, recorded):
    found = identify(arm, (recorded(truth),), terms=JointTerms(rotors=True))
    names = {p.name for p in found.others} | {entry.name for entry in found.unidentified}
    assert {f"{joint}.rotor_inertia.inertia" for joint in arm.joint_names} <= names
    assert any("URDF has no place for rotor inertias: put them into robot.yaml" in s for s in found.exports[0].left_out)


def test_friction_by_direction_is_a_mean_in_the_files(arm, truth, recorded):
    found = identify(arm, (recorded(truth),), terms=JointTerms(("direction_dependent",)))
    assert len(found.others) == 12
    assert any("Friction that depends on direction is the mean of both" in s for s in found.exports[1].left_out)
    assert max(found.departure) < 0.05


def test_friction_of_the_file_stays_where_none_is_an_unknown(arm, recorded):
    found = identify(arm, (recorded(arm),), terms=JointTerms(()))
    assert not found.others
    assert max(joint.relative for joint in found.joints) < 0.02


def test_a_closed_chain_is_identified(robots, recorded):
    given = load_robot(robots / "fourbar.xml")
    found = identify(given, (recorded(replace(given, coulomb_friction=np.array([0.3]))),))
    coulomb = next(p for p in found.others if p.effect == "coulomb_friction")
    assert coulomb.value == pytest.approx(0.3, rel=0.02)
    assert found.exports[0].difference <= 1e-6
    assert any("closed loops" in sentence for sentence in found.exports[0].left_out)


def test_a_robot_whose_file_states_no_inertia_gets_one(tmp_path, robots, recorded):
    text = (robots / "pendulum.urdf").read_text()
    file = tmp_path / "robot.urdf"
    file.write_text(re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL))
    found = identify(load_robot(file), (recorded(load_robot(robots / "pendulum.urdf")),))
    assert found.joints[0].relative < 0.02 < found.joints[0].given
    assert found.exports[0].difference <= 1e-6


def test_an_unknown_estimator_is_refused(arm, recorded):
    with pytest.raises(ParameterError, match="Unknown estimator 'wols': known estimators are ols, wls, "):
        identify(arm, (recorded(arm),), estimator="wols")


@pytest.mark.parametrize("name", ["ols", "irls", "consistent"])
def test_other_estimators_find_the_same_friction(name, arm, truth, recorded):
    found = identify(arm, (recorded(truth),), estimator=name)
    assert found.estimator == name
    values = [p.value for p in found.others if p.effect == "coulomb_friction"]
    np.testing.assert_allclose(values, truth.coulomb_friction, rtol=3e-3)


def test_a_recording_of_half_a_second_is_refused(arm, recorded):
    with pytest.raises(LogError, match=r"log.csv lasts 0\.\d+ s, too short"):
        identify(arm, (recorded(arm, seconds=0.5),))
