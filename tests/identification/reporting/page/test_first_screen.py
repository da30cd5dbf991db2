"""The first screen of the report. Oracles: made-up figures by hand, and the text of the page."""

from __future__ import annotations

from dataclasses import replace

import pytest

from identification.diagnosis.result import Value
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.page.first_screen import gap_bars_of, groups_of, share_curve


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


def test_a_joint_that_only_moves_within_tolerances_make_worse_shows_the_given_model_and_no_gap(made_up):
    # By hand: noise up to 0.032, and a given model that leaves less.
    made = made_up(("j1",))
    joint = replace(made.joints[0], rms_before=0.0315)
    assert gap_bars_of(replace(made, joints=(joint,)))[0][0].text.replace("\N{NO-BREAK SPACE}", " ") == (
        "0.0315 → 0.031 N m, no gap"
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
