"""A part of a joint's gap that the findings leave lowers the probability of a finding on that joint."""

from __future__ import annotations

from dataclasses import replace

import pytest

from identification.diagnosis.judge.findings.remaining_gap import lowered_by_remaining_gap
from identification.diagnosis.result import EffectAt, Finding, JointGap, Rival


def gap(joint: str, after: float, closed: float | None) -> JointGap:
    return JointGap(joint, "N m", 10.0, after, 1.0, 100, closed=closed)


def finding(joint: str | None, *rivals: tuple[str, float]) -> Finding:
    others = tuple(Rival((EffectAt(name, joint),), p) for name, p in rivals)
    own = 1.0 - sum(p for _, p in rivals)
    return Finding("coulomb_friction", joint, "everywhere", {}, 0.9, (0.8, 1.0), own, others, "supported")


@pytest.mark.parametrize(
    ("joint", "gaps", "own"),
    [
        # No more than one and a half floors are left.
        ("j1", [gap("j1", 1.5, 0.8), gap("j2", 5.0, 0.5)], 1.0),
        # A fifth of the joint's gap is left.
        ("j1", [gap("j1", 3.0, 0.8), gap("j2", 1.0, 1.0)], 0.8),
        # Less than is listed.
        ("j1", [gap("j1", 2.0, 0.96)], 1.0),
        # Of two joints the one that is left with more.
        ("j1+j2", [gap("j1", 3.0, 0.8), gap("j2", 4.0, 0.6)], 0.6),
        # Of the whole robot the mean.
        (None, [gap("j1", 3.0, 0.8), gap("j2", 1.0, 1.0)], 0.9),
        # Findings make the joint worse.
        ("j1", [gap("j1", 12.0, -0.4)], 0.0),
        ("j1", [gap("j1", 3.0, None)], 1.0),
    ],
)
def test_what_is_left_of_a_joint_may_have_made_what_a_finding_explains(joint, gaps, own):
    said = lowered_by_remaining_gap(finding(joint), tuple(gaps))
    assert said.probability == pytest.approx(own)
    assert said.rivals == ()


def test_rivals_lose_as_much_as_the_finding():
    said = lowered_by_remaining_gap(finding("j1", ("presliding_friction", 0.25)), (gap("j1", 3.0, 0.6),))
    assert said.probability == pytest.approx(0.45)
    assert [rival.probability for rival in said.rivals] == [pytest.approx(0.15)]


def test_steps_that_the_readings_show_stay_as_certain_as_they_are():
    steps = replace(finding("j1"), effect="encoder_quantization")
    assert lowered_by_remaining_gap(steps, (gap("j1", 3.0, 0.6),)) == steps
