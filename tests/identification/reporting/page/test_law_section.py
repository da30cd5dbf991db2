"""The oracle is the text itself: what a made-up law says has to stand in report, terminal and file."""

from __future__ import annotations

import dataclasses
import json

import pytest

from identification.diagnosis.rest_law import Dependence, FrequencyAnswer, InputCurve, InputGain, Law, LawTerm
from identification.diagnosis.result import Unexplained
from identification.reporting.diagnosis_summary import summary
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.stored.diagnosis_files import json_text
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from identification.words.law_words import dependence_sentences

LAW = Law("j2", ("v.j2", "q.j1"), "-2*sign(v)", 0.7, (0.6, 0.8), {"v.j2": (-1.0, 2.0)}, "rust on a hinge")
FOUND = Dependence(
    "j2", "N m", ("v.j2", "q.j1"),
    (InputGain(("v.j2", "q.j1"), 0.9, (0.8, 0.95), 0.2), InputGain(("t",), -0.1, (-0.3, 0.0), 0.2)),
    (InputCurve("v.j2", "rad/s", "", (0.0, 1.0), (1.0, -1.0), (0.5, -1.5), (1.5, -0.5)),),
    (LawTerm("sign(v)", "N m", -2.0, (-2.1, -1.9), 0.95),), 0.9, 0.88, 17,
)  # fmt: skip


@pytest.fixture
def lawful(made_up):
    rest = Unexplained(0.4, True, "j2", "low_speed", law=LAW, dependence=FOUND)
    return dataclasses.replace(made_up(), verdict="unknown", unexplained=rest)


@pytest.fixture
def lawless(lawful):
    found = dataclasses.replace(FOUND, terms=(), same_terms=0.0, rest_closed=0.0)
    return dataclasses.replace(lawful, unexplained=dataclasses.replace(lawful.unexplained, law=None, dependence=found))


def test_the_terminal_says_the_law_in_one_sentence(lawful):
    text = " ".join(summary(lawful).split())
    assert (
        "What is left on joint j2 depends on the velocity and the position of j1: -2*sign(v) [N m] closes 70 % "
        "(60 to 80 %) of the gap, looks most like rust on a hinge." in text
    )


def test_inputs_that_are_in_no_row_of_the_table_are_said_to_come_from_formulas():
    assert dependence_sentences(FOUND, None)[0] == "It depends on the velocity and the position of j1."
    other = dataclasses.replace(FOUND, inputs=("v.j2", "a.j2"))
    assert dependence_sentences(other, None)[:2] == [
        "It depends on the velocity and the acceleration.",
        "Most formulas that fit stretches drawn at random use that; smooth functions of other pairs foresee more.",
    ]


def test_the_terminal_names_the_inputs_where_no_formula_stands_out(lawless):
    text = " ".join(summary(lawless).split())
    assert "depends on the velocity and the position of j1; no formula stands out." in text


def test_the_terminal_says_no_law_of_the_little_that_an_explained_gap_leaves(lawful):
    assert "What is left" not in summary(dataclasses.replace(lawful, verdict="explained"))


def test_the_report_has_formula_range_and_terms(lawful):
    page = report_html(lawful)
    for text in ("<code>-2*sign(v) [N m]</code>", "v.j2 from -1 to 2", "rust on a hinge", "-2.1 to -1.9"):
        assert text in page


def test_the_report_says_which_inputs_are_beyond_chance(lawful):
    page = report_html(lawful)
    rows = page.split("What the rest depends on")[1]
    assert (
        rows.index("The velocity and the position of j1") < rows.index("yes") < rows.index("Time") < rows.index("no<")
    )


def test_a_curve_has_a_band(lawful):
    assert report_html(lawful).count("<polygon") == report_html(dataclasses.replace(lawful, unexplained=Unexplained(
        0.4, True, "j2", "low_speed"))).count("<polygon") + 1  # fmt: skip


def test_the_report_says_why_there_is_no_formula(lawless):
    assert "the terms that fit best are not the same" in " ".join(report_html(lawless).split())


def test_what_was_written_is_read_back(lawful, tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text(json_text(lawful), encoding="utf-8")
    assert read_diagnosis(path).unexplained == lawful.unexplained


def test_without_a_look_there_is_no_dependence_in_the_file(made_up):
    assert "dependence" not in json.loads(json_text(made_up()))["unexplained"]


ANSWER = FrequencyAnswer(
    "freq(v.j2)",
    "N m/(rad/s)",
    (0.1, 1.0),
    (3.0, 1.0),
    (2.5, 0.5),
    (3.5, 1.5),
    (0.0, -60.0),
    (-5.0, -70.0),
    (5.0, -50.0),
)


@pytest.fixture
def dynamic(lawful):
    law = dataclasses.replace(
        LAW, inputs=("freq(v.j2)",), formula="-3*low(v, 0.4 Hz)", valid={"freq(v.j2)": (0.1, 1.0)}
    )
    found = dataclasses.replace(FOUND, inputs=("freq(v.j2)",), curves=(), answers=(ANSWER,))
    return dataclasses.replace(lawful, unexplained=dataclasses.replace(lawful.unexplained, law=law, dependence=found))


def test_a_frequency_is_said_in_words(dynamic):
    text = " ".join(summary(dynamic).split())
    assert "What is left on joint j2 depends on the frequency of the velocity: -3*low(v, 0.4 Hz)" in text


def test_the_report_says_what_a_frequency_means_and_where_it_is_known(dynamic):
    page = " ".join(report_html(dynamic).split())
    assert "To the velocity it answers with a gain and a phase that change with the frequency" in page
    assert "freq(v.j2) from 0.1 to 1 Hz" in page


def test_gain_and_phase_have_a_panel_each_with_a_band(dynamic):
    page = report_html(dynamic)
    without = report_html(dataclasses.replace(dynamic, unexplained=dataclasses.replace(
        dynamic.unexplained, dependence=dataclasses.replace(dynamic.unexplained.dependence, answers=()))))  # fmt: skip
    assert page.count("<polygon") == without.count("<polygon") + 2
    assert "gain [N m/(rad/s)]" in page
    assert "phase [deg]" in page


def test_gain_and_phase_are_read_back(dynamic, tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text(json_text(dynamic), encoding="utf-8")
    assert read_diagnosis(path).unexplained == dynamic.unexplained
