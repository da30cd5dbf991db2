"""The verdict in a sentence."""

import dataclasses

import pytest

from identification.diagnosis.result import Unexplained
from identification.words import verdict_words


@pytest.mark.parametrize(
    ("verdict", "start"),
    [
        ("explained", "The gap between robot and model is explained by Coulomb friction on joint j1."),
        (
            "partly_explained",
            "Part of the gap between robot and model is explained by Coulomb friction on joint j1; 40",
        ),
        ("unknown", "There is a gap between robot and model that the catalogue does not explain (Coulomb friction"),
        ("no_gap", "The model fits the robot"),
        ("not_testable", "This recording cannot show a gap"),
    ],
)
def test_each_verdict_is_one_sentence(made_up, verdict, start):
    rest = Unexplained(0.4, True, "j2", "low_speed")
    sentence = verdict_words.verdict_sentence(dataclasses.replace(made_up(), verdict=verdict, unexplained=rest))
    assert sentence.startswith(start)
    assert sentence.endswith(".")
    assert sentence.count(". ") == 0


def test_where_noise_is_as_large_as_the_torque_the_columns_are_doubted_and_no_effect_is_named(made_up):
    made = made_up(findings=0)
    drowned = tuple(dataclasses.replace(joint, rms_torque=joint.noise_floor) for joint in made.joints)
    sentence = verdict_words.verdict_sentence(dataclasses.replace(made, verdict="not_testable", joints=drowned))
    assert "on every joint the noise is as large as the torque" in sentence
    assert "right columns" in sentence


@pytest.mark.parametrize(("structured", "says"), [(False, "acts on joint j2 from 3.00"), (True, "acts from 3.00")])
def test_an_event_is_put_on_the_joint_that_is_known_to_be_its_own(made_up, structured, says):
    # The joint of a rest with structure is that of the structure, and a push may have met another.
    rest = Unexplained(0.4, structured, "j2", "low_speed", times=((3.0, 3.2),))
    made = dataclasses.replace(made_up(findings=0), verdict="unknown", unexplained=rest)
    assert says in verdict_words.verdict_sentence(made)


def test_an_unknown_gap_says_joint_and_regime(made_up):
    rest = Unexplained(0.4, True, "j2", "low_speed")
    diagnosis = dataclasses.replace(made_up(findings=0), verdict="unknown", unexplained=rest)
    assert "mostly at joint j2, at low speed" in verdict_words.verdict_sentence(diagnosis)


def test_a_model_that_moves_otherwise_than_the_robot_says_which_joint_strays(made_up):
    quiet = tuple(dataclasses.replace(joint, rms_after=joint.noise_floor) for joint in made_up(findings=0).joints)
    diagnosis = dataclasses.replace(
        made_up(findings=0),
        verdict="unknown",
        joints=quiet,
        unexplained=Unexplained(0.0, False, "j2", None),
        rollout={"horizon_s": 0.5, "rms_before": {}, "rms_after": {}, "strays": {"j1": 1.2, "j2": 1.94}},
    )
    sentence = verdict_words.verdict_sentence(diagnosis)
    assert "its torque shows none" in sentence
    assert (
        "the simulated motion of joint j2 strays 1.94 times as far as noise and the tolerances can make it" in sentence
    )


def test_a_verdict_of_no_gap_names_the_joints_that_it_says_nothing_of(made_up):
    # A joint without a held-out sample has a residual of zero, of which "no gap" would be untrue.
    found = dataclasses.replace(made_up(findings=0), verdict="no_gap")
    still = tuple(dataclasses.replace(gap, hold_out_samples=0) for gap in found.joints[:1])
    said = verdict_words.verdict_sentence(dataclasses.replace(found, joints=(*still, *found.joints[1:])))
    name = found.joints[0].joint
    assert f"{name} is not judged: it moves too little, or too briefly between two standstills." in said
    assert "not judged" not in verdict_words.verdict_sentence(found)
    unknown = (dataclasses.replace(still[0], rms_torque=None), *found.joints[1:])
    said = verdict_words.verdict_sentence(dataclasses.replace(found, joints=unknown))
    assert f"{name} is not judged: its torque is not known." in said
    assert "moves too little" not in said
