import dataclasses

import pytest

from identification.diagnosis.result import Adjusted, Bound, EffectAt, Hidden, JointGap, Rival, Unexplained, Value
from identification.notes import Code, Note
from identification.words import diagnosis_words as words
from identification.words import verdict_words
from identification.words.effect_words import REGIMES, effect_words, regime_sentence, regime_words, report_order
from identification.words.numbers_and_names import NO_BREAK
from phantom_dyn.effects.catalogue import EFFECTS


def test_reports_list_effects_by_kind_and_those_of_one_kind_as_the_catalogue_does():
    # By hand, from the files of the effects: some of each kind, the last from elsewhere.
    listed = """viscous_friction coulomb_friction joint_coupling parasitic_spring backlash torque_offset input_delay
    payload base_tilt encoder_offset encoder_quantization belt_slip""".split()
    assert sorted(sorted(listed), key=report_order) == listed


def test_every_regime_of_the_contract_has_words():
    said = "velocity_reversal low_speed high_speed high_load high_acceleration one_direction periodic_in_angle posture"
    assert list(REGIMES) == [*said.split(), "saturated", "time_drift", "everywhere"]


def test_words_show_no_internal_name_and_the_next_step_is_a_sentence():
    entries = [effect_words(effect.name) for effect in EFFECTS]
    assert [entry.name for entry in entries if "_" in entry.name + entry.meaning + entry.next_step] == []
    assert all(entry.next_step[0].isupper() and entry.next_step.endswith(".") for entry in entries)


def test_an_effect_or_regime_from_elsewhere_is_shown_as_it_is():
    assert (effect_words("belt_slip").name, regime_words("in_water")) == ("belt slip", "in water")


def test_a_finding_is_said_in_whole_sentences(made_up):
    parts = dataclasses.astuple(words.finding_words(made_up(findings=2).findings[1]))
    assert [part.replace(NO_BREAK, " ") for part in parts] == [
        "The recording shows viscous friction of 0.13 N m s/rad on joint j2: friction torque that grows in proportion "
        "to speed.",
        "It shows at high speed.",
        "This is very likely (93 %); it accounts for 83 % (80 to 86 %) of the gap.",
        "It may instead be presliding friction on joint j2 and a torque offset on joint j2 together (7 %).",
        "Add the coefficient to the joint's damping in the model, and record once cold and once warm: it changes with "
        "the lubricant's temperature.",
    ]


def test_the_next_step_of_a_finding_with_rivals_is_the_experiment_that_parts_them(made_up):
    finding = made_up().findings[0]
    experiment = {"separates": [["coulomb_friction", "j1"]], "say": "Move joint j1 slowly."}
    assert words.finding_words(finding, experiment).what_next == words.PROPOSED
    other = {"separates": [["coulomb_friction", "j2"]], "say": "Move joint j2 slowly."}
    assert words.finding_words(finding, other).what_next.startswith("Add the torque")


@pytest.mark.parametrize(
    ("effect", "joint", "text"),
    [
        ("coulomb_friction", "elbow", "on joint elbow"),
        ("joint_coupling", "j2+j3", "between joints j2 and j3"),
        ("base_tilt", None, "on the robot as a whole"),
        ("backlash", "a+b", "on joint a+b"),
    ],
)
def test_a_place_follows_the_name_of_an_effect(effect, joint, text):
    assert words.on_place(effect, joint) == text


def test_without_rivals_nothing_else_explains_the_data(made_up):
    alone = dataclasses.replace(made_up().findings[0], probability=1.0, rivals=())
    assert words.rivals_words(alone) == ""
    assert words.finding_words(alone).what_else == "Nothing else in the catalogue explains the data as well."


@pytest.mark.parametrize(
    ("own", "text"),
    [
        (0.6, "it may instead be backlash on joint j1 (30 %), or a payload (10 %)"),
        # What is missing to one.
        (
            0.4,
            "it may instead be backlash on joint j1 (30 %), or a cause outside the catalogue (20 %), or a payload "
            "(10 %)",
        ),
    ],
)
def test_rivals_are_named_most_probable_first(made_up, own, text):
    rivals = (Rival((EffectAt("payload", None),), 0.1), Rival((EffectAt("backlash", "j1"),), 0.3))
    finding = dataclasses.replace(made_up().findings[0], probability=own, rivals=rivals)
    assert words.rivals_words(finding).replace(NO_BREAK, " ") == text


@pytest.mark.parametrize(
    ("probability", "text"),
    [
        (0.995, "practically certain (over 99 %)"),
        (1.0, "practically certain (over 99 %)"),
        (0.93, "very likely (93 %)"),
        (0.7, "likely (70 %)"),
        (0.5, "as likely as not (50 %)"),
        (0.51, "more likely than not (51 %)"),
        (0.3, "undecided (30 %)"),
    ],
)
def test_a_probability_is_words_and_number(probability, text):
    assert words.certainty_words(probability).replace(NO_BREAK, " ") == text


def test_a_coupling_names_both_joints_and_a_plus_in_a_name_stays():
    assert words.place("joint_coupling", "j2+j3") == "joints j2 and j3"
    assert words.place("backlash", "a+b") == "joint a+b"
    assert words.place("payload", None) == "the whole robot"


def test_a_negative_size_is_named_as_less_than_modelled(made_up):
    finding = dataclasses.replace(made_up().findings[0], parameters={"torque": Value(-0.1, 0.01, "N m")})
    assert words.finding_name(finding) == "less Coulomb friction than modelled"
    said = words.finding_words(finding).what.replace(NO_BREAK, " ")
    assert said == "The recording shows less Coulomb friction than modelled on joint j1, by 0.1 N m."


def test_a_size_that_is_a_sentence_follows_the_place(made_up):
    parameters = {"ratio": Value(0.9, 0.01, "1")}
    finding = dataclasses.replace(made_up().findings[0], effect="torque_constant", parameters=parameters)
    assert words.finding_words(finding).what == (
        "The recording shows a wrong torque constant on joint j1: the true torque is 0.9 times the recorded one."
    )


@pytest.mark.parametrize(
    ("regime", "sentence"),
    [
        ("low_speed", "It shows at low speed."),
        ("periodic_in_angle", "It repeats with the joint angle."),
        ("time_drift", "It drifts over time."),
        (None, ""),
    ],
)
def test_a_regime_is_a_sentence(regime, sentence):
    assert regime_sentence(regime) == sentence


def test_many_findings_are_counted_in_the_verdict(made_up):
    made = made_up(findings=6)
    effects = ("backlash", "cogging", "torque_offset", "rotor_inertia", "input_delay", "coulomb_friction")
    several = tuple(dataclasses.replace(f, effect=e) for f, e in zip(made.findings, effects, strict=True))
    sentence = verdict_words.verdict_sentence(dataclasses.replace(made, findings=several))
    assert sentence.endswith("and 3 more.")


def test_the_verdict_names_findings_of_one_kind_together_in_the_robots_order(made_up):
    made = made_up(("j1", "j2", "j3"), findings=3)
    joints, sure = ("j3", "j1", None), (0.9, 0.3, 0.9)
    findings = tuple(
        dataclasses.replace(
            made.findings[0], effect="payload" if j is None else "coulomb_friction", joint=j, probability=p
        )
        for j, p in zip(joints, sure, strict=True)
    )
    assert verdict_words.headline(dataclasses.replace(made, findings=findings)) == (
        "The gap between robot and model is explained by Coulomb friction on joints j1 and j3 (in part undecided) and "
        "a payload."
    )


def test_nothing_is_reported_as_more_than_all_of_the_gap():
    assert words.share_words(1.01, (0.99, 1.05)).replace(NO_BREAK, " ") == "over 99 % (at least 99 %)"
    assert words.share_words(1.0, (0.999, 1.05)).replace(NO_BREAK, " ") == "over 99 %"
    assert words.share_words(0.97, (0.9, 1.2)).replace(NO_BREAK, " ") == "97 % (90 to over 99 %)"


def test_the_verdict_on_a_wrong_recording_begins_with_what_is_wrong(made_up):
    wrong = dataclasses.replace(made_up(), wrong=("a.csv: the positions of j1 are in degrees",))
    sentence = verdict_words.verdict_sentence(wrong)
    assert sentence.startswith("Judged although a.csv: the positions of j1 are in degrees. The gap between robot")


# What version 1 said against its own figures, each with the words that the sentence has to hold and those it must not.
FLOORS = JointGap("j1", "N m", 1.0, 0.3, 0.03, 100, 2.0, 0.9, (0.028, 0.032), "none", None)
NO_STRUCTURE = Unexplained(0.0, False, "j1", None)
WIDE = Bound("coulomb_friction", "j1", "torque", 0.3, "N m", 0.4)
LIMIT = Adjusted("hand mass", -0.1, 0.05, True, Hidden("payload", 0.12))
OTHER_LIMIT = Adjusted("arm Ixx", 0.1, 0.05, True, Hidden("change", 0.1))


@pytest.mark.parametrize(
    ("changes", "said", "unsaid"),
    [
        (
            {
                "verdict": "unknown",
                "findings": (),
                "joints": (FLOORS,),
                "unexplained": Unexplained(0.0, False, "j1", None),
            },
            "on joint j1 10 times its noise floor is left",
            "fits the robot",
        ),
        (
            {"verdict": "unknown", "findings": (), "unexplained": Unexplained(0.0, False, "j2", None, ((1.0, 1.5),))},
            "something acts on joint j2 from 1.00 to 1.50 s that nothing in the motion predicts",
            "fits the robot",
        ),
        (
            {"verdict": "no_gap", "findings": (), "adjusted": (LIMIT,)},
            "hand mass ends at the limit of its tolerance; a payload of up to 0.12 kg could hide behind it.",
            "explained",
        ),
        (
            {"verdict": "no_gap", "findings": (), "adjusted": (LIMIT, OTHER_LIMIT)},
            "The changes of hand mass and arm Ixx end at the limits of their tolerances; a payload of up to 0.12 kg "
            "and larger changes of these could hide behind them.",
            "explained",
        ),
        (
            {"verdict": "no_gap", "findings": (), "adjusted": (LIMIT, *(OTHER_LIMIT,) * 4)},
            "The changes of hand mass, arm Ixx, arm Ixx and 2 more (in the report) end at the limits",
            "arm Ixx, arm Ixx, arm Ixx",
        ),
        (
            {"verdict": "no_gap", "findings": (), "joints": (dataclasses.replace(FLOORS, rms_after=0.03),)},
            "a short event which does not repeat cannot be excluded",
            "explained",
        ),
        (
            {"verdict": "no_gap", "findings": (), "joints": (dataclasses.replace(FLOORS, rms_after=0.03),)},
            "nothing was found beyond noise and the tolerances that the model states.",
            "slow joints",
        ),
        (
            {"verdict": "no_gap", "findings": (), "joints": (dataclasses.replace(FLOORS, rms_after=0.09),)},
            "nothing was found beyond noise, what drives and slow joints may leave, and the tolerances",
            "beyond noise and",
        ),
        (
            {"verdict": "no_gap", "findings": (), "joints": (dataclasses.replace(FLOORS, rms_after=0.09),)},
            "On joint j1 3.0 times its noise floor is left, 4 % of its torque: the drive may make it, or friction",
            "explained",
        ),
        (
            {
                "verdict": "not_testable",
                "findings": (),
                "joints": (dataclasses.replace(FLOORS, rms_after=0.12, noise_floor_source="sensors"),),
            },
            "does not show whether there is a gap: on joint j1 6 % of the torque is left. Noise may make it",
            "ordinary",
        ),
        (
            {"verdict": "not_testable", "findings": (), "bounds": (), "joints": (FLOORS,)},
            "too low to see noise above so fast a motion, the readings were filtered, or the noise grows towards",
            "ordinary",
        ),
        (
            {"verdict": "no_gap", "joints": (dataclasses.replace(FLOORS, rms_after=0.03, rms_torque=0.2),)},
            "On joint j1 15 % of the torque counts as noise, because nothing predicts it",
            "times its noise floor",
        ),
        (
            {"verdict": "no_gap", "joints": (dataclasses.replace(FLOORS, rms_after=0.03, rms_torque=0.4),)},
            "The model fits the robot",
            "counts as noise",
        ),
        (
            {
                "verdict": "not_testable",
                "findings": (),
                "bounds": (Bound("coulomb_friction", "j1", "torque", 0.3, "N m", 0.4),),
            },
            "Coulomb friction on joint j1, would have been seen only from 40 % of the torque on",
            "at all",
        ),
    ],
)
def test_the_verdict_says_what_its_figures_say(made_up, changes, said, unsaid):
    sentence = verdict_words.verdict_sentence(dataclasses.replace(made_up(), **changes)).replace(NO_BREAK, " ")
    assert said in sentence
    assert unsaid not in sentence


def test_the_short_headline_of_what_may_be_a_gap_does_not_say_that_it_is_none(made_up):
    joint = dataclasses.replace(FLOORS, rms_after=0.12, noise_floor_source="sensors")
    made = dataclasses.replace(made_up(), verdict="not_testable", findings=(), joints=(joint,))
    assert verdict_words.short_headline(made) == "This recording does not show whether there is a gap."


def test_a_finding_with_less_than_half_of_the_probability_is_undecided(made_up):
    diagnosis = made_up()
    finding = dataclasses.replace(diagnosis.findings[0], probability=0.49)
    sentence = verdict_words.verdict_sentence(dataclasses.replace(diagnosis, findings=(finding,)))
    assert "explained by Coulomb friction on joint j1 (undecided)." in sentence


def test_an_interval_that_says_no_more_than_the_share_is_left_out(made_up):
    finding = dataclasses.replace(made_up().findings[0], gap_closed=0.999, gap_closed_interval=(0.998, 0.9995))
    assert words.finding_share(finding).replace(NO_BREAK, " ") == "over 99 %"


def test_the_share_is_reported_where_it_is_known(made_up):
    finding = dataclasses.replace(made_up().findings[0], share=0.71)
    assert words.finding_share(finding).replace(NO_BREAK, " ") == "71 %"


@pytest.mark.parametrize(
    ("names", "said"),
    [(["j2"], "joint j2"), (["j2", "j3"], "joints j2 and j3"), (["joint_5", "joint_6"], "joint_5 and joint_6")],
)
def test_a_name_that_says_it_is_a_joint_stands_alone(names, said):
    assert words.joints_words(names) == said


@pytest.mark.parametrize(
    ("share", "interval", "said"),
    [
        (0.83, (0.8, 0.861), "83 % (80 to 86 %)"),
        (0.999, (0.998, 0.9995), "over 99 %"),
        (1.0, (0.997, 1.0), "over 99 %"),
    ],
)
def test_an_interval_that_says_no_more_is_left_out(share, interval, said):
    assert words.share_words(share, interval).replace(NO_BREAK, " ") == said


def test_an_effect_that_helps_only_beside_others_has_no_negative_share(made_up):
    finding = dataclasses.replace(made_up().findings[0], share=-0.09, gap_closed=0.12)
    assert words.finding_share(finding).replace(NO_BREAK, " ") == "none on average, 12 % if added last"
    assert words.share_of_gap_words(finding).replace(NO_BREAK, " ") == "none of the gap on average, 12 % if added last"


def test_a_finding_that_closes_nothing_on_held_out_data_has_no_measurable_part(made_up):
    # Where noise alone is left there, shares are of nothing and may be -1417 %.
    finding = dataclasses.replace(made_up().findings[0], share=-14.2, gap_closed=-14.2)
    assert words.share_of_gap_words(finding) == "no measurable part of the gap"


def test_the_verdict_names_the_largest_share_first(made_up):
    small, large = (
        dataclasses.replace(made_up().findings[0], effect=effect, joint=joint, share=share)
        for effect, joint, share in (("coulomb_friction", "j1", 0.1), ("viscous_friction", "j2", 0.8))
    )
    sentence = verdict_words.headline(dataclasses.replace(made_up(), findings=(small, large)))
    assert "explained by viscous friction on joint j2 and Coulomb friction on joint j1" in sentence


def test_a_size_that_no_sound_robot_has_is_said_in_the_sentence_of_the_verdict(made_up):
    diagnosis = made_up()
    (finding, *_), numbers = (
        diagnosis.findings,
        {"least": 0.0, "most": 1.0, "value": 2.0, "unit": "N m", "because": "so"},
    )
    note = Note(Code.IMPLAUSIBLE_SIZE, finding.joint, {"effect": finding.effect, "parameter": "torque", **numbers})
    joints = tuple(dataclasses.replace(one, rms_after=one.noise_floor) for one in diagnosis.joints)
    nothing = dataclasses.replace(diagnosis.unexplained, structured=False, times=())
    odd = dataclasses.replace(diagnosis, verdict="partly_explained", notes=(note,), joints=joints, unexplained=nothing)
    assert verdict_words.headline(odd).endswith("a size that no sound robot has, see the notes.")
    assert "no sound robot" not in verdict_words.headline(dataclasses.replace(odd, notes=()))
