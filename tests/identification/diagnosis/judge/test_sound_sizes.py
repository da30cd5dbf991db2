"""Findings of sizes that no sound robot has. Oracle: by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identification.diagnosis.judge.findings.sound_sizes import all_sound, size_notes
from identification.notes import Code
from identification.pipeline import diagnose
from identification.words.verdict_words import headline


def finding(effect: str, joint: str) -> Any:
    """As much of a finding as is looked at."""
    return SimpleNamespace(effect=effect, joint=joint)


def shown_with(quiet, sizes) -> Any:
    """What is shown of an arm, with sizes of effects on its elbow."""
    theta = np.zeros(len(quiet.problem.precision))
    terms = [quiet.term(effect, "elbow") for effect in sizes]
    for term, size in zip(terms, sizes.values(), strict=True):
        theta[list(term.columns)] = size
    fit = SimpleNamespace(coefficients=lambda term: theta[list(term.columns)])
    found = SimpleNamespace(theta=theta)
    return SimpleNamespace(problem=quiet.problem, named=frozenset(terms), found=found, joint_fit=fit)


@pytest.mark.parametrize(
    ("sizes", "codes"),
    [
        ({"coulomb_friction": 0.1, "viscous_friction": 0.05}, []),
        # Pushes at high speed, where it is larger than what holds back.
        ({"coulomb_friction": 0.02, "viscous_friction": -1.0}, [Code.FRICTION_DRIVES]),
        # At its bound no friction is left, and none drives.
        ({"coulomb_friction": 0.0, "viscous_friction": 0.0}, []),
    ],
)
def test_friction_of_all_findings_together_holds_back(quiet, sizes, codes):
    notes = [note for note in size_notes(shown_with(quiet, sizes)) if note.code is Code.FRICTION_DRIVES]
    assert [note.code for note in notes] == codes
    assert {note.joint for note in notes} <= {"elbow"}


def test_a_torque_constant_of_four_is_said_to_be_none(quiet):
    # By hand: 1 / (1 - 0.75) is 4, where two is the most.
    (note,) = size_notes(shown_with(quiet, {"torque_constant": -0.75}))
    assert note.code is Code.IMPLAUSIBLE_SIZE
    assert note.numbers["value"] == pytest.approx(4.0)
    assert note.numbers["most"] == pytest.approx(2.0)


def test_only_findings_that_are_named_have_to_be_sound(quiet):
    notes = size_notes(shown_with(quiet, {"torque_constant": -0.75}))
    constant, friction = (finding(name, "elbow") for name in ("torque_constant", "other"))
    assert not all_sound([friction, constant], notes)
    assert all_sound([friction], notes)


def test_a_joint_whose_friction_drives_it_has_no_sound_finding(quiet):
    notes = size_notes(shown_with(quiet, {"coulomb_friction": 0.02, "viscous_friction": -1.0}))
    at = [finding("viscous_friction", joint) for joint in ("elbow", "shoulder")]
    assert not all_sound(at[:1], notes)
    assert all_sound(at[1:], notes)


def test_a_gap_is_not_explained_by_a_torque_constant_that_no_motor_has(lab, planar2):
    # Known truth: the torque of the elbow is recorded three times too small, its friction with it.
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "torque_constant", "elbow", 3.0)
    found = diagnose(planar2, (lab.recording(planar2, motion, torque),))
    assert ("torque_constant", "elbow") in {(one.effect, one.joint) for one in found.findings}
    assert found.verdict == "partly_explained"
    assert "a size that no sound robot has" in headline(found)
