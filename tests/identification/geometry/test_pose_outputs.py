"""Poses alone from a file to all that is written. Oracle: forward kinematics without Pinocchio on other poses, MuJoCo,
and the numbers that were put in.

One log with torques and poses. Oracle: an arm whose encoder reads too much, moved by the inverse dynamics of where
it truly is, with forward kinematics written without Pinocchio.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from by_night import by_night
from identification.cli.main import main
from identification.data.recording import Recording
from identification.diagnosis.columns.known_geometry import with_known_places
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Diagnosis, Finding, Value
from identification.export.all_files import export_texts
from identification.export.corrected.corrected_yaml import known_effects, write_corrected
from identification.geometry.diagnose_poses import diagnose_poses
from identification.pipeline import diagnose
from identification.reporting.diagnosis_summary import summary
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.stored.diagnosis_files import json_text, to_json
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from identification.scenarios.measured_poses import diagnosis_of_poses, verdict_together, zero_notes
from identification.words.geometry_words import all_findings
from identification.words.note_words import sentences
from phantom_dyn.errors import ParameterError
from places import ROBOTS
from tests.common.measured_poses import TrueRobot, link_poses, measured, moved_joint, pose, quaternions

ZERO, PLACE = {"shoulder_lift_joint": 0.003}, ("wrist_1_joint", (0.002, 0, 0.001), (0, 0, 0))


def write(path: Path, recording: Recording) -> Path:
    columns = {"t": recording.t} | {f"q.{j}": recording.q[:, k] for k, j in enumerate(recording.joint_names)}
    for frame, p in recording.positions.items():
        columns |= {f"p.{frame}.{axis}": p[:, k] for k, axis in enumerate("xyz")}
    for frame, o in recording.orientations.items():
        columns |= {f"o.{frame}.{axis}": o[:, k] for k, axis in enumerate(("qx", "qy", "qz", "qw"))}
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    return path


@pytest.fixture
def wrong(ur10, tracked):
    """The diagnosis of a robot with a wrong zero and a wrong place."""
    return diagnosis_of_poses(ur10, (tracked(40, zeros=ZERO, moves=[PLACE], turned=True),))


def test_a_file_of_poses_alone_is_diagnosed_and_all_files_are_written(tracked, tmp_path, capsys):
    log = write(tmp_path / "poses.csv", tracked(40, zeros=ZERO, moves=[PLACE], turned=True))
    assert main(["diagnose", "example:ur10", str(log), "--out", str(tmp_path / "out")]) == 0
    stated = capsys.readouterr().out
    assert stated.startswith("Measured poses: tool0 is off by ")
    assert "zero error of shoulder_lift_joint of " in stated.replace("\n", " ")
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"diagnosis.json", "report.html", "corrected.yaml", "corrected.urdf", "corrected.xml"}


def test_the_corrected_urdf_has_the_tip_where_the_true_robot_has_it(ur10_text, tracked, tmp_path, rng):
    log = write(tmp_path / "poses.csv", tracked(41, zeros=ZERO, moves=[PLACE], turned=True, noise=1e-5))
    main(["diagnose", "example:ur10", str(log), "--out", str(tmp_path / "out")])
    text = (tmp_path / "out" / "corrected.urdf").read_text()
    assert _tip_error(text, ur10_text, rng) < 1e-4
    assert _tip_error(ur10_text, ur10_text, rng) > 1e-3


def test_the_corrected_mjcf_has_the_tip_where_the_corrected_urdf_has_it(ur10, tracked, tmp_path, rng):
    mujoco = pytest.importorskip("mujoco")
    log = write(tmp_path / "poses.csv", tracked(41, zeros=ZERO, moves=[PLACE], turned=True))
    main(["diagnose", "example:ur10", str(log), "--out", str(tmp_path / "out")])
    text = (tmp_path / "out" / "corrected.urdf").read_text()
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "corrected.xml"))
    data = mujoco.MjData(model)
    q = rng.uniform(-1, 1, 6)
    for joint, value in zip(ur10.joint_names, q, strict=True):
        data.qpos[model.jnt_qposadr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)]] = value
    mujoco.mj_forward(model, data)
    body = model.jnt_bodyid[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, "wrist_3_joint")]
    there = link_poses(text, dict(zip(ur10.joint_names, q, strict=True)))["wrist_3_link"]
    np.testing.assert_allclose(data.xpos[body], there[:3, 3], atol=1e-6)


@pytest.mark.parametrize(
    ("moves", "shown"),
    by_night(
        [
            ([PLACE], {"encoder_offset", "link_geometry", "joint_elasticity"}),
            ([PLACE, ("elbow_joint", (0, 0.002, 0), (0, 0.003, 0))], {"link_geometry", "joint_elasticity"}),
        ],
        1,
    ),
)
def test_with_what_poses_showed_the_same_poses_show_nothing_more(tracked, tmp_path, moves, shown):
    stiff = {"elbow_joint": 1 / 2e4}
    log = write(tmp_path / "poses.csv", tracked(40, zeros=ZERO, moves=moves, compliance=stiff, turned=True))
    bare, again = tmp_path / "bare", tmp_path / "again"
    assert main(["diagnose", "example:ur10", str(log), "--out", str(bare)]) == 0
    known = ["--with", str(bare / "corrected.yaml")]
    assert main(["diagnose", "example:ur10", str(log), "--out", str(again), *known]) == 0
    assert {one["effect"] for one in _json(bare)["findings"]} == shown
    assert _json(again)["findings"] == []
    assert _json(again)["verdict"] == "no_gap"


def test_files_of_a_diagnosis_with_known_poses_have_its_joints_moved_as_well(ur10_text, tracked, tmp_path, rng):
    log = write(tmp_path / "poses.csv", tracked(41, zeros=ZERO, moves=[PLACE], turned=True, noise=1e-5))
    bare, again = tmp_path / "bare", tmp_path / "again"
    main(["diagnose", "example:ur10", str(log), "--out", str(bare)])
    main(["diagnose", "example:ur10", str(log), "--out", str(again), "--with", str(bare / "corrected.yaml")])
    assert _tip_error((again / "corrected.urdf").read_text(), ur10_text, rng) < 1e-4


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (
            "{effect: link_geometry, joint: arm, parameters: {x: {value: 1, std: 1, unit: m}}, gap_closed: 1}",
            "on joint",
        ),
        (
            "{effect: link_geometry, joint: elbow_joint, parameters: {w: {value: 1, std: 1, unit: m}}, gap_closed: 1}",
            "has parameters w, wanted x or y or z or rx or ry or rz",
        ),
        ("{effect: joint_elasticity, joint: elbow_joint, parameters: {}, gap_closed: 1}", "wanted compliance"),
    ],
)
def test_what_poses_cannot_have_shown_is_refused(ur10, tmp_path, entry, said):
    path = tmp_path / "corrected.yaml"
    path.write_text(f"schema: phantom-dyn-model/1\nrobot: {{source: a, sha256: b}}\neffects: [{entry}]\nadjusted: []\n")
    with pytest.raises(ParameterError, match=said):
        known_effects((path,), ur10)


def test_a_known_place_moves_the_weight_behind_it(ur10):
    # Oracle: Pinocchio's gravity torque of a model whose elbow is moved by hand.
    known = (KnownEffect("link_geometry", "elbow_joint", (0.05, 0.0, 0.0, 0.0, 0.0, 0.0)),)
    model = ur10.model.copy()
    place = model.jointPlacements[3]
    model.jointPlacements[3] = pin.SE3(place.rotation, place.translation + place.rotation @ [0.05, 0, 0])
    q = np.array([0.2, -0.7, 0.5, 0.3, 0.1, 0.0])
    wanted = pin.computeGeneralizedGravity(model, model.createData(), q)
    moved = with_known_places(ur10, known).model
    np.testing.assert_allclose(pin.computeGeneralizedGravity(moved, moved.createData(), q), wanted, atol=1e-9)


def _json(out: Path) -> dict:
    return json.loads((out / "diagnosis.json").read_text())


def _tip_error(text: str, ur10_text: str, rng) -> float:
    """Largest distance of tips of a model and of the true robot, the pose of the base apart."""
    names = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint")
    q = {name: rng.uniform(-1, 1, 30) for name in (*names, "wrist_3_joint")}
    truth, _ = measured(TrueRobot(moved_joint(ur10_text, *PLACE), ZERO), "tool0", q)
    model, _ = measured(TrueRobot(text), "tool0", q)
    u, _, vt = np.linalg.svd((truth - truth.mean(0)).T @ (model - model.mean(0)))
    return float(np.abs(truth - truth.mean(0) - (model - model.mean(0)) @ (u @ vt).T).max())


def test_what_is_read_back_from_the_file_says_the_same(wrong, tmp_path):
    (tmp_path / "diagnosis.json").write_text(json_text(wrong))
    assert to_json(read_diagnosis(tmp_path)) == json.loads(json_text(wrong))


def test_findings_and_frames_stand_where_the_contract_has_them(wrong):
    content = json.loads(json_text(wrong))
    assert content["verdict"] == "explained"
    assert [one["frame"] for one in content["frames"]] == ["tool0", "tool0"]
    assert [one["unit"] for one in content["frames"]] == ["m", "rad"]
    places = {(one["effect"], one["joint"]) for one in content["findings"]}
    assert places == {("encoder_offset", "shoulder_lift_joint"), ("link_geometry", "wrist_1_joint")}


def test_the_page_shows_each_finding_and_no_table_of_torques(wrong, ur10):
    page = report_html(wrong, ur10)
    assert "<h2>Measured poses</h2>" in page
    assert "a wrong place of wrist_1_joint" in page
    assert "Gap of each joint" not in page


def test_the_terminal_gives_the_stiffness_that_was_found(ur10, tracked):
    found = diagnosis_of_poses(ur10, (tracked(42, compliance={"shoulder_lift_joint": 1 / 3e4}),))
    assert "Elasticity of shoulder_lift_joint (stiffness " in summary(found).replace("\n", " ")


@pytest.mark.parametrize(
    ("torques", "poses", "both"),
    [
        ("no_gap", "no_gap", "no_gap"),
        ("no_gap", "explained", "explained"),
        ("explained", "no_gap", "explained"),
        ("not_testable", "no_gap", "no_gap"),
        ("explained", "partly_explained", "partly_explained"),
        ("explained", "unknown", "unknown"),
        ("not_testable", "not_testable", "not_testable"),
    ],
)
def test_the_verdict_is_of_joints_and_frames_together(torques, poses, both):
    assert verdict_together(torques, poses) == both


@pytest.mark.parametrize(("by_torque", "end"), [(0.0031, "they agree"), (0.02, "one of the two has another cause")])
def test_a_zero_that_torques_show_as_well_is_compared(ur10, tracked, by_torque, end):
    poses = diagnose_poses(ur10, (tracked(43, zeros=ZERO),))
    offset = {"offset": Value(by_torque, 2e-4, "rad")}
    finding = Finding("encoder_offset", "shoulder_lift_joint", "posture", offset, 1.0, (1.0, 1.0), 1.0, (), "supported")
    assert poses is not None
    (sentence,) = sentences(zero_notes((finding,), poses))
    assert sentence.startswith("The zero of shoulder_lift_joint is off by ")
    assert sentence.endswith(f"{end}.")


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


def test_a_zero_that_both_show_is_said_to_be_the_same(found):
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
