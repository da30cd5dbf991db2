from __future__ import annotations

import dataclasses
import re

import pytest

from identification.diagnosis.result import Bound, JointGap, NotTestable
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.page.report_tables import detectable_sizes, gap_row, regime_table, untestable_rows
from identification.words.numbers_and_names import NO_BREAK

JOINTS = tuple(JointGap(name, "N m", 1.0, 0.1, 0.1, 10) for name in ("a", "b", "c"))


def regimes(made_up, shares, times=None):
    diagnosis = made_up(samples=20)
    evidence = dataclasses.replace(
        diagnosis.evidence, regime_shares=(shares,) * 2, regime_times=(times,) * 2 if times else ()
    )
    return regime_table(dataclasses.replace(diagnosis, evidence=evidence), 0)


def test_the_regime_with_the_largest_share_comes_first(made_up):
    rows = regimes(made_up, {"low_speed": 0.1, "high_load": 0.7})
    assert [row.regime for row in rows] == ["Under high load", "At low speed"]


def test_a_regime_stands_out_by_more_than_its_share_of_the_time(made_up):
    rows = regimes(made_up, {"high_speed": 0.6, "high_load": 0.4}, {"high_speed": 0.55, "high_load": 0.1})
    assert [(row.time, row.stands_out) for row in rows] == [(f"55{NO_BREAK}%", False), (f"10{NO_BREAK}%", True)]


def test_half_of_the_energy_in_one_direction_is_nothing_special(made_up):
    assert not regimes(made_up, {"one_direction": 0.54})[0].stands_out
    assert regimes(made_up, {"one_direction": 0.9})[0].stands_out


def test_a_joint_without_regimes_has_an_empty_table(made_up):
    diagnosis = made_up(samples=20)
    evidence = dataclasses.replace(diagnosis.evidence, regime_shares=())
    assert regime_table(dataclasses.replace(diagnosis, evidence=evidence), 1) == []


def test_bounds_of_one_parameter_are_gathered_over_the_joints():
    bounds = tuple(Bound("backlash", name, "gap", size, "rad") for name, size in (("a", 0.002), ("b", 0.01)))
    (row,) = detectable_sizes(bounds)
    assert (row.effect, row.parameter, row.short) == ("Backlash", "gap", "0.002 to 0.01 rad (2 joints)")
    assert row.places == (("a", "0.002 rad"), ("b", "0.01 rad"))


def test_bounds_stand_in_the_order_of_the_catalogue():
    bounds = (Bound("payload", None, "mass", 0.1, "kg"), Bound("coulomb_friction", "a", "torque", 0.1, "N m"))
    assert [row.effect for row in detectable_sizes(bounds)] == ["Coulomb friction", "A payload"]


def test_bounds_in_different_units_are_kept_apart():
    bounds = (Bound("backlash", "a", "gap", 0.002, "rad"), Bound("backlash", "slide", "gap", 1e-4, "m"))
    assert detectable_sizes(bounds)[0].short == "0.002 rad (joint a); 0.0001 m (joint slide)"


def test_a_bound_of_pairs_names_both_joints():
    bounds = tuple(Bound("joint_coupling", pair, "coulomb_torque", 0.1, "N m") for pair in ("a+b", "b+c"))
    (row,) = detectable_sizes(bounds)
    assert row.short == "0.1 N m (2 pairs of joints)"
    assert row.places[0] == ("a and b", "0.1 N m")


@pytest.mark.parametrize(
    ("joints", "where"),
    [
        (("a", "b", "c"), "all joints"),
        (("a", "c"), "a and c"),
        ((None,), "the whole robot"),
        (("a", "b", "c", "crank"), "all joints and crank"),
    ],
)
def test_places_of_an_untestable_effect_are_gathered(joints, where):
    entries = tuple(NotTestable("backlash", joint, "why") for joint in joints)
    assert untestable_rows(entries, JOINTS) == [("Backlash", where, "why")]


def test_effects_that_share_places_and_reason_share_a_row():
    entries = (NotTestable("actuator_lag", None, "why"), NotTestable("input_delay", None, "why"))
    assert untestable_rows(entries, JOINTS) == [("An input delay and actuator lag", "the whole robot", "why")]


def test_different_reasons_stand_in_rows_of_their_own():
    entries = (NotTestable("backlash", "a", "one"), NotTestable("backlash", "b", "other"))
    assert [row[1:] for row in untestable_rows(entries, JOINTS)] == [("a", "one"), ("b", "other")]


def test_the_interval_of_a_noise_floor_is_broken_nowhere():
    joint = dataclasses.replace(JOINTS[0], noise_floor_interval=(8.61e-5, 0.00321))
    _, interval = gap_row(joint, 0)[4].split(" ")
    assert interval == f"(8.61e\N{NON-BREAKING HYPHEN}05{NO_BREAK}to{NO_BREAK}0.00321)"


def test_cells_of_a_wide_table_name_their_column_for_a_narrow_screen(made_up):
    page = report_html(made_up(samples=400))
    (table,) = re.findall(r"<h3>Gap of each joint</h3>.*?</table>", page, re.DOTALL)
    heads = re.findall(r"<th [^>]*>(.*?)</th>", table)
    (_, first, *_) = re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL)
    assert 'class="stacked"' in table
    assert re.findall(r'data-head="(.*?)"', first) == heads
