"""The page of an identification: whole, self-contained, everything in it."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from identification.identify.identification_report import report_html
from identification.identify.identification_words import summary

VOID = {"meta", "br", "img", "link", "input", "hr"}


class Page(HTMLParser):
    """Text and tags of a page; closing tags must match."""

    def __init__(self, html: str):
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(html)
        self.close()
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data + " "


@pytest.fixture(scope="module")
def html(found) -> str:
    return report_html(found)


@pytest.fixture(scope="module")
def page(html) -> Page:
    return Page(html)


def test_every_tag_is_closed(page):
    assert page.open == []


def test_the_page_fetches_nothing(page, html):
    sources = [value for _, attributes in page.tags for key, value in attributes.items() if key in ("src", "href")]
    assert all(value and value.startswith(("#", "data:")) for value in sources)
    assert "@import" not in html
    assert len(html) < 1_000_000


def test_every_parameter_is_on_the_page(page, found):
    assert all(parameter.name in page.text for parameter in found.base)
    assert page.text.count("Coulomb friction") == 3
    assert all(entry.name in page.text for entry in found.unidentified)


def test_regroupings_stand_below_their_parameter(page, found):
    sums = [parameter.regroups for parameter in found.base if parameter.regroups]
    assert sums
    assert [text for text in sums if f"= {text}" not in page.text] == []


def test_every_body_has_ten_marks(page, found):
    marks = [attributes for tag, attributes in page.tags if tag == "span" and "aria-label" in attributes]
    assert len(marks) == 10 * len(found.bodies)
    assert sum(mark["aria-label"] == "not at all" for mark in marks) == sum(
        share == "none" for body in found.bodies for share in body.this_recording.values()
    )


def test_every_joint_has_torques_and_a_spectrum(page, found):
    titles = [attributes.get("aria-label") or "" for tag, attributes in page.tags if tag == "svg"]
    assert len(found.joints) == 3
    for joint in found.joints:
        assert f"Measured and predicted torque of joint {joint.joint} on held-out data" in titles
        assert f"Spectra of joint {joint.joint}: torque and residual" in titles


def test_what_is_held_out_is_said(page, found):
    assert f"Held out: {found.held_out}." in page.text


def test_names_are_escaped(found):
    odd = replace(found, robot="<script>alert(1)</script>", recordings=("a&b.csv",))
    html = report_html(odd)
    assert "<script>alert" not in html
    assert "a&amp;b.csv" in html


def test_a_mark_says_what_another_motion_would_tell(found):
    body = replace(found.bodies[0], this_recording={**found.bodies[0].this_recording, "Izz": "none"})
    html = report_html(replace(found, bodies=(body,)))
    assert re.search(r'class="mark none missing"[^>]*aria-label="not at all, with other motion in combination"', html)


def test_a_page_without_deviations_and_spectra_is_whole(found):
    nothing = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    evidence = replace(found.evidence, frequency=nothing[0], measured_density=nothing[1], residual_density=nothing[2])
    others = tuple(replace(parameter, std=float("nan"), identified=False) for parameter in found.others)
    page = Page(report_html(replace(found, evidence=evidence, others=others)))
    assert page.open == []
    assert "nan" not in page.text


def test_the_summary_names_joints_friction_and_files(found):
    text = summary(found)
    assert text.startswith("21 parameters were estimated")
    assert "turn.coulomb_friction.torque: 1.59997 ± 0.00023 N m" in text
    assert "corrected.xml: Loaded again with MuJoCo" in text
