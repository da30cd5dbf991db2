from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser

import pytest

from identification.diagnosis.report import report_html
from identification.diagnosis.result import Diagnosis, Evidence

VOID = {"meta", "br", "img", "link", "input", "hr"}


class Page(HTMLParser):
    """Text, headings and balance of a page."""

    def __init__(self, html: str):
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []
        self.text = ""
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(html)
        self.close()
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag in ("h2", "h3"):
            self.headings.append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" in self.open:
            return
        self.text += data + ("" if self.open and self.open[-1] in ("b", "strong") else " ")
        if self.open and self.open[-1] in ("h2", "h3"):
            self.headings[-1] += data.strip()


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
        "What was found", "Sizes", "Gap of each joint", "Where the gap shows", "Joint j1", "Joint j2",
        "Share of the given model's residual energy, by regime", "What the model's tolerances explain", "What is left",
        "What was ruled out, and what could not be tested", "Not testable with this recording",
    ]  # fmt: skip


def test_every_tag_is_closed(shown):
    assert shown.open == []


def test_a_finding_is_told_in_five_parts(shown):
    for part in (
        "Viscous friction",
        "joint j2, at high speed",
        "very likely (93 %)",
        "accounts for 83 % (80 to 86 %) of the gap",
        "it may instead be presliding friction on joint j2 and a torque offset on joint j2 together (7 %)",
        "Add the coefficient to the joint's damping in the model",
    ):
        assert part in shown.text


@pytest.mark.parametrize(
    "fact",
    [
        "first.csv: 12 repeated rows were dropped",
        "The gap between robot and model is explained by Coulomb friction on joint j1 and viscous",
        "0.25100 ± 0.00060 N m",
        "Where the velocity changes sign 44",
        "link2 mass +2 % ±5 %",
        "4 % of what could be explained is left",
        "Backlash joint j1 gap 0.002 rad",
        "A payload the whole robot mass 0.03 kg",
        "the transmitted torque never changes sign",
        "phantom-dyn 0.1.0 · 4.2 s · analysed band 0 to 25 Hz",
        "first.csv, second.csv",
        "The band was chosen from the data.",
        "Noise floor",
        "Held out",
    ],
)
def test_the_page_tells(shown, fact):
    assert fact in shown.text


def test_warnings_stand_before_the_verdict(shown):
    assert shown.text.index("repeated rows") < shown.text.index("is explained by")


def test_the_page_fetches_nothing(html):
    linked = re.findall(r'(?:href|src)="([^"]*)"|url\(([^)]*)\)', html)
    assert all((a or b).startswith(("#", "data:")) for a, b in linked)
    assert not re.search(r"@import|<script|<link|<iframe|<!DOCTYPE svg", html)


def test_names_with_markup_are_escaped(made_up):
    nasty = "<script>alert(1)</script>&\"'"
    diagnosis = dataclasses.replace(
        made_up((nasty, "j2"), findings=2, samples=400), robot=nasty, recordings=(nasty,), data_warnings=(nasty,),
        notes=(nasty,), next_experiment={"say": nasty}, version=nasty,
        rollout={"rms_before": {nasty: 0.1}, "rms_after": {nasty: None}},
    )  # fmt: skip
    shown = page(diagnosis)
    assert "script" not in {tag for tag, _ in shown.tags}
    assert nasty in shown.text


@pytest.mark.parametrize(("joints", "findings"), [(1, 0), (3, 4), (7, 15)])
def test_the_page_stays_below_two_megabytes(made_up, joints, findings):
    names = tuple(f"shoulder_pan_joint_of_the_left_arm_{k}" for k in range(joints))
    html = report_html(made_up(names, findings, samples=20_000))
    assert len(html.encode()) < 2_000_000
    assert html.count("<svg") == 1 + 3 * joints


def test_ids_on_the_page_are_unique(shown):
    ids = [attributes["id"] for _, attributes in shown.tags if "id" in attributes]
    assert len(ids) == len(set(ids)) > 0


def test_bounds_are_folded_away(shown):
    assert ("details", {}) in shown.tags
    assert "What would have been seen (2)" in shown.text


def test_nothing_found_is_said(made_up):
    shown = page(made_up(findings=0, samples=400))
    assert "No effect of the catalogue was found." in shown.text
    assert "Sizes" not in shown.headings


def test_a_diagnosis_with_nothing_in_it_still_has_a_page(made_up):
    empty = made_up(("j1",), findings=0, samples=2)
    none = Evidence(*(array[:0] for array in dataclasses.astuple(empty.evidence)[:7]), ({},))
    diagnosis = dataclasses.replace(
        empty, verdict="not_testable", adjusted=(), bounds=(), not_testable=(), data_warnings=(), notes=(),
        recordings=(), evidence=none,
    )  # fmt: skip
    shown = page(diagnosis)
    assert "This recording cannot show a gap" in shown.text
    assert "Where the gap shows" not in shown.headings


def test_a_simulated_motion_is_shown_with_its_unit(made_up):
    rollout = {"horizon_s": 0.5, "rms_before": {"j1": 0.0123}, "rms_after": {"j1": 0.0045}}
    text = page(dataclasses.replace(made_up(samples=400), rollout=rollout)).text
    assert "j1 0.0123 0.0045 rad" in text
    assert "over 0.5 s" in text


def test_the_next_experiment_is_shown(made_up):
    say = "Move joint j1 slowly back and forth."
    assert say in page(dataclasses.replace(made_up(samples=400), next_experiment={"say": say})).text
