"""Sentences and tables of the score."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scored_by_hand import answer, entry, finding, some_cases

from benchmarks.blind.score import report
from benchmarks.gapbench.scoring.judged import judged
from benchmarks.gapbench.scoring.tables import aims, beside, cell, misses, table, wrapped


def single(*said, gap=6.0, beyond=6.0, verdict=None):
    return judged(
        answer("viscous_friction", gap=gap) | {"beyond_tolerance": beyond}, entry(*map(finding, said), verdict=verdict)
    )


def missed_singles():
    """Four of at least two floors: one named, one with another name, two silent; two of these near the tolerance."""
    wrong, near = single("coulomb_friction", beyond=2.9), single(gap=2.0, beyond=1.0)
    return [single("viscous_friction", beyond=1.0), wrong, single(), near]


SAID = (
    "Of 4 singles with a gap of 2 floors or more the truth is not named in 3; in 2 of these nothing at all is named, "
    "and 2 of these keep less than 3 floors beyond the tolerance."
)


def in_one_line(cases):
    return misses(cases).replace("\n", " ")


def test_the_sentence_on_misses_counts_what_is_not_named_what_is_silent_and_what_hardly_leaves_the_tolerance():
    assert in_one_line(missed_singles()) == SAID


@pytest.mark.parametrize(
    "other",
    [
        single(gap=1.9),
        judged(answer(), entry()),
        replace(single(), kind="pair"),
        replace(single(), kind="outside"),
    ],
    ids=["small", "null", "pair", "outside"],
)
def test_the_sentence_on_misses_is_about_single_effects_of_two_floors_alone(other):
    assert in_one_line([*missed_singles(), other]) == SAID


def test_a_twin_of_the_truth_is_no_miss():
    """What the recording cannot part from the truth counts as the truth."""
    truth = answer("inertial_parameters", "j2") | {"alike": [{"effect": "payload", "joint": None, "leaves": 0.02}]}
    assert "is not named in 0;" in in_one_line([judged(truth, entry(finding("payload", None)))])


def test_what_keeps_three_floors_beyond_the_tolerance_does_not_keep_less():
    assert "and 0 of these keep" in in_one_line([single(beyond=3.0)])


def test_there_is_no_sentence_on_misses_without_singles_of_two_floors():
    assert misses([single(gap=1.9), judged(answer(), entry())]) == ""


def test_the_report_holds_the_sentence_on_misses():
    assert misses(some_cases()) in report(some_cases())


def test_no_line_of_the_sentence_on_misses_is_longer_than_a_line_of_code():
    assert max(map(len, misses(missed_singles()).splitlines())) <= 120


def test_wrapping_splits_neither_words_nor_hyphenated_ones():
    words = ["independent-sample"] * 20
    assert wrapped(" ".join(words)).split() == words


def test_baselines_stand_beside_what_was_said_of_the_same_cases():
    mine = [replace(single("coulomb_friction"), id=name) for name in ("a", "b", "c")]
    lines = beside(mine, {"always_coulomb": mine[:1]}).splitlines()
    counts = next(line for line in lines if line.startswith("| cases"))
    assert [cell.strip() for cell in counts.split("|")[2:4]] == ["1", "1"]


@pytest.mark.parametrize(("value", "text"), [(None, "-"), (0.12345, "0.12"), (3, "3"), ("j1", "j1")])
def test_a_cell_has_two_digits_of_a_measured_value(value, text):
    assert cell(value) == text


def test_the_columns_of_a_table_line_up():
    assert table(("a", "bcd"), [(1, 0.5), (200, None)]) == "| a   | bcd |\n|-----|-----|\n| 1   | 0.5 |\n| 200 | -   |"


def test_a_figure_that_reaches_its_aim_says_so():
    """Half of the nulls are claimed, where two in a hundred are allowed."""
    row = next(line for line in aims(some_cases()).splitlines() if "false claims on nulls" in line)
    assert [text.strip() for text in row.split("|")[2:5]] == ["at most 2 %", "50 % (9 to 91)", "no"]
