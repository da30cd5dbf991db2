import dataclasses
import json
import re

import pytest

from html_page import Page
from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Diagnosis, NotTestable, Unexplained
from identification.notes import Code, Note
from identification.reporting.page.diagnosis_report import report_html
from phantom_dyn.model.robot import Robot


def without_scripts(html: str) -> str:
    return re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL)


def page(diagnosis: Diagnosis) -> Page:
    return Page(report_html(diagnosis))


@pytest.fixture(scope="module")
def html(made_up) -> str:
    return report_html(made_up(findings=2, samples=400))


@pytest.fixture(scope="module")
def shown(html) -> Page:
    return Page(html)


def test_sections_stand_in_the_order_of_the_questions(shown):
    assert shown.headings == [
        "Residuals joint by joint", "Where the gap is", "Gap of each joint", "The findings one by one",
        "1. Coulomb friction on joint j1", "2. Viscous friction on joint j2", "When the gap shows",
        "What the model's tolerances explain", "What is left", "Why not something else?",
        "What was ruled out, and what could not be tested",
        "Notes",
    ]  # fmt: skip


def test_every_tag_is_closed(shown):
    assert shown.open == []


def test_a_finding_is_reported_in_whole_sentences(shown):
    for part in (
        "The recording shows viscous friction of 0.13 N m s/rad on joint j2: friction torque that grows in proportion "
        "to speed. It shows at high speed.",
        "This is very likely (93 %); it accounts for 83 % (80 to 86 %) of the gap. It may instead be presliding "
        "friction on joint j2 and a torque offset on joint j2 together (7 %).",
        "What to do: Add the coefficient to the joint's damping in the model",
    ):
        assert part in shown.text


@pytest.mark.parametrize(
    "fact",
    [
        "first.csv: 12 repeated rows were dropped",
        "The gap between robot and model is explained by Coulomb friction on joint j1 and viscous",
        "0.25100 ± 0.00060 N m",
        "torque friction torque at any speed",
        "j2 Regime Energy Where the velocity changes sign 44",
        "link2 mass +2 % ±5 %",
        "4 % of what the motion predicts is left",
        "Backlash gap 0.002 rad (joint j1)",
        "A payload mass 0.03 kg (the whole robot)",
        "Backlash j2 the transmitted torque never changes sign",
        "phantom-dyn 0.1.0 · 4.2 s · analysed band 0 to 25 Hz",
        "first.csv, second.csv",
        "The band was chosen from the data.",
        "Noise floor",
        "Held out",
    ],
)
def test_the_page_tells(shown, fact):
    assert fact in shown.text


def test_warnings_are_counted_beside_the_answer_and_stand_in_the_notes(shown):
    # The answer is the first screen; one note is of the recording, one of the findings.
    assert "2 notes about the recordings, the findings and the files." in shown.text
    assert shown.text.index("Notes About the recordings") < shown.text.index("repeated rows")


def test_the_page_fetches_nothing(html):
    linked = re.findall(r'(?:href|src)="([^"]*)"|url\(([^)]*)\)', without_scripts(html))
    assert all((a or b).startswith(("#", "data:")) for a, b in linked)
    assert not re.search(r"@import|<script [^>]*src|<link|<iframe|<!DOCTYPE svg|fetch\(|import\(", html)


def test_names_with_markup_are_escaped(made_up):
    nasty = "<script>alert(1)</script>&\"'"
    diagnosis = dataclasses.replace(
        made_up((nasty, "j2"), findings=2, samples=400), robot=nasty, recordings=(nasty,), data_warnings=(nasty,),
        notes=(nasty,), next_experiment={"say": nasty}, version=nasty,
        rollout={"rms_before": {nasty: 0.1}, "rms_after": {nasty: None}},
    )  # fmt: skip
    html = report_html(diagnosis)
    # The samples and what draws them are the only scripts.
    assert html.count("<script") == 2
    assert "script" not in {tag for tag, _ in Page(without_scripts(html)).tags}
    assert nasty in Page(html).text


def test_every_joint_and_finding_of_a_small_robot_has_its_figures(made_up):
    assert without_scripts(report_html(made_up(findings=3, samples=400))).count("<svg") == 3 * 2 + 3


def test_a_page_of_a_robot_with_many_joints_and_findings_leaves_room_for_the_drawn_robot(made_up):
    names = tuple(f"shoulder_pan_joint_of_the_left_arm_{k}" for k in range(20))
    html = report_html(made_up(names, 25, samples=8_000))
    assert without_scripts(html).count("<svg") == 20 + 12 + 2 * 6
    # A drawn robot of many meshes takes 0.1 MB more, and 2.5 MB is the most that a reader may get.
    assert len(html.encode()) < 2_400_000
    assert "Joints with the smallest share of the gap are left out." in html


def test_ids_on_the_page_are_unique(shown):
    ids = [attributes["id"] for _, attributes in shown.tags if "id" in attributes]
    assert len(ids) == len(set(ids)) > 0


def test_regimes_of_joints_without_a_gap_are_folded_away(made_up):
    diagnosis = dataclasses.replace(made_up(findings=0, samples=400), verdict="unknown")
    flat = dataclasses.replace(diagnosis.joints[1], rms_within_tolerance=diagnosis.joints[1].noise_floor)
    text = page(dataclasses.replace(diagnosis, joints=(diagnosis.joints[0], flat))).text
    assert text.index("j1 Regime") < text.index("Joints with almost no gap") < text.index("j2 Regime")


def test_bounds_are_folded_away(shown):
    assert ("details", {}) in shown.tags
    assert "What would have been seen (2)" in shown.text


def test_notes_on_corrected_files_are_folded_away_and_others_are_not(made_up):
    lacking = Note(Code.NO_PLACE, None, {"files": ("corrected.urdf",), "quantity": "lag", "values": {"j1": 0.1}})
    diagnosis = dataclasses.replace(
        made_up(("j1",), findings=0, samples=400), notes=("corrected: mind the gap.", lacking)
    )
    before, _, folded = report_html(diagnosis).partition("What the corrected files hold, and what they cannot hold (1)")
    assert "corrected: mind the gap." in before
    assert "corrected.urdf: it has no place for lags [s]: j1 0.1." in folded
    assert "corrected.urdf: it has no place." not in before


def test_nothing_found_is_said(made_up):
    shown = page(made_up(("j1",), findings=0, samples=400))
    assert "No effect of the catalogue was found." in shown.text
    assert not [heading for heading in shown.headings if heading.startswith("1.")]


def test_a_diagnosis_with_nothing_in_it_still_has_a_page(made_up):
    empty = made_up(("j1",), findings=0, samples=2)
    none = Evidence(*(array[:0] for array in dataclasses.astuple(empty.evidence)[:7]), ({},))
    diagnosis = dataclasses.replace(
        empty, verdict="not_testable", adjusted=(), bounds=(), not_testable=(), data_warnings=(), notes=(),
        recordings=(), evidence=none,
    )  # fmt: skip
    shown = page(diagnosis)
    assert "This recording cannot show a gap" in shown.text
    assert "Residuals joint by joint" not in shown.headings


def test_a_simulated_motion_is_shown_with_its_unit(made_up):
    rollout = {"horizon_s": 0.5, "rms_before": {"j1": 0.0123}, "rms_after": {"j1": 0.0045}}
    text = page(dataclasses.replace(made_up(("j1",), findings=0, samples=400), rollout=rollout)).text
    assert "j1 0.0123 0.0045 rad" in text
    assert "over 0.5 s" in text


def test_the_simulated_motion_of_each_of_several_recordings_is_shown(made_up):
    one = {"recording": "b.csv", "rms_before": {"j1": 0.3}, "rms_after": {"j1": 0.07}}
    rollout = {"horizon_s": 0.5, "rms_before": {"j1": 0.2}, "rms_after": {"j1": 0.1}, "recordings": [one]}
    text = page(dataclasses.replace(made_up(("j1",), findings=0, samples=400), rollout=rollout)).text
    assert "j1 0.2 0.1 rad" in text
    assert "j1 in b.csv 0.3 0.07 rad" in text


def test_the_next_experiment_is_shown(made_up):
    say = "Move joint j1 slowly back and forth."
    assert (
        say in page(dataclasses.replace(made_up(("j1",), findings=0, samples=400), next_experiment={"say": say})).text
    )


@pytest.fixture(scope="module")
def drawn(made_up, planar2: Robot) -> str:
    return report_html(made_up(planar2.joint_names, findings=2, samples=400), planar2)


def test_with_a_robot_the_page_holds_all_that_draws_it_and_stays_small(drawn):
    # The largest that a reader may get is 2.5 MB; this one has two joints and few samples.
    assert 'getElementById("robot-scene")' in drawn
    assert len(drawn.encode()) < 500_000


def test_with_a_robot_the_page_still_fetches_nothing(drawn):
    scripts = [attributes for tag, attributes in Page(drawn).tags if tag == "script"]
    # The robot and the curves over time, each with what draws it.
    assert len(scripts) == 4
    assert not any("src" in attributes for attributes in scripts)
    linked = re.findall(r'(?:href|src)="([^"]*)"|url\(([^)]*)\)', without_scripts(drawn))
    assert all((a or b).startswith(("#", "data:")) for a, b in linked)


def test_the_figure_of_the_robot_is_json_whatever_joints_are_called(made_up, planar2):
    nasty = "</script><b>\u2028"
    joints = (nasty, "elbow")
    model = planar2.model.copy()
    model.names[1] = nasty
    robot = dataclasses.replace(planar2, model=model, joint_names=joints)
    page = report_html(made_up(joints, samples=400), robot)
    text = re.search(r'<script type="application/json" id="robot-figure">(.*?)</script>', page, re.DOTALL)
    assert text is not None
    assert len(json.loads(text[1])["solids"]) == 4
    assert "<" not in text[1]


def test_the_list_beside_the_robot_says_each_joints_share_of_the_gap(drawn):
    # The made-up joints are 8.3 noise floors each before.
    assert re.search(r"</i>shoulder<b>50\N{NO-BREAK SPACE}%</b></li>", drawn)


def test_a_page_says_where_links_are_drawn_as_capsules(drawn):
    assert "links are\ndrawn as capsules" in drawn


def test_a_rest_of_unknown_cause_is_drawn(made_up):
    rest = Unexplained(0.4, True, "j2", "time_drift")
    plain = made_up(("j1", "j2"), findings=0, samples=400)
    drawn = dataclasses.replace(plain, unexplained=rest)
    assert report_html(drawn).count("<svg") == report_html(plain).count("<svg") + 1


def test_a_finding_of_the_whole_robot_has_a_card_and_a_figure(made_up):
    finding = dataclasses.replace(made_up().findings[0], effect="base_tilt", joint=None, regime="posture")
    shown = page(dataclasses.replace(made_up(samples=400), findings=(finding,)))
    assert "1. A tilted base 83" in shown.text
    assert any("Residual of joint j" in (attributes.get("aria-label") or "") for _, attributes in shown.tags)


def test_time_in_each_regime_stands_beside_its_energy(made_up):
    diagnosis = made_up(samples=400)
    times = ({"velocity_reversal": 0.1, "low_speed": 0.2, "high_load": 0.3, "everywhere": 1.0},) * 2
    evidence = dataclasses.replace(diagnosis.evidence, regime_times=times)
    text = page(dataclasses.replace(diagnosis, evidence=evidence)).text.replace("\N{NO-BREAK SPACE}", " ")
    assert "Where the velocity changes sign 44 % 10 % " in text


def test_not_testable_effects_of_one_reason_share_a_row(made_up):
    names = ("j1", "j2", "j3")
    entries = [
        NotTestable(e, j, "a sensor measures the torque") for e in ("input_delay", "actuator_lag") for j in names
    ]
    text = page(dataclasses.replace(made_up(names, findings=0, samples=400), not_testable=tuple(entries))).text
    assert "An input delay and actuator lag all joints a sensor measures the torque" in text


def test_the_five_nearest_effects_say_why_they_are_not_named(made_up):
    page = report_html(made_up(findings=1, samples=400))
    section = page.split("<h2>Why not something else?</h2>")[1].split("<h2>")[0]
    assert section.count("<details>") == 5
    assert "A payload would close 61\N{NO-BREAK SPACE}% of the gap; it is not named because Coulomb friction" in section
    assert "failed  more than chance: 3.5, needed 20 (gain)" in section


def test_without_a_ledger_the_page_has_no_such_section(made_up):
    assert "Why not something else?" not in report_html(
        dataclasses.replace(made_up(findings=1, samples=400), ledger=())
    )


def test_a_page_of_a_model_that_fits_paints_no_joint_and_gives_no_share(made_up, planar2):
    joints = tuple(dataclasses.replace(gap, rms_before=3.0 * gap.noise_floor) for gap in made_up().joints)
    made = dataclasses.replace(made_up(("shoulder", "elbow")), verdict="no_gap", findings=())
    joints = tuple(dataclasses.replace(own, joint=gap.joint) for own, gap in zip(joints, made.joints, strict=True))
    text = report_html(dataclasses.replace(made, joints=joints), robot=planar2)
    assert "On no joint is more left than noise and the errors of a sound model may leave." in Page(text).text
    assert not re.search(r"Joint \w+, ", Page(text).text)
    colours = set(re.findall(r'<i style="background: (#[0-9a-f]{6})">', text))
    assert colours == {"#d3dae3"}


def test_a_page_of_what_cannot_be_judged_does_not_say_that_the_model_fits(made_up, planar2):
    made = made_up(("shoulder", "elbow"))
    joints = tuple(
        dataclasses.replace(
            gap, rms_before=0.0, rms_within_tolerance=0.0, rms_after=0.0, hold_out_samples=0, closed=None
        )
        for gap in made.joints
    )
    made = dataclasses.replace(made, verdict="not_testable", findings=(), joints=joints)
    text = Page(report_html(made, robot=planar2)).text
    assert "The model fits" not in text
    assert "This recording cannot show a gap of any joint." in text
    assert "not judged" in text
