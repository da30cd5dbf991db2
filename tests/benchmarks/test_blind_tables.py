"""Tables and figures of the sealed cases, and their publication."""

import datetime
from dataclasses import replace

import pytest
from scored_by_hand import answer, entry, finding, some_cases

from benchmarks.blind.confusion import confusion, confusion_text
from benchmarks.blind.generate import REPORTING, case_ids
from benchmarks.blind.publish import BEGIN, CHECKOUT, END, IMAGE, PAGE, heading, publish
from benchmarks.blind.score import report, write_score
from benchmarks.gapbench.generator.effects import SINGLE_EFFECTS
from benchmarks.gapbench.makes.drake.effects import NAMES
from benchmarks.gapbench.scoring.figures import FIGURES, beyond
from benchmarks.gapbench.scoring.judged import judged
from benchmarks.gapbench.scoring.proportions import average, proportion, wilson
from benchmarks.gapbench.scoring.reliability import calibration_error, reliability
from benchmarks.gapbench.scoring.tables import aims, beside, cell, misses, table, wrapped
from benchmarks.markers import between_markers
from phantom_dyn.effects.catalogue import EFFECTS


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


@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval_has_the_published_values(hits, total, low, high):
    """Newcombe, Statistics in Medicine 17 (1998), table I, method 3."""
    assert wilson(hits, total) == pytest.approx((low, high), abs=5e-5)


def test_impossible_proportions_are_refused():
    with pytest.raises(ValueError, match="5 hits of 3 are no proportion"):
        wilson(5, 3)


def test_a_mean_has_the_normal_interval():
    """Closed form: 1, 2, 3 have the mean 2 and the standard error 1 / sqrt 3."""
    assert average([1.0, 2.0, 3.0]).interval == pytest.approx((2 - 1.959964 / 3**0.5, 2 + 1.959964 / 3**0.5))


def test_confusion_counts_truth_against_what_leads():
    table = confusion(some_cases())
    assert table.counts[table.rows.index("none")][table.columns.index("payload")] == 1
    assert "viscous_friction" in confusion_text(table)


def figure(name, cases):
    return next(f for f in FIGURES if f.name == name).of(cases)


def test_false_claims_are_counted_over_nulls_alone():
    assert figure("false claims on nulls", some_cases()) == proportion([False, True])


def test_large_gaps_keep_the_nulls():
    assert [x.kind for x in beyond(some_cases(), 2.0)] == ["single", "null", "null"]


def test_an_aim_is_met_at_its_edge_and_missed_beyond_it():
    aim = next(f for f in FIGURES if f.name == "false claims on nulls")
    assert (aim.met(proportion([True] + 49 * [False])), aim.met(proportion([True] + 48 * [False]))) == (True, False)


def test_no_case_meets_no_aim():
    assert FIGURES[0].met(proportion([])) is None


@pytest.mark.parametrize("names", [SINGLE_EFFECTS, NAMES], ids=["MuJoCo", "Drake"])
def test_a_generator_calls_effects_as_the_catalogue_does(names):
    # Two independent lists; an effect that no generator draws yet is in the catalogue alone.
    assert set(names) - {effect.name for effect in EFFECTS} == set()
    assert len(set(names)) == len(names)


def test_the_generators_know_the_same_effects():
    assert set(NAMES) == set(SINGLE_EFFECTS)


NULL = {
    "id": "c1",
    "kind": "null",
    "robot": "planar2",
    "joints": ["j1", "j2"],
    "effects": [],
    "truth": [],
    "paired_gap": 0.0,
}

PUBLISHED = {"diagnosis": {"verdict": "no_gap", "findings": [], "joints": []}, "seconds": 1.0}


def cases_that_state(*stated):
    return [replace(judged(NULL, PUBLISHED), stated=tuple(stated))]


def test_the_page_has_its_markers():
    text = (CHECKOUT / PAGE).read_text()
    assert between_markers(text, BEGIN, END, "x") != text


DAY = datetime.date(2026, 11, 21)


def published_in_one_line(batches):
    return heading(batches, DAY).replace("\n", " ")


@pytest.mark.parametrize(
    ("batches", "text"),
    [
        (
            list(REPORTING.items()),
            "Measured on 2026-11-21 with `make blind`: 710 cases, the reporting ranges; seeds, opened once: "
            "single 11000 to 11249, null 12000 to 12299, pair 13000 to 13079, outside 14000 to 14079.",
        ),
        (
            [("null", range(12000, 12100)), ("pair", range(13000, 13080))],
            "Measured on 2026-11-21 with `python benchmarks/blind/run.py --nulls 12000:12100 --pairs 13000:13080`: "
            "180 cases, part of the reporting ranges (710 cases); seeds, opened once: "
            "null 12000 to 12099, pair 13000 to 13079.",
        ),
    ],
    ids=["the whole ranges", "a part of the ranges"],
)
def test_a_heading_of_the_reporting_ranges_gives_its_command_and_says_that_they_were_opened_once(batches, text):
    assert published_in_one_line(batches) == text


@pytest.mark.parametrize(
    ("batches", "text"),
    [
        ([("null", range(100, 140))], "40 cases, not those of the reporting ranges; seeds: null"),
        # Some of these are among the reporting ranges, which are from 12000 on for nulls.
        ([("null", range(11990, 12010))], "20 cases, not those of the reporting ranges; seeds: null"),
        ([("single", range(3, 4))], " 1 case, "),
        ([("mixed", range(9))], "`python benchmarks/blind/run.py --kind mixed --seeds 0:9`"),
    ],
    ids=["other seeds", "some other seeds", "one case", "mixed"],
)
def test_a_heading_of_other_seeds_counts_them_and_does_not_say_that_they_were_opened_once(batches, text):
    assert text in published_in_one_line(batches)


@pytest.mark.parametrize(
    "text", [misses(missed_singles()), heading(list(REPORTING.items()), DAY)], ids=["misses", "heading"]
)
def test_no_line_of_a_sentence_is_longer_than_a_line_of_code(text):
    assert max(map(len, text.splitlines())) <= 120


ONE_NULL = [("null", range(1))]


def scored_nulls(batches):
    return [judged({**NULL, "id": name}, PUBLISHED) for name in case_ids(batches)]


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
def test_a_score_of_other_seeds_is_not_published_and_leaves_the_page_as_it_was(tmp_path, given, message):
    page = checkout_with_score(tmp_path, ONE_NULL)
    before = page.read_text()
    with pytest.raises(ValueError, match=f"score {message}: give the seeds that were scored"):
        publish(tmp_path / "score", given, tmp_path)
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
