"""The table in the documentation, and whether stated probabilities are right as often as they say."""

from __future__ import annotations

import datetime
from dataclasses import replace

import pytest

from benchmarks.blind.generate import REPORTING, case_ids
from benchmarks.blind.publish import BEGIN, CHECKOUT, END, IMAGE, PAGE, between_markers, heading, publish
from benchmarks.blind.score import report, write_score
from benchmarks.gapbench.scoring.judged import judged
from benchmarks.gapbench.scoring.reliability import calibration_error, reliability

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


def test_the_page_has_its_markers():
    text = (CHECKOUT / PAGE).read_text()
    assert between_markers(text, "x") != text


DAY = datetime.date(2026, 11, 21)


def in_one_line(batches):
    return heading(batches, DAY).replace("\n", " ")


def test_the_heading_of_the_whole_ranges_gives_the_one_command_and_says_that_they_were_opened_once():
    assert in_one_line(list(REPORTING.items())) == (
        "Measured on 2026-11-21 with `make blind`: 710 cases, the reporting ranges; seeds, opened once: "
        "single 11000 to 11249, null 12000 to 12299, pair 13000 to 13079, outside 14000 to 14079."
    )


def test_the_heading_of_a_part_of_the_ranges_says_how_many_cases_the_whole_has():
    assert in_one_line([("null", range(12000, 12100)), ("pair", range(13000, 13080))]) == (
        "Measured on 2026-11-21 with `python benchmarks/blind/run.py --nulls 12000:12100 --pairs 13000:13080`: "
        "180 cases, part of the reporting ranges (710 cases); seeds, opened once: "
        "null 12000 to 12099, pair 13000 to 13079."
    )


@pytest.mark.parametrize("seeds", [range(100, 140), range(11990, 12010)])
def test_the_heading_of_other_seeds_does_not_say_that_they_were_opened_once(seeds):
    """Also where some of them are among the reporting ranges: these are from 12000 on for nulls."""
    assert f"{len(seeds)} cases, not those of the reporting ranges; seeds: null" in in_one_line([("null", seeds)])


def test_the_heading_of_one_case_speaks_of_one_case():
    assert " 1 case, " in in_one_line([("single", range(3, 4))])


def test_the_heading_of_mixed_cases_names_their_kind_in_the_command():
    assert "`python benchmarks/blind/run.py --kind mixed --seeds 0:9`" in in_one_line([("mixed", range(9))])


def test_no_line_of_the_heading_is_longer_than_a_line_of_code():
    assert max(map(len, heading(list(REPORTING.items()), DAY).splitlines())) <= 120


ONE_NULL = [("null", range(1))]


def scored_nulls(batches):
    return [judged({**NULL, "id": name}, SAID) for name in case_ids(batches)]


def checkout_with_score(folder, batches):
    """A checkout with nothing but the page, and the score of these seeds beside it."""
    page = folder / PAGE
    page.parent.mkdir()
    page.write_text(f"# X\n{BEGIN}\n{END}\n")
    write_score(scored_nulls(batches), folder / "score")
    return page


def test_a_score_is_published_with_table_and_picture(tmp_path):
    page = checkout_with_score(tmp_path, ONE_NULL)
    publish(tmp_path / "score", ONE_NULL, tmp_path)
    text = page.read_text()
    assert report(scored_nulls(ONE_NULL)).strip() in text
    assert f"]({IMAGE.name})" in text
    assert (tmp_path / IMAGE).read_bytes() == (tmp_path / "score" / "confusion.png").read_bytes()


REFUSED = [
    ([("null", range(1, 2))], "holds 1 cases, 0 of them among the 1 of the given seeds"),
    ([("null", range(2))], "holds 1 cases, 1 of them among the 2 of the given seeds"),
    ([("single", range(1))], "holds 1 cases, 0 of them among the 1 of the given seeds"),
]


@pytest.mark.parametrize(("given", "message"), REFUSED)
def test_a_score_of_other_seeds_is_not_published(tmp_path, given, message):
    checkout_with_score(tmp_path, ONE_NULL)
    with pytest.raises(ValueError, match=f"score {message}: give the seeds that were scored"):
        publish(tmp_path / "score", given, tmp_path)


def test_a_score_of_other_seeds_leaves_the_page_as_it_was(tmp_path):
    page = checkout_with_score(tmp_path, ONE_NULL)
    before = page.read_text()
    with pytest.raises(ValueError, match="give the seeds that were scored"):
        publish(tmp_path / "score", [("null", range(2))], tmp_path)
    assert (page.read_text(), (tmp_path / IMAGE).exists()) == (before, False)


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
