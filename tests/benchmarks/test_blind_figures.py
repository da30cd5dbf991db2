"""Proportions with their intervals, the figures and their aims, the confusion matrix, and sentences on them."""

from __future__ import annotations

import pytest
from scored_by_hand import some_cases

from benchmarks.blind.confusion import confusion, confusion_text
from benchmarks.gapbench.scoring.figures import FIGURES, beyond
from benchmarks.gapbench.scoring.proportions import average, proportion, wilson


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
