"""One log with torques and poses. Oracle: an arm whose encoder reads too much, moved by the inverse dynamics of where
it truly is, with forward kinematics written without Pinocchio."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.result import Diagnosis
from identification.export.all_files import export_texts
from identification.export.corrected.corrected_yaml import write_corrected
from identification.pipeline import diagnose
from identification.reporting.diagnosis_summary import summary
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.stored.diagnosis_files import to_json
from identification.words.geometry_words import all_findings
from identification.words.note_words import sentences
from places import ROBOTS
from tests.common.measured_poses import TrueRobot, measured, pose, quaternions

OFFSET = 0.05


@pytest.fixture(scope="module")
def found(lab, arm, trusted) -> Diagnosis:
    motion = lab.motion(3, seconds=8.0)
    recording = lab.recording(arm, motion)
    moved = {joint: motion.q[:, k] for k, joint in enumerate(arm.joint_names)}
    text = (ROBOTS / "arm3.urdf").read_text()
    p, R = measured(TrueRobot(text), "tool", moved, tracker=pose((1, 2, 0), (0, 0, 1)))
    p = p + 1e-4 * np.random.default_rng(0).standard_normal(p.shape)
    q = recording.q + OFFSET * (np.arange(3) == 1)
    posed = replace(recording, q=q, positions={"tool": p}, orientations={"tool": quaternions(R)})
    return diagnose(trusted(arm), (posed,))


def _zeros(findings) -> list[float]:
    return [one.parameters["offset"].value for one in findings if (one.effect, one.joint) == ("encoder_offset", "tilt")]


def test_the_zero_is_found_in_poses_beside_what_torques_show(found):
    assert _zeros(all_findings(found)[len(found.findings) :]) == [pytest.approx(OFFSET, abs=2e-4)]


def test_a_zero_that_both_show_is_told_to_be_the_same(found):
    assert _zeros(found.findings) == [pytest.approx(OFFSET, rel=0.1)]
    assert found.geometry is not None
    (sentence,) = sentences(found.geometry.notes)
    assert sentence.startswith("The zero of tilt is off by")
    assert sentence.endswith("they agree.")


def test_the_file_has_the_findings_of_both_and_one_verdict(found):
    content = to_json(found)
    findings = content["findings"]
    assert isinstance(findings, list)
    assert [one.get("measured") for one in findings if isinstance(one, dict)][-1] == "poses"
    assert content["verdict"] == "explained"


def test_terminal_and_page_tell_both(found, arm):
    said, page = summary(found), report_html(found, arm)
    assert "RMS torque residual" in said
    assert "Measured poses: tool is off by" in said
    assert "Gap of each joint" in page
    assert "<h2>Measured poses</h2>" in page


def test_a_zero_that_both_show_is_corrected_once(found):
    assert write_corrected(found, "arm3.urdf", "").count("effect: encoder_offset") == 1


@pytest.mark.parametrize(("by_torque", "said"), [(True, False), (False, True)])
def test_a_law_for_control_says_what_only_poses_showed(found, arm, tmp_path, by_torque, said):
    # Without its findings the model leaves more than is claimed, so nothing is run.
    one = found if by_torque else replace(found, findings=(), replay=None)
    _, noted = export_texts(one, arm, folder=tmp_path)
    assert (
        any("feedforward.py has no place for what poses showed: it has tilt" in note for note in sentences(noted.notes))
        == said
    )
