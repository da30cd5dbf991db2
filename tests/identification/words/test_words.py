"""Words of a diagnosis: numbers, sizes, stages, notes, certainty. Oracle: sentences by hand."""

import dataclasses
import math
import string
from dataclasses import replace

import pytest

from identification.diagnosis.result import EffectAt, Value
from identification.notes import INCOMPLETE_FILES, Code, Note
from identification.reporting.diagnosis_summary import summary
from identification.reporting.page.diagnosis_report import report_html
from identification.stages import Announcement, Stage
from identification.words.effect_words import meaning_of, size_words, value_cell
from identification.words.note_words import WORDS, sentence, sentences
from identification.words.numbers_and_names import (
    NO_BREAK,
    number,
    percent,
    value_words,
    with_std,
)
from identification.words.stage_words import NAMES, in_words, stage_words
from phantom_dyn.effects.catalogue import EFFECTS


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.001, "under 1 %"), (-0.001, "under 1 %"), (0.0, "0 %"), (-0.2, "-20 %"), (1.3, "130 %"), (math.nan, "–")],
)
def test_a_share_is_never_rounded_to_none_or_all(share, text):
    assert percent(share).replace(NO_BREAK, " ") == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Value(0.051, 0.0006, "N m"), "0.05100 ± 0.00060 N m"),
        (Value(95.1, 1.234, "kg"), "95.1 ± 1.2 kg"),
        (Value(-12.0, 340.0, "N"), "-12 ± 340 N"),
        (Value(1.02, 0.004, "1"), "1.0200 ± 0.0040"),
        (Value(2.5e-6, 3e-7, "kg m^2"), "(2.50 ± 0.30)e-6 kg m^2"),
        (Value(0.25, math.nan, "N m"), "0.25 N m"),
        (Value(0.25, 0.0, "N m"), "0.25 N m"),
        (Value([6.0, 12.0], [0.0, 0.1], "1/rev"), "6, 12.00 ± 0.10 1/rev"),
    ],
)
def test_a_value_is_shown_to_the_second_digit_of_its_deviation(value, text):
    assert value_words(value) == text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (5873.4, 3, "5870"),
        (1704.0, 2, "1700"),
        (123456.0, 3, "123000"),
        (2.5e7, 3, "2.5e+07"),
        (0.0607, 2, "0.061"),
        (6.07e-5, 3, "6.07e-05"),
        (-1234.5, 3, "-1230"),
        (-0.0, 3, "0"),
        (float("inf"), 3, "–"),
    ],
)
def test_a_number_has_no_exponent_where_it_reads_better_without(value, digits, text):
    assert number(value, digits) == text


def test_a_number_that_rounds_to_zero_has_no_sign():
    assert with_std(-0.001, 0.15) == "0.00 ± 0.15"


def test_every_effect_has_a_phrase_for_its_size():
    # Of inertial parameters there are as many as move.
    assert {effect.name for effect in EFFECTS if not effect.words.size} == {"inertial_parameters"}


def test_every_parameter_of_the_catalogue_has_a_meaning(planar2):
    every = [
        (effect.name, one.name) for effect in EFFECTS for one in effect.parameters(planar2, effect.places(planar2)[0])
    ]
    assert {effect for effect, _ in every} == {effect.name for effect in EFFECTS}
    assert [(effect, name) for effect, name in every if not meaning_of(EffectAt(effect, None), name)] == []


def test_the_phrase_of_a_size_uses_parameters_of_its_effect():
    for effect in EFFECTS:
        fields = {name for _, name, _, _ in string.Formatter().parse(effect.words.size) if name}
        assert fields <= set(effect.words.parameters), effect.name


def test_a_size_has_three_digits_and_its_unit(made_up):
    assert size_words(made_up().findings[0]) == "of 0.251 N m"


def test_a_list_is_reported_entry_by_entry(made_up):
    assert size_words(made_up(findings=3).findings[2]) == "of 0.02 and 0.004 N m, 6 and 12 times a turn"


def test_a_finding_without_the_parameters_of_its_law_has_no_size(made_up):
    assert size_words(dataclasses.replace(made_up().findings[0], parameters={})) == ""


def test_an_angle_is_shown_in_degrees_too():
    # Closed form: pi / 180.
    shown = value_cell(Value(0.01745329, 0.0001, "rad")).replace("\N{NO-BREAK SPACE}", " ")
    assert shown == "0.01745 ± 0.00010 rad (1°)"


def test_a_body_parameter_is_reported_by_its_quantity():
    assert (
        meaning_of(EffectAt("inertial_parameters", None), "wrist.link.mx")
        == "mass times the place of its centre along x"
    )


def test_a_number_never_parts_from_its_unit_in_a_table():
    assert " " not in value_cell(Value(0.25, 0.01, "N m s/rad"))
    assert value_cell(Value([1.0, 2.0], [0.1, 0.1], "N m")).count(" ") == 1


def test_every_stage_has_words_of_its_own():
    assert (set(NAMES), len(set(NAMES.values()))) == (set(Stage), len(Stage))


@pytest.mark.parametrize(
    ("now", "words"),
    [
        (Announcement(Stage.FILTERING), "filtering"),
        (Announcement(Stage.READING, detail={"file": "log.csv"}), "reading log.csv"),
        (Announcement(Stage.RIVALS_TRIED, detail={"found": 2}), "trying rivals, 2 found"),
        (Announcement(Stage.ESTIMATION, detail={"estimator": "wls"}), "estimating (wls)"),
        (Announcement(Stage.MAP, 20, 80), "mapping 20 of 80 points"),
        (Announcement(Stage.SIMULATION, 1, 3), "simulating stretch 1 of 3"),
        (Announcement(Stage.BATCH, 0, 2), "diagnosed 0 of 2 recordings"),
        (Announcement(Stage.BATCH, 1, 2, {"file": "a.csv"}), "diagnosed 1 of 2, last a.csv"),
        (
            Announcement(Stage.DESCENT, 1, 8, {"cost": 1.23456, "excess": 0.005}),
            "round 1 of 8: cost 1.235, limits exceeded by 0.5 %",
        ),
    ],
)
def test_words_of_an_announcement(now, words):
    assert stage_words(now) == words


def test_a_callback_that_takes_a_text_is_given_the_words():
    said: list[str] = []
    in_words(said.append)(Announcement(Stage.NOISE))
    assert said == ["estimating the noise"]


def test_every_code_has_a_sentence():
    assert set(WORDS) == set(Code)


def test_a_sentence_stays_as_it_is():
    assert sentences(["log.csv: 3 repeated rows were dropped."]) == ("log.csv: 3 repeated rows were dropped.",)


MOTION = {"file": "a.csv", "has_torque": True}

DRIVE = {"files": ("corrected.xml",), "values": {"delay": 0.01}, "actuators": 0}


@pytest.mark.parametrize(
    ("note", "words"),
    [
        (Note(Code.RUNS_AWAY, None, {"controlled": True, "t": 0.25}), "under the stated controllers: the simulated"),
        (
            Note(Code.NOT_SIMULATED, None, {"controlled": False, "problem": "It is."}),
            "under the recorded torque: it is.",
        ),
        (Note(Code.MOTION_ONLY, None, MOTION), "a.csv: positions and references only: "),
        (Note(Code.MOTION_ONLY, None, MOTION), "The torque of the log is not used."),
        (Note(Code.MOTION_ONLY, None, {**MOTION, "more": 2}), "a.csv and 2 more: positions and references only: "),
        (Note(Code.NO_EXPERIMENT), "the fits of the rivals cannot be compared; take a longer recording."),
        (Note(Code.NOT_WRITTEN, None, {"files": ("a", "b"), "problem": "No."}), "a and b were not written: No."),
        (Note(Code.NOT_WRITTEN, None, {"files": ("a", "b", "c"), "problem": "No."}), "a, b, c were not written: No."),
        (Note(Code.REFUSED, None, {"files": ("a",), "problem": "it is worse"}), "a was not written: it is worse."),
        (Note(Code.NOT_ALONE, None, {"files": ("a",), "other": "b"}), "a was not written: it goes with b."),
        (Note(Code.NO_PLACE, None, {"quantity": "lag", "values": {"j": 0.1}}), "It has no place for lags [s]: j 0.1."),
        (
            Note(Code.NO_PLACE_FOR_DRIVE, "j", DRIVE),
            "corrected.xml: it has no place for what was found",
        ),
    ],
)
def test_the_sentence_of_a_note(note, words):
    assert words in sentence(note)


def test_rivals_that_nothing_separates_are_named_with_what_would():
    pair = (EffectAt("rotor_inertia", "pin"),), (EffectAt("payload", None),)
    said = sentence(Note(Code.NOT_SEPARATED, None, {"pairs": (pair,)}))
    assert said.startswith("No safe motion that was tried separates rotor inertia on joint pin from ")
    assert "take the rotor inertia from the drive's data sheet" in said


def test_what_a_file_does_not_hold_is_a_note_on_files():
    # Oracle: the words of each say that a file is not there or has no place; the list is by code.
    assert Code.NOT_WRITTEN in INCOMPLETE_FILES
    assert Code.CHECKED not in INCOMPLETE_FILES


def test_terminal_and_report_tell_a_cause_outside_the_catalogue(made_up):
    made = made_up(findings=1)
    diagnosis = replace(made, findings=(replace(made.findings[0], probability=0.6, rivals=()),))
    for text in (summary(diagnosis), report_html(diagnosis)):
        assert "a cause outside the catalogue (40" in " ".join(text.split())
