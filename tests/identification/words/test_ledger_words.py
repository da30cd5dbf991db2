"""Why an effect was named or not. Oracle: the contract's example, and sentences by hand."""

from dataclasses import replace

import pytest

from identification.diagnosis.result import EffectAt, Rival
from identification.engine.claims import Claim, GateResult
from identification.words.ledger_words import gate_line, nearest_claims, why
from identification.words.numbers_and_names import NO_BREAK
from made_up_diagnosis import made_up_diagnosis
from phantom_dyn.errors import UsageError


def said(diagnosis, effect: str, joint: str | None = None) -> list[str]:
    return [answer.sentence.replace(NO_BREAK, " ") for answer in why(diagnosis, effect, joint)]


@pytest.fixture
def diagnosis():
    return made_up_diagnosis()


def test_a_rival_that_is_listed_cannot_be_separated_by_the_motion(diagnosis):
    rival = Rival((EffectAt("payload", None),), 0.12)
    finding = replace(diagnosis.findings[0], rivals=(rival,))
    assert said(replace(diagnosis, findings=(finding,)), "payload") == [
        "A payload would close 61 % of the gap; it is not named because Coulomb friction on joint j1 closes 0.42 noise "
        "floors more, and these two cannot be separated by this motion (12 % for the one not named)."
    ]


# What took its place, that all gates were passed, the gate that an effect failed, why it cannot be tested, and from
# which size on it would have been seen.
@pytest.mark.parametrize(
    ("effect", "joint", "sentence"),
    [
        (
            "payload",
            None,
            "A payload would close 61 % of the gap; it is not named because Coulomb friction on joint j1 closes 0.42 "
            "noise floors more, and beside it only 3.5 is gained, where chance alone may give 20.",
        ),
        (
            "coulomb_friction",
            None,
            "Coulomb friction on joint j1 is named: it passed all 1 gates that it met, and would close 83 % of the gap "
            "alone.",
        ),
        (
            "torque_offset",
            "j2",
            "A torque offset on joint j2 would close 10 % of the gap; it is not named because beside what is named it "
            "gains 3.5, where chance alone may give 20.",
        ),
        (
            "backlash",
            "j2",
            "Backlash on joint j2 was not tried, as this recording cannot show it: the transmitted torque never "
            "changes sign.",
        ),
        (
            "backlash",
            "j1",
            "Backlash on joint j1 was tried and never claimed, and is not among the ten that came nearest. The "
            "recording would have shown it from gap 0.002 rad on.",
        ),
    ],
)
def test_an_effect_states_why_it_is_named_or_not(diagnosis, effect, joint, sentence):
    assert said(diagnosis, effect, joint) == [sentence]


def test_of_all_joints_where_none_is_given(diagnosis):
    assert [answer.name for answer in why(diagnosis, "backlash")] == ["backlash on joint j1", "backlash on joint j2"]


def test_a_name_may_be_written_with_blanks(diagnosis):
    assert said(diagnosis, "Torque offset") == said(diagnosis, "torque_offset")


def test_an_unknown_effect_is_refused_with_the_nearest_and_with_those_that_there_are(diagnosis):
    with pytest.raises(UsageError, match=r"'payloud' .* did you mean payload\? Wanted one of actuator_lag, backlash"):
        why(diagnosis, "payloud")


def test_another_joint_is_refused_with_those_that_there_are(diagnosis):
    with pytest.raises(UsageError, match=r"backlash was asked for on 'j9', wanted one of: j1, j2\."):
        why(diagnosis, "backlash", "j9")


def test_a_file_without_a_ledger_says_so(diagnosis):
    with pytest.raises(UsageError, match="holds no ledger, as it was made by an earlier version"):
        why(replace(diagnosis, ledger=()), "coulomb_friction")


@pytest.mark.parametrize(("judged_by", "data"), [("poses", "these poses"), ("rests", "these rests")])
def test_what_cannot_be_separated_is_said_of_the_data_that_judged_it(diagnosis, judged_by, data):
    finding = replace(diagnosis.findings[0], rivals=(Rival((EffectAt("payload", None),), 0.12),))
    ledger = tuple(replace(claim, judged_by=judged_by) for claim in diagnosis.ledger)
    (sentence,) = said(replace(diagnosis, findings=(finding,), ledger=ledger), "payload")
    assert f"these two cannot be separated by {data}" in sentence


def test_what_poses_say_beside_torques_is_marked(diagnosis):
    ledger = tuple(replace(claim, judged_by="poses") for claim in diagnosis.ledger)
    (sentence,) = said(replace(diagnosis, ledger=ledger), "coulomb_friction")
    assert sentence.startswith("Coulomb friction on joint j1 (judged by the measured poses) is named")


def test_the_five_nearest_are_those_that_would_close_most(diagnosis):
    # By hand: 61 % and a tenth over one, two, three and four.
    names = [answer.name for answer in nearest_claims(diagnosis)]
    assert names == [
        "a payload",
        "a torque offset on joint j2",
        "cogging on joint j2",
        "a parasitic spring on joint j2",
        "actuator lag on joint j2",
    ]


def test_what_took_a_place_and_is_not_named_itself_is_said_to_have_taken_it(diagnosis):
    far = GateResult("plausible size", -0.057, 0.0, "kg", False)
    claim = Claim((EffectAt("base_tilt", None),), (far,), "displaced", (EffectAt("inertial_parameters", "j1"),))
    assert said(replace(diagnosis, ledger=(claim,)), "base_tilt")[0].endswith(
        "is not named because wrong inertial parameters on joint j1 took its place in the search: its size is 0.057 kg "
        "outside of what a sound robot has, and that of a rival is not."
    )


@pytest.mark.parametrize(
    ("result", "line"),
    [
        (
            GateResult("rounding matters", 0.0123, 0.03, "of the squared noise", False),
            "failed  rounding matters: 1 %, needed 3 % (of the squared noise)",
        ),
        # No gate states more than all of the gap.
        (
            GateResult("large enough", 1.03, 0.01, "of the gap", True),
            "passed  large enough: over 99 %, needed 1 % (of the gap)",
        ),
    ],
)
def test_a_gate_is_a_line_with_its_figure_and_what_was_needed(result, line):
    assert gate_line(result).replace(NO_BREAK, " ") == line


def test_claims_of_single_recordings_are_reported_one_by_one(diagnosis):
    few = GateResult("more than chance", 3.5, 20.0, "gain", False)
    own = tuple(Claim((EffectAt("payload", None, file),), (few,), "not_claimed") for file in ("a.csv", "b.csv"))
    assert [answer.name for answer in why(replace(diagnosis, ledger=own), "payload")] == [
        "a payload in a.csv",
        "a payload in b.csv",
    ]
