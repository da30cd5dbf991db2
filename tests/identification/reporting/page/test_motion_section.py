"""Simulated motion on the page of a diagnosis. Oracle: the samples that were put into it."""

from __future__ import annotations

import base64
import dataclasses
import json
import re

import numpy as np
import pytest

from identification.diagnosis.evidence import Followed
from identification.diagnosis.result import Diagnosis
from identification.reporting.page.diagnosis_report import report_html

WINDOW = 100


@pytest.fixture
def moved(made_up) -> Diagnosis:
    """Every other window of a hundred samples was simulated; the given model of j2 strays by up to 1 rad."""
    made = made_up(findings=1, samples=1000)
    q = made.evidence.q
    strayed = (np.arange(1000) % WINDOW / WINDOW)[:, None] * np.array([0.0, 1.0, 0.0][: q.shape[1]])
    simulated = (np.arange(1000) // WINDOW % 2 == 0) & (np.arange(1000) % WINDOW > 0)
    before, after = (np.where(simulated[:, None], x, np.nan) for x in (q + strayed, q + 0.0))
    followed = Followed(before, after, 0.5, controlled=False)
    return dataclasses.replace(made, evidence=dataclasses.replace(made.evidence, followed=followed))


def curves(page: str) -> dict[str, dict]:
    found = re.search(r'<script type="application/json" id="time-curves">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return {one["id"]: one for one in json.loads(found[1])}


def numbers(curve: dict) -> np.ndarray:
    steps = np.frombuffer(base64.b64decode(curve["values"]), dtype="<i2").astype(float)
    return np.where(steps < -32767, np.nan, steps * curve["step"])


def test_motion_is_the_first_section_behind_the_answer_and_torque_comes_later(moved):
    headings = re.findall(r"<h2[^>]*>(.*?)</h2>", report_html(moved))
    assert headings[0] == "The motion"
    assert headings.index("Residuals joint by joint") > headings.index("Where the gap is")


def test_without_simulated_motion_torque_stands_in_its_place_and_that_is_said(made_up):
    page = report_html(made_up(findings=1, samples=400))
    assert re.findall(r"<h2[^>]*>(.*?)</h2>", page)[0] == "Residuals joint by joint"
    assert "No motion was simulated, so torque over time stands here." in page


def test_the_errors_are_those_of_both_models_and_nothing_stands_between_windows(moved):
    shown = curves(report_html(moved))["positions-1"]
    before, after = numbers(shown["before"]), numbers(shown["after"])
    t = np.frombuffer(base64.b64decode(shown["t"]), dtype="<f4")
    rows = np.searchsorted(moved.evidence.t, t - 1e-4)
    expected = moved.evidence.q[rows, 1] - moved.evidence.followed.before[rows, 1]
    np.testing.assert_allclose(before, expected, atol=1e-4)
    np.testing.assert_allclose(after[np.isfinite(after)], 0.0, atol=1e-9)
    assert np.isnan(before[rows // WINDOW % 2 == 1]).all()


def test_a_gap_of_the_recording_is_a_gap_of_the_curves(made_up):
    made = made_up(findings=1, samples=1000)
    valid = np.ones(1000, dtype=bool)
    valid[100:300] = False
    gap = dataclasses.replace(made, evidence=dataclasses.replace(made.evidence, valid=valid))
    whole, broken = (curves(report_html(one))["curves-0"] for one in (made, gap))
    t = np.frombuffer(base64.b64decode(broken["t"]), dtype="<f4")
    # Between the two recordings there is one more.
    assert len(whole["starts"]) == 1
    assert t[broken["starts"]] == pytest.approx(made.evidence.t[[300, 500]])
    assert not ((t > made.evidence.t[100]) & (t < made.evidence.t[299])).any()


def test_files_and_the_command_line_are_at_the_foot(made_up):
    made = dataclasses.replace(made_up(samples=400), command="phantom-dyn diagnose arm.urdf 'a b.csv'")
    page = report_html(made, beside=("diagnosis.json", "corrected.urdf"))
    assert "<code>phantom-dyn diagnose arm.urdf &#39;a b.csv&#39;</code>" in page
    assert '<a href="corrected.urdf">corrected.urdf</a>' in page


@pytest.mark.parametrize("verdict", ["explained", "partly_explained", "unknown"])
def test_the_headline_is_short_and_what_it_leaves_out_comes_behind(made_up, verdict):
    joints = tuple(f"left_arm_of_the_robot_{k}_joint" for k in range(6))
    made = dataclasses.replace(made_up(joints, findings=6, samples=400), verdict=verdict)
    page = report_html(made)
    (head,) = re.findall(r'<p class="verdict">(.*?)</p>', page, re.DOTALL)
    assert len(head) <= 128
    assert '<p class="reservations">' in page
