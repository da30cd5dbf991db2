"""Poses stated in the robot's root frame. Oracle: poses of base and target that were put in, by NumPy alone."""

from dataclasses import replace

import numpy as np
import pytest

from by_night import by_night
from identification.cli.main import main
from identification.diagnosis.columns.known_geometry import corrected_recordings, with_known_places
from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_yaml import known_effects
from identification.geometry.diagnose_poses import diagnose_poses
from identification.geometry.measured import measured_poses
from identification.geometry.result import GeometryResult
from identification.geometry.stated_frames import problem_of
from identification.words.geometry_words import geometry_sentences
from phantom_dyn.errors import ParameterError

AT_ROOT = (0, 0, 0, 0, 0, 0)
BASE, TOOL = (0.003, -0.002, 0.001, 0.002, 0.003, -0.002), (0.002, -0.001, 0.004, 0.003, 0.002, 0.005)
NAMES = ("x", "y", "z", "rx", "ry", "rz")


def found_of(result: GeometryResult | None) -> dict[tuple[str, str | None], dict[str, float]]:
    assert result is not None
    return {(f.effect, f.joint): {name: x.value for name, x in f.parameters.items()} for f in result.findings}


def effects_named(result: GeometryResult | None) -> list[set[tuple[str, str | None]]]:
    """Effect and joint of each finding and of its rivals."""
    assert result is not None
    return [
        {(f.effect, f.joint)} | {(place.effect, place.joint) for rival in f.rivals for place in rival.places}
        for f in result.findings
    ]


@pytest.mark.parametrize("seed", by_night(range(200, 206), 0, 1))
def test_a_robot_that_is_right_is_not_blamed(ur10, tracked, seed):
    result = diagnose_poses(ur10, (tracked(seed, poses=20 + 20 * (seed % 3), base=AT_ROOT, turned=bool(seed % 2)),))
    assert result is not None
    assert (result.verdict, result.findings, result.minor, result.fitted) == ("no_gap", (), (), ())


def test_a_base_that_stands_elsewhere_is_found(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(50, base=BASE, turned=True),))
    found = found_of(result)
    assert set(found) == {("base_pose", None)}
    np.testing.assert_allclose([found["base_pose", None][name] for name in NAMES], BASE, atol=1e-4)


def test_a_shift_of_the_base_alone_is_certain(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(51, base=(0.003, 0, 0, 0, 0, 0)),))
    assert result is not None
    (finding,) = result.findings
    assert (finding.effect, finding.joint, set(finding.parameters)) == ("base_pose", None, {"x"})
    assert (finding.verdict, result.verdict) == ("supported", "explained")


def test_a_target_that_sits_elsewhere_is_found(ur10, tracked):
    found = found_of(diagnose_poses(ur10, (tracked(52, base=AT_ROOT, tool=TOOL, turned=True),)))
    assert set(found) == {("tool_pose", "tool0")}
    np.testing.assert_allclose([found["tool_pose", "tool0"][name] for name in NAMES], TOOL, atol=2e-4)


def test_numbers_are_a_shift_and_a_rotation_vector_where_the_base_is_turned_far(ur10, tracked):
    # A twist of this turn and shift would be another 1.5 mm.
    found = found_of(diagnose_poses(ur10, (tracked(53, base=(0.05, 0.02, 0, 0, 0, 0.06)),)))
    sentence = found["base_pose", None]
    assert [sentence["x"], sentence["y"], sentence["rz"]] == pytest.approx([0.05, 0.02, 0.06], abs=2e-4)


def test_a_turned_base_and_the_zero_of_the_first_joint_are_one_of(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(54, base=AT_ROOT, zeros={"shoulder_pan_joint": 0.002}),))
    assert effects_named(result) == [{("base_pose", None), ("encoder_offset", "shoulder_pan_joint")}]


def test_a_zero_is_found_beside_a_base_that_stands_elsewhere(ur10, tracked):
    zeros = {"elbow_joint": 0.003}
    found = found_of(diagnose_poses(ur10, (tracked(55, base=(0.02, 0, 0, 0, 0, 0), zeros=zeros),)))
    assert found["encoder_offset", "elbow_joint"]["offset"] == pytest.approx(0.003, abs=2e-4)
    assert found["base_pose", None]["x"] == pytest.approx(0.02, abs=2e-4)


def test_the_place_of_the_first_joint_is_that_of_the_base(ur10, tracked):
    found = found_of(diagnose_poses(ur10, (tracked(56, base=AT_ROOT, moves=[("shoulder_pan_joint", (0.002, 0, 0))]),)))
    assert found == {("base_pose", None): {"x": pytest.approx(0.002, abs=1e-4)}}


@pytest.mark.parametrize(
    ("base", "tool", "sentence"),
    [
        (AT_ROOT, AT_ROOT, set()),
        (AT_ROOT, (0, 0, 0.2, 0, 0, 0), {"tool"}),  # a reflector on a stalk
        ((0.5, 0, 0, 0, 0, 0), AT_ROOT, {"base", "tool"}),  # another place of the cell
        ((0, 0, 0, 0, 0, 1.0), AT_ROOT, {"base", "tool"}),
    ],
)
def test_poses_far_from_what_their_columns_say_are_in_other_frames(ur10, tracked, base, tool, sentence):
    result = diagnose_poses(ur10, (tracked(57, base=base, tool=tool),))
    assert result is not None
    assert {one.what for one in result.fitted} == sentence
    assert result.verdict == "no_gap"


def test_a_tracker_that_was_moved_a_little_between_recordings_is_not_in_the_root(ur10, tracked):
    bases = (AT_ROOT, (0.004, 0, 0, 0, 0, 0))
    recordings = tuple(replace(tracked(60 + k, base=base), file=f"{k}.csv") for k, base in enumerate(bases))
    sets, paths = measured_poses(ur10, recordings)
    assert not problem_of(ur10, sets, paths).in_root


def test_sentences_say_what_is_elsewhere_and_in_which_frame(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(51, base=(0.003, 0, 0, 0, 0, 0)),))
    assert result is not None
    gap, cause, left = geometry_sentences(result)
    assert gap.startswith("Measured poses: tool0 is off by ")
    assert gap.endswith(" (rms) in the robot's root frame.")
    assert cause.startswith("A wrong pose of the base, by 3.0")
    assert " along x explains " in cause
    assert left.endswith("is left.")


def test_known_poses_of_base_and_target_leave_nothing(ur10, tracked):
    known = (KnownEffect("base_pose", None, BASE), KnownEffect("tool_pose", "tool0", TOOL))
    robot = with_known_places(ur10, known)
    result = diagnose_poses(
        robot, corrected_recordings(robot, (tracked(58, base=BASE, tool=TOOL, turned=True),), known)
    )
    assert result is not None
    assert (result.verdict, result.fitted) == ("no_gap", ())


def test_the_files_of_a_run_are_written_and_read_back(tracked, tmp_path, capsys):
    recording = tracked(59, base=(0.003, 0, 0, 0, 0, 0), tool=(0.002, 0.003, 0, 0, 0, 0))
    columns = {"t": recording.t} | {f"q.{j}": recording.q[:, k] for k, j in enumerate(recording.joint_names)}
    columns |= {f"p.tool0.{axis}": recording.positions["tool0"][:, k] for k, axis in enumerate("xyz")}
    log, bare, again = tmp_path / "poses.csv", tmp_path / "bare", tmp_path / "again"
    np.savetxt(log, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    assert main(["diagnose", "example:ur10", str(log), "--out", str(bare)]) == 0
    sentence = " ".join(capsys.readouterr().out.split())
    assert "corrected.xml have no place for tool_pose, where the target sits on tool0." in sentence
    page = (bare / "report.html").read_text()
    assert "a wrong pose of the target on tool0" in page.replace("A wrong", "a wrong")
    assert "Poses are taken in the robot's root frame" in page
    assert "Fitted beside" not in page
    known = str(bare / "corrected.yaml")
    assert main(["diagnose", "example:ur10", str(log), "--out", str(again), "--with", known]) == 0
    assert "no_gap" in (again / "diagnosis.json").read_text()
    capsys.readouterr()
    assert main(["compare", str(bare / "diagnosis.json"), str(again / "diagnosis.json")]) == 0
    assert "Tool pose on frame tool0, x: 0.0020" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{effect: base_pose, joint: elbow_joint, parameters: {x: {value: 1, std: 1, unit: m}}", "wanted null"),
        ("{effect: tool_pose, joint: tol0, parameters: {x: {value: 1, std: 1, unit: m}}", "on frame 'tol0'"),
    ],
)
def test_a_pose_of_what_the_robot_does_not_have_is_refused(ur10, tmp_path, entry, said):
    path = tmp_path / "corrected.yaml"
    head = "schema: phantom-dyn-model/1\nrobot: {source: a, sha256: b}\n"
    path.write_text(f"{head}effects: [{entry}, gap_closed: 1}}]\nadjusted: []\n")
    with pytest.raises(ParameterError, match=said):
        known_effects((path,), ur10)
