import dataclasses
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from identification.reporting.charts.chart import short_name
from identification.reporting.page.explaining import joint_motions
from identification.reporting.page.gap_figures import (
    finding_figure,
    residual_over_position,
    residual_over_velocity,
    torque_figure,
    unexplained_figure,
)

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
