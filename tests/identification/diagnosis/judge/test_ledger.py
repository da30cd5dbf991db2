"""The ledger of a diagnosis. Known truth: friction on the elbow; oracles: the findings, and what they close."""

import numpy as np
import pytest

from identification.diagnosis.result import Diagnosis, EffectAt
from identification.gates import ORDER
from identification.pipeline import diagnose

FRICTION = EffectAt("coulomb_friction", "elbow")


@pytest.fixture(scope="module")
def rubbed(lab, planar2) -> Diagnosis:
    """The arm with 0.3 N m of friction on the elbow that its model lacks."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = -0.3 * np.sign(motion.v) * [0.0, 1.0]
    return diagnose(planar2, (lab.recording(planar2, motion, torque),))


def test_findings_are_what_is_claimed_and_minor_ones_what_is_minor(rubbed):
    for outcome, findings in (("claimed", rubbed.findings), ("minor", rubbed.minor)):
        claims = {claim.effects for claim in rubbed.ledger if claim.outcome == outcome}
        assert claims == {(EffectAt(one.effect, one.joint),) for one in findings}
    assert {(FRICTION,)} == {claim.effects for claim in rubbed.ledger if claim.outcome == "claimed"}


def test_what_is_claimed_has_passed_all_gates_and_what_is_not_has_failed_the_last(rubbed):
    for claim in rubbed.ledger:
        passed = [result.passed for result in claim.gates]
        assert passed == [True] * len(passed) if claim.outcome == "claimed" else passed[-1] is False
        assert all(passed[:-1])


def test_gates_stand_in_the_order_in_which_they_are_asked(rubbed):
    for claim in rubbed.ledger:
        places = [ORDER[result.gate] for result in claim.gates]
        assert places == sorted(places)


def test_no_effect_stands_in_the_ledger_twice(rubbed):
    effects = [claim.effects for claim in rubbed.ledger]
    assert len(effects) == len(set(effects))
    assert len(effects) >= 10


def test_a_law_that_resembles_what_is_named_is_displaced_by_it(rubbed):
    (viscous,) = [claim for claim in rubbed.ledger if claim.effects == (EffectAt("viscous_friction", "elbow"),)]
    assert (viscous.outcome, viscous.instead) == ("displaced", (FRICTION,))
    assert 0.0 < viscous.figures["closes"] < 1.0
    assert viscous.figures["floors_more"] > 0.5


def test_what_an_effect_closes_alone_is_what_the_single_finding_closes(rubbed):
    # Oracle: a single finding closes what is closed together.
    (claim,) = [one for one in rubbed.ledger if one.outcome == "claimed"]
    assert claim.figures["closes"] == pytest.approx(rubbed.gap.closed, rel=1e-5)


def test_on_a_robot_without_a_gap_all_are_too_little_by_chance(lab, planar2):
    found = diagnose(planar2, (lab.recording(planar2, lab.motion(2, 4)),))
    assert found.findings == ()
    assert found.ledger
    for claim in found.ledger:
        assert claim.outcome == "not_claimed"
        assert claim.failed is not None
