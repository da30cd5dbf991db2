"""The table in the README, and whether stated probabilities are right as often as they say."""

from __future__ import annotations

import datetime
import sys
from dataclasses import replace
from pathlib import Path

import pytest

# The benchmarks are no part of the installed packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.judged import judged
from benchmarks.blind.publish import BEGIN, CHECKOUT, END, IMAGE, between_markers, heading, publish
from benchmarks.blind.reliability import calibration_error, reliability
from benchmarks.blind.score import report, write_score

NULL = {
    "id": "c1",
    "kind": "null",
    "robot": "planar2",
    "joints": ["j1", "j2"],
    "effects": [],
    "truth": [],
    "paired_gap": 0.0,
}
SAID = {"diagnosis": {"verdict": "no_gap", "findings": [], "joints": []}, "seconds": 1.0}


def cases_that_state(*stated):
    return [replace(judged(NULL, SAID), stated=tuple(stated))]


def test_everything_between_the_markers_is_replaced_and_nothing_else():
    text = f"before\n{BEGIN}\nold\nrows\n{END}\nafter\n"
    assert between_markers(text, "new\n") == f"before\n{BEGIN}\nnew\n{END}\nafter\n"


@pytest.mark.parametrize(
    "text", ["", f"{BEGIN} only", f"{END} and then {BEGIN}", f"{BEGIN}{END}{BEGIN}{END}", f"{BEGIN}{BEGIN}{END}"]
)
def test_a_text_without_its_two_markers_is_refused(text):
    with pytest.raises(ValueError, match="each once: put them where the table goes"):
        between_markers(text, "new")


def test_the_readme_has_its_markers():
    text = (CHECKOUT / "README.md").read_text()
    assert between_markers(text, "x") != text


def test_the_heading_says_which_seeds_were_opened():
    said = heading([("null", range(4000, 4300))], datetime.date(2026, 11, 21))
    assert said == "Measured on 2026-11-21 with `make blind`; seeds, opened once: null 4000 to 4299."


def test_a_score_is_published_with_table_and_picture(tmp_path):
    (tmp_path / "README.md").write_text(f"# X\n{BEGIN}\n{END}\n")
    write_score(cases_that_state(), tmp_path / "score")
    publish(tmp_path / "score", [("null", range(1))], tmp_path)
    text = (tmp_path / "README.md").read_text()
    assert report(cases_that_state()).strip() in text
    assert f"]({IMAGE.as_posix()})" in text
    assert (tmp_path / IMAGE).read_bytes() == (tmp_path / "score" / "confusion.png").read_bytes()


def test_the_same_counts_give_the_same_picture(tmp_path):
    for name in ("one", "two"):
        write_score(cases_that_state(), tmp_path / name)
    one, two = ((tmp_path / name / "confusion.png").read_bytes() for name in ("one", "two"))
    assert one == two


def test_probabilities_are_binned_and_one_belongs_to_the_last_bin():
    bins = reliability(cases_that_state((1.0, True), (0.95, False), (0.92, True), (0.05, False)))
    counts = {b.name: (len(b.right), sum(b.right)) for b in bins if b.right}
    assert counts == {"0 to 0.1": (1, 0), "0.9 to 0.99": (2, 1), "0.99 to 1": (1, 1)}


def test_the_calibration_error_has_its_closed_form():
    """Two statements of 0.8, one right, and two of 0.2, none right: 0.3 and 0.2 off, on average a quarter."""
    stated = ((0.8, True), (0.8, False), (0.2, False), (0.2, False))
    assert calibration_error(cases_that_state(*stated)) == pytest.approx(0.25)


def test_a_rival_and_its_twin_of_the_truth_are_one_answer():
    truth = {"effect": "rotor_inertia", "joint": "j1", "parameters": {"inertia": 0.1}}
    answer = {**NULL, "kind": "single", "effects": [truth], "truth": [truth], "paired_gap": 5.0}
    rivals = [
        {"effects": [{"effect": "inertial_parameters", "joint": "j1"}], "probability": 0.3},
        {"effects": [{"effect": "payload", "joint": None}], "probability": 0.2},
    ]
    finding = {"effect": "rotor_inertia", "joint": "j1", "parameters": {}, "gap_closed": 0.9, "probability": 0.5}
    said = {"verdict": "explained", "findings": [{**finding, "rivals": rivals}], "joints": []}
    assert judged(answer, {"diagnosis": said, "seconds": 1.0}).stated == ((0.2, False), (0.8, True))
