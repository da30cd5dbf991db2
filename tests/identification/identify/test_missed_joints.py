"""Joints that an identification misses on held-out data. Oracles: known truth; of the TX40 what is published."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.readers.read_table import read_table
from identification.data.reading import recording
from identification.estimators.weighted_least_squares import wls
from identification.identify.hold_out import held_out_evidence, joint_errors, split_logs
from identification.identify.identification import JointError
from identification.identify.identified_model import JointTerms, effects_of, without_estimated
from identification.identify.identify import identify
from identification.identify.missed_joints import Shared, missed, missed_sentences, shared_effects
from identification.regression.regressor import torque_regressor
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

COUPLING = effect_named("joint_coupling")


def about_missed(warnings: tuple[str, ...]) -> list[str]:
    return [sentence for sentence in warnings if "held-out data is above" in sentence or "moves with both" in sentence]


def error(joint: str, relative: float) -> JointError:
    return JointError(joint, "N m", relative, relative, 1.0, 0.1, 100)


@pytest.mark.parametrize(("relative", "told"), [(0.29, False), (0.31, True), (float("nan"), False)])
def test_above_thirty_percent_a_joint_is_missed(relative, told):
    assert (len(missed((error("a", relative), error("b", 0.1)))) == 1) is told


def test_the_sentence_names_the_joints_the_worst_first():
    (sentence,) = missed_sentences((error("a", 0.4), error("b", 0.1), error("c", 1.97)), ())
    assert sentence.startswith("The torque error on held-out data is above 30 % on c (197\N{NO-BREAK SPACE}%), a (40")
    assert "rely on neither the parameters nor the model files there" in sentence


def test_the_sentence_on_two_joints_names_what_would_mend_them():
    errors = (error("a", 0.4), error("b", 0.9))
    sentence = missed_sentences(errors, (Shared(COUPLING, ("a", "b"), (0.1, 0.2)),))[1]
    assert sentence.startswith("Friction moves with both a and b: joint coupling (friction or inertia that acts when")
    assert "would lower their errors to 10\N{NO-BREAK SPACE}% and 20\N{NO-BREAK SPACE}%" in sentence


def test_nothing_is_said_of_an_identification_that_predicts_well(found):
    assert about_missed(found.warnings) == []


def coupled(robot, clean, coulomb: float):
    """The recording with friction that moves with the sum of the first two joints' speeds."""
    rate = 1 / (clean.t[1] - clean.t[0])
    v, a = np.gradient(clean.q, axis=0) * rate, np.zeros_like(clean.q)
    operation = Operation.of(robot, Motion(clean.t, clean.q, v, a), clean.tau)
    place = "+".join(robot.joint_names[:2])
    gap = COUPLING.torque(robot, operation, place, np.array([1.0, coulomb, 0.0, 0.0]))
    return replace(clean, tau=clean.tau - gap)


def test_friction_of_two_joints_together_is_named(planar2, recorded):
    found = identify(planar2, (coupled(planar2, recorded(planar2, seconds=20.0), 20.0),))
    first, second = about_missed(found.warnings)
    assert all(joint in first for joint in ("shoulder", "elbow"))
    assert second.startswith("Friction moves with both shoulder and elbow: joint coupling")


def test_what_no_coupling_mends_is_given_no_such_name(planar2, recorded, rng):
    clean = recorded(planar2, seconds=20.0)
    noise = rng.standard_normal(clean.tau.shape) * [0.0, 20.0]
    found = identify(planar2, (replace(clean, tau=clean.tau + np.cumsum(noise, axis=0) / 20),))
    (only,) = about_missed(found.warnings)
    assert "elbow" in only


@pytest.mark.whole
def test_the_coupled_wrist_of_the_tx40_is_named(data_folder):
    # Published: sign(dq5 + dq6) with 2.0 N m; least squares with it leaves 12 and 10 %, without it 51 and 32 %.
    given = load_robot(data_folder / "tx40" / "robot.urdf")
    split = split_logs(given, (recording(read_table(data_folder / "tx40" / "log.csv"), given),))
    robot, effects = without_estimated(given, JointTerms()), effects_of(given, JointTerms())
    fit = wls(torque_regressor(robot, split.train, effects))
    evidence = held_out_evidence(given, robot, fit, split.test)
    errors = joint_errors(given, evidence.measured, evidence.predicted, evidence.given, fit.relative_error)
    assert {joint.joint for joint in missed(errors)} == {"joint_5", "joint_6"}
    (shared,) = shared_effects(robot, split, effects, errors)
    assert (shared.effect, shared.joints) == (COUPLING, ("joint_5", "joint_6"))
