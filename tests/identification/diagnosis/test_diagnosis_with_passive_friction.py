"""Friction of the passive joints of a closed chain: known truths on the PHANToM 1.5."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.result import Diagnosis, EffectAt
from identification.pipeline import diagnose
from phantom_dyn import load_robot

TORQUE = 3e-3  # N m, a tenth of what gravity and inertia take
MODELLED = np.array([1.0, 0.0]) * TORQUE  # of elbow and crank


@pytest.fixture(scope="module")
def phantom():
    """Its model has no friction at all."""
    return load_robot("phantom_1_5")


@pytest.fixture(scope="module")
def rubbing(phantom):
    """The same arm whose elbow is modelled with Coulomb friction."""
    assert phantom.passive_names == ("elbow", "crank")
    return replace(phantom, chain=replace(phantom.chain, coulomb_friction=MODELLED))


@pytest.fixture(scope="module")
def with_friction(lab):
    """Diagnosis of an arm whose elbow has so much Coulomb friction more than its model."""

    def run(robot, torque: float) -> Diagnosis:
        motion = lab.motion(3, 3, rate=100.0)
        more = lab.acting(robot, motion, "coulomb_friction", "elbow", torque)
        return diagnose(robot, (lab.recording(robot, motion, more, noise=2e-4, seed=1),))

    return run


@pytest.fixture(scope="module")
def found(with_friction, phantom):
    return with_friction(phantom, TORQUE)


def test_friction_of_a_passive_joint_is_named_on_that_joint(found):
    assert [(f.effect, f.joint) for f in found.findings] == [("coulomb_friction", "elbow")]
    assert found.verdict == "explained"


def test_the_passive_joint_that_turns_at_the_opposite_speed_is_an_equal_rival(found):
    # Closed form: the angle of the crank is minus that of the elbow, so both leave the same torque.
    (finding,) = found.findings
    rivals = {rival.effects: rival.probability for rival in finding.rivals}
    assert rivals[(EffectAt("coulomb_friction", "crank"),)] == pytest.approx(finding.probability)
    assert finding.verdict == "one_of"


def test_friction_of_a_passive_joint_comes_back_within_four_deviations(found):
    torque = found.findings[0].parameters["torque"]
    assert abs(torque.value - TORQUE) < max(4 * torque.std, 0.01 * TORQUE)


@pytest.mark.whole
def test_a_closed_chain_without_a_gap_has_none(with_friction, phantom):
    clean = with_friction(phantom, 0.0)
    assert (clean.verdict, clean.findings) == ("no_gap", ())


@pytest.mark.whole
def test_modelled_friction_of_a_passive_joint_that_is_off_within_its_tolerance_is_no_gap(with_friction, rubbing):
    # 8 % more than modelled, within two tolerances of 5 %.
    inside = with_friction(rubbing, 0.08 * TORQUE)
    assert (inside.verdict, inside.findings) == ("no_gap", ())
    change = {item.quantity: item.change for item in inside.adjusted}["elbow Coulomb friction"]
    assert change == pytest.approx(0.08, abs=0.02)


@pytest.mark.whole
def test_modelled_friction_of_a_passive_joint_that_is_off_by_more_is_a_gap(with_friction, rubbing):
    assert [(f.effect, f.joint) for f in with_friction(rubbing, 0.4 * TORQUE).findings] == [
        ("coulomb_friction", "elbow")
    ]


@pytest.mark.whole
def test_friction_of_a_passive_joint_of_the_branch_is_no_coupling_of_the_joints_that_move_it(lab):
    # Known truth: q3 turns with q5 - q2 as a coupling of these would, and q6 against it.
    branch = load_robot("cea_branch")
    motion = lab.motion(3, 3, rate=100.0)
    more = sum(
        lab.acting(branch, motion, effect, "q3", size)
        for effect, size in (("coulomb_friction", 0.4), ("viscous_friction", 0.3))
    )
    found = diagnose(branch, (lab.recording(branch, motion, more, noise=0.02, seed=1),))
    assert {(f.effect, f.joint) for f in found.findings} == {("coulomb_friction", "q3"), ("viscous_friction", "q3")}
    for finding in found.findings:
        assert {rival.effects for rival in finding.rivals} == {(EffectAt(finding.effect, "q6"),)}
