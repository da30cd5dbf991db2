from __future__ import annotations

import dataclasses

import pytest

from identification.diagnosis.result import Value
from identification.reporting.diagnosis_summary import summary


@pytest.mark.parametrize(("joints", "findings"), [(1, 0), (2, 3), (7, 15)])
def test_no_line_is_longer_than_100_columns(made_up, joints, findings):
    names = tuple(f"a_very_long_name_of_joint_{'x' * 30}_{k}" for k in range(joints))
    assert max(map(len, summary(made_up(names, findings)).splitlines())) <= 100


def test_each_finding_is_named_with_place_size_and_sureness(made_up):
    text = " ".join(summary(made_up(findings=2)).split())
    assert "1. Coulomb friction on joint j1: 0.25100 ± 0.00060 N m; very likely (93 %), 83 % (80 to 86 %)" in text
    assert "2. Viscous friction on joint j2" in text


def test_the_table_gives_the_given_the_tolerated_and_the_corrected_model_and_the_floor(made_up):
    rows = [line.split() for line in summary(made_up(("axis",), unit="N")).splitlines()]
    assert ["axis", "0.25", "0.24", "0.031", "0.03", "N"] in rows


def test_warnings_and_the_next_experiment_are_told(made_up):
    text = summary(dataclasses.replace(made_up(), next_experiment={"say": "Move joint j1 slowly."}))
    assert "Next experiment: Move joint j1 slowly." in text
    assert "Warning: first.csv: 12 repeated rows were dropped" in text


def test_notes_are_told(made_up):
    text = summary(dataclasses.replace(made_up(), notes=("Simulated motion is compared over 0.1 s.",)))
    assert "  Note: Simulated motion is compared over 0.1 s." in text


def test_friction_that_grew_says_what_its_ratio_is_of(made_up):
    made = made_up(findings=1)
    ratio = {**made.findings[0].parameters, "ratio": Value(1.504, 0.014, "1")}
    grown = dataclasses.replace(made.findings[0], recording="b.csv", parameters=ratio)
    text = " ".join(summary(dataclasses.replace(made, findings=(grown,))).split())
    assert "N m, where it is 1.504 ± 0.014 times what it is in the other recordings; " in text


def test_control_characters_in_names_do_not_reach_the_terminal(made_up):
    text = summary(dataclasses.replace(made_up(("j\x1b[31m",)), data_warnings=("a\x1b[2Jb",)))
    assert "\x1b" not in text
