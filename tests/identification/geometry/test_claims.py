"""The ledger of measured poses. Known truth: a UR10 with one wrong number; oracles: the findings, and the JSON."""

from __future__ import annotations

import json

import pytest

from identification.engine.claims import Claim
from identification.gates import ORDER
from identification.reporting.stored.diagnosis_files import json_text
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from identification.scenarios.measured_poses import diagnosis_of_poses
from identification.words.ledger_words import why

ELBOW = ("encoder_offset", "elbow_joint")


@pytest.fixture
def shifted(ur10, tracked):
    """Poses of an arm whose elbow reads 3 mrad too much."""
    return diagnosis_of_poses(ur10, (tracked(11, zeros={"elbow_joint": 0.003}),))


def of(diagnosis, effect: str, joint: str) -> Claim:
    (claim,) = [one for one in diagnosis.ledger if [(at.effect, at.joint) for at in one.effects] == [(effect, joint)]]
    return claim


def test_what_is_found_has_passed_chance_and_size(shifted):
    assert shifted.geometry.findings
    claim = of(shifted, *ELBOW)
    assert (claim.outcome, claim.judged_by) == ("claimed", "poses")
    assert [result.gate for result in claim.gates] == ["more than chance", "large enough"]
    assert all(result.passed for result in claim.gates)
    assert claim.figures["closes"] == pytest.approx(shifted.geometry.closed, rel=1e-6)


def test_what_is_not_found_has_failed_its_last_gate_and_no_other(shifted):
    others = [claim for claim in shifted.ledger if claim.outcome != "claimed"]
    assert 0 < len(others) <= 10
    for claim in others:
        passed = [result.passed for result in claim.gates]
        assert passed == [True] * (len(passed) - 1) + [False]
        places = [ORDER[result.gate] for result in claim.gates]
        assert places == sorted(places)


def test_what_would_be_claimed_without_a_finding_is_displaced_by_it(shifted):
    claim = of(shifted, "encoder_offset", "shoulder_lift_joint")
    assert claim.outcome == "displaced"
    assert [(at.effect, at.joint) for at in claim.instead] == [ELBOW]
    assert claim.figures["floors_more"] > 0.1


def test_a_robot_that_is_right_has_a_ledger_without_claims(ur10, tracked):
    found = diagnosis_of_poses(ur10, (tracked(21),))
    assert {claim.outcome for claim in found.ledger} == {"not_claimed"}
    assert {claim.gates[-1].gate for claim in found.ledger} == {"more than chance"}


def test_the_ledger_of_poses_is_read_from_the_file_as_it_was_written(shifted, tmp_path):
    file = tmp_path / "diagnosis.json"
    file.write_text(json_text(shifted))
    assert {entry["judged_by"] for entry in json.loads(file.read_text())["ledger"]} == {"poses"}
    read, made = (
        [(claim.effects, claim.outcome, claim.judged_by) for claim in one.ledger]
        for one in (read_diagnosis(file), shifted)
    )
    assert read == made


def test_why_speaks_of_poses(shifted):
    (named,) = why(shifted, "encoder_offset", "elbow_joint")
    assert named.sentence.startswith("An encoder offset on elbow_joint is named: it passed all 2 gates")
    (other,) = why(shifted, "encoder_offset", "shoulder_lift_joint")
    assert "it is not named because an encoder offset on elbow_joint closes" in other.sentence
