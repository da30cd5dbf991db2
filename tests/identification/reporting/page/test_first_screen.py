"""First screen of a report and its tables."""

import dataclasses
import re
from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.result import Bound, JointGap, NotTestable, Value
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.page.first_screen import gap_bars_of, groups_of, share_curve
from identification.reporting.page.report_tables import detectable_sizes, gap_row, regime_table, untestable_rows
from identification.reporting.page.robot_scene import gap_shares, joint_colours, shares_of
from identification.words.numbers_and_names import NO_BREAK


def findings(made, *places, share=0.2):
    """The diagnosis with findings of these effects on these joints."""
    effects = {
        "coulomb": ("coulomb_friction", {"torque": Value(0.25, 0.01, "N m")}),
        "viscous": ("viscous_friction", {"coefficient": Value(0.13, 0.02, "N m s/rad")}),
        "payload": ("payload", {"mass": Value(0.5, 0.01, "kg"), "center_z": Value(0.1, 0.01, "m")}),
    }
    out = []
    for k, place in enumerate(places):
        name, _, joint = place.partition(" ")
        effect, parameters = effects[name]
        out.append(
            replace(
                made.findings[0],
                effect=effect,
                joint=joint or None,
                parameters=parameters,
                share=share,
                probability=0.99 - 0.1 * k,
            )
        )
    return replace(made, findings=tuple(out))


def test_bars_are_in_noise_floors_on_one_scale(made_up):
    # By hand: both joints have 8 noise floors within tolerance, and 31/30 of one after.
    bars, more = gap_bars_of(made_up())
    assert [bar.before for bar in bars] == pytest.approx([100, 100])
    assert bars[0].after == pytest.approx(100 * 0.031 / 0.24)
    assert bars[0].floor == pytest.approx(12.5)
    assert more == 0


def test_a_bar_says_the_gap_before_and_after_and_what_is_closed(made_up):
    bar = gap_bars_of(made_up())[0][0]
    assert bar.text.replace("\N{NO-BREAK SPACE}", " ") == "0.24 → 0.031 N m, 99 % closed"


@pytest.mark.parametrize(("within", "said"), [(0.02, "0.02 → 0.031 N m, no gap"), (0.24, "0.24 → 0.031 N m")])
def test_a_joint_without_a_gap_says_so_and_one_of_unknown_share_says_none(made_up, within, said):
    made = made_up(("j1",))
    joint = replace(made.joints[0], closed=None, rms_within_tolerance=within)
    assert gap_bars_of(replace(made, joints=(joint,)))[0][0].text.replace("\N{NO-BREAK SPACE}", " ") == said


def test_a_joint_with_much_left_in_a_wide_interval_of_its_noise_may_have_a_gap(made_up):
    # By hand: a tenth of the torque, in a noise of up to twice that.
    made = made_up(("j1",))
    joint = replace(made.joints[0], closed=None, rms_within_tolerance=0.2, rms_after=0.2, rms_torque=2.0)
    (bar,), _ = gap_bars_of(replace(made, joints=(replace(joint, noise_floor_interval=(0.03, 0.4)),)))
    assert bar.text.endswith("may be a gap")


def test_a_joint_that_only_moves_within_tolerances_make_worse_shows_the_given_model_and_no_gap(made_up):
    # By hand: noise up to 0.032, and a given model that leaves less.
    made = made_up(("j1",))
    joint = replace(made.joints[0], rms_before=0.0315)
    assert gap_bars_of(replace(made, joints=(joint,)))[0][0].text.replace("\N{NO-BREAK SPACE}", " ") == (
        "0.0315 N m, no gap"
    )


def test_a_finding_alone_without_a_share_has_what_comes_back_without_it(made_up):
    # The made-up finding closes 83 %.
    (group,) = groups_of(findings(made_up(), "coulomb j1", share=None))
    assert (group.share, group.width) == ("83\N{NO-BREAK SPACE}%", pytest.approx(83.0))


def test_of_many_joints_those_with_the_largest_gap_have_bars_in_the_robots_order(made_up):
    made = made_up(tuple(f"j{k}" for k in range(10)))
    small = (replace(made.joints[0], rms_within_tolerance=made.joints[0].noise_floor), *made.joints[1:])
    bars, more = gap_bars_of(replace(made, joints=small))
    assert [bar.joint for bar in bars] == [f"j{k}" for k in range(1, 9)]
    assert more == 2


def test_a_noise_floor_of_nothing_leaves_bars_of_finite_width(made_up):
    made = made_up(("j1",))
    bars, _ = gap_bars_of(replace(made, joints=(replace(made.joints[0], noise_floor=0.0),)))
    assert (bars[0].before, bars[0].after, bars[0].floor) == (0, 0, 0)


@pytest.mark.parametrize(
    ("joints", "places", "names"),
    [
        (2, ["coulomb j0"], ["Coulomb friction on joint j0"]),
        (3, ["coulomb j0", "coulomb j1"], ["Coulomb friction on joints j0 and j1"]),
        (3, ["coulomb j0", "coulomb j1", "coulomb j2"], ["Coulomb friction on all 3 joints"]),
        (
            3,
            [f"{kind} j{k}" for k in range(3) for kind in ("coulomb", "viscous")],
            ["Coulomb friction and viscous friction on all 3 joints"],
        ),
        (
            3,
            ["coulomb j0", "coulomb j1", "viscous j1"],
            ["Coulomb friction on joints j0 and j1", "Viscous friction on joint j1"],
        ),
        (2, ["coulomb j0", "viscous j0"], ["Coulomb friction on joint j0", "Viscous friction on joint j0"]),
        (2, ["coulomb j0", "payload"], ["Coulomb friction on joint j0", "A payload"]),
    ],
)
def test_effects_of_one_kind_stand_together(made_up, joints, places, names):
    made = findings(made_up(tuple(f"j{k}" for k in range(joints))), *places)
    assert [group.name for group in groups_of(made)] == names


def test_a_share_below_nothing_is_no_figure_of_the_first_screen(made_up):
    (group,) = groups_of(findings(made_up(), "coulomb j1", share=-0.01))
    assert (group.share, group.width) == ("", 0.0)


def test_a_group_has_the_sum_of_the_shares_and_the_least_certainty(made_up):
    (group,) = groups_of(findings(made_up(), "coulomb j1", "coulomb j2", share=0.45))
    assert group.share == "90\N{NO-BREAK SPACE}%"
    assert group.sure == "likely (89\N{NO-BREAK SPACE}%)"


def test_a_group_of_one_parameter_says_its_range(made_up):
    made = findings(made_up(), "coulomb j1", "coulomb j2")
    larger = replace(made.findings[1], parameters={"torque": Value(0.4, 0.01, "N m")})
    (group,) = groups_of(replace(made, findings=(made.findings[0], larger)))
    assert group.size == "0.25 to 0.4 N m"


def test_the_largest_group_comes_first(made_up):
    made = findings(made_up(), "coulomb j1", "viscous j2")
    second = replace(made.findings[1], share=0.7)
    assert groups_of(replace(made, findings=(made.findings[0], second)))[0].name == "Viscous friction on joint j2"


def test_the_curve_needs_two_findings_with_shares(made_up):
    assert share_curve(findings(made_up(), "coulomb j1")) == ""
    assert share_curve(findings(made_up(), "coulomb j1", "viscous j1", share=None)) == ""
    assert "number of effects, the largest first" in share_curve(findings(made_up(), "coulomb j1", "viscous j1"))


def test_the_curve_ends_at_the_whole_gap_if_the_correction_is_below_the_noise_floor(made_up):
    def curve(second):
        made = findings(made_up(), "coulomb j1", "viscous j1", share=0.6)
        return share_curve(replace(made, findings=(made.findings[0], replace(made.findings[1], share=second))))

    assert curve(0.43) == curve(0.4)
    assert curve(0.39) != curve(0.4)


def test_the_answer_stands_before_everything_else_on_the_page(made_up):
    made = findings(made_up(samples=400), "coulomb j1", "viscous j1")
    page = report_html(made)
    order = [
        "is explained by",
        "0.24\N{NO-BREAK SPACE}→",
        "<ol>",
        "Where the gap is",
        "The findings one by one",
    ]
    body = page[page.index("<body>") :]
    places = [body.index(part) for part in order]
    assert places == sorted(places)
    assert body.index('id="notes"') > body.index("What was ruled out")


def test_names_are_escaped_on_the_first_screen(made_up):
    page = report_html(findings(made_up(("<b>", "j2"), samples=400), "coulomb <b>", "viscous <b>"))
    assert "on joint &lt;b&gt;" in page
    assert "on joint <b>" not in page


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
    assert [(row.time, row.emphasised) for row in rows] == [(f"55{NO_BREAK}%", False), (f"10{NO_BREAK}%", True)]


def test_half_of_the_energy_in_one_direction_is_nothing_special(made_up):
    assert not regimes(made_up, {"one_direction": 0.54})[0].emphasised
    assert regimes(made_up, {"one_direction": 0.9})[0].emphasised


def test_a_joint_without_regimes_has_an_empty_table(made_up):
    diagnosis = made_up(samples=20)
    evidence = dataclasses.replace(diagnosis.evidence, regime_shares=())
    assert regime_table(dataclasses.replace(diagnosis, evidence=evidence), 1) == []


def test_bounds_of_one_parameter_are_gathered_over_the_joints():
    bounds = tuple(Bound("backlash", name, "gap", size, "rad") for name, size in (("a", 0.002), ("b", 0.01)))
    (row,) = detectable_sizes(bounds)
    assert (row.effect, row.parameter, row.short) == ("Backlash", "gap", "0.002 to 0.01 rad (2 joints)")
    assert row.places == (("a", "0.002 rad"), ("b", "0.01 rad"))


@pytest.mark.parametrize(("joints", "said"), [("abc", "3 joints"), ("a", "1 joint")])
def test_a_bound_of_the_whole_robot_is_no_joint(joints, said):
    bounds = tuple(Bound("torque_delay", joint, "time", 0.02, "s") for joint in (None, *joints))
    assert detectable_sizes(bounds)[0].short == f"0.02 s ({said} and the whole robot)"


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


def gaps(*ratios: float, floor: float = 0.1) -> tuple[JointGap, ...]:
    return tuple(JointGap(f"j{k}", "N m", ratio * floor, floor, floor, 10) for k, ratio in enumerate(ratios))


def test_shares_are_mean_squares_beyond_the_noise_floor():
    # Closed form: (2^2 - 1) : (3^2 - 1).
    assert gap_shares(gaps(2.0, 3.0, 1.0)) == pytest.approx([3 / 11, 8 / 11, 0])


def test_without_a_gap_no_joint_has_a_share():
    assert gap_shares(gaps(1.0, 0.8)).tolist() == [0, 0]


@pytest.mark.parametrize(
    ("interval", "discrepancy"), [((0.09, 0.31), None), ((0.1, 0.1), 0.3)], ids=["interval", "discrepancy"]
)
def test_a_joint_whose_residual_may_be_noise_has_no_share(interval, discrepancy):
    # By hand: 0.3 N m is left, and noise and a sound model may leave 0.31 N m; the other joint is far above its own.
    one, other = gaps(3.0, 5.0)
    one = dataclasses.replace(one, noise_floor_interval=interval, discrepancy=discrepancy)
    assert gap_shares((one, other)).tolist() == [0, 1]


@pytest.mark.parametrize(
    ("verdict", "shares"), [("explained", [3 / 11, 8 / 11]), ("no_gap", [0, 0]), ("not_testable", [0, 0])]
)
def test_what_a_model_that_fits_leaves_is_noise_and_no_share(made_up, verdict, shares):
    made = dataclasses.replace(made_up(), verdict=verdict, joints=gaps(2.0, 3.0))
    assert shares_of(made) == pytest.approx(shares)


@pytest.mark.parametrize("floor", [0.0, np.nan])
def test_a_joint_without_a_noise_floor_has_no_share(floor):
    joints = (*gaps(2.0), JointGap("x", "N m", 1.0, 1.0, floor, 10))
    assert gap_shares(joints).tolist() == [1, 0]


def test_the_largest_share_has_the_full_colour_and_none_is_grey():
    assert joint_colours(np.array([0.4, 0.0, 0.2]))[:2] == ["#e86600", "#d3dae3"]
