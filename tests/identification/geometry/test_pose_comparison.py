"""Diagnoses of poses compared, and in a table of many. Oracle: the zero that was put in."""

from __future__ import annotations

import pytest

from identification.reporting.comparison import compare, comparison_text
from identification.scenarios.measured_poses import diagnosis_of_poses
from identification.words.geometry_words import all_findings, answer


@pytest.fixture
def both(ur10, tracked):
    """Of a robot that is right and one with a wrong zero."""
    recordings = (tracked(50), tracked(51, zeros={"elbow_joint": 0.003}))
    return [diagnosis_of_poses(ur10, (recording,)) for recording in recordings]


def test_a_zero_that_poses_show_is_a_change_between_diagnoses(both):
    told = comparison_text(compare(both, ["before", "after"]))
    assert "The verdict changed: no gap -> explained." in told
    assert "An encoder offset on elbow_joint, offset: not found -> 0.00" in told


def test_the_answer_of_poses_alone_says_nothing_of_torques(both):
    assert all(answer(one).startswith("Measured poses: tool0 is off by") for one in both)


def test_findings_in_poses_are_listed_like_those_in_torque(both):
    (finding,) = all_findings(both[1])
    assert (finding.effect, finding.joint, finding.regime) == ("encoder_offset", "elbow_joint", "posture")
