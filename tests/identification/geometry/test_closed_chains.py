"""What poses say of closed chains. Oracle: linkages whose URDF was changed as text, with other forward kinematics and
loops that SciPy closes."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from by_night import by_night
from identification.cli.main import main
from identification.data.recording import Recording
from identification.diagnosis.columns.known_geometry import corrected_recordings, places_of_loops
from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_yaml import known_effects
from identification.geometry.diagnose_poses import diagnose_poses
from identification.geometry.result import GeometryResult
from identification.pipeline import diagnose
from identification.scenarios.measured_poses import diagnosis_of_poses
from phantom_dyn import load_robot
from phantom_dyn.errors import LogError, ParameterError
from places import ROBOTS
from tests.common.measured_poses import link_poses, moved_joint, pose
from tests.common.tracked_chains import TrueChain, linkages, tracked_chain

LINKAGES = linkages()
AT_ROOT = (np.eye(4), np.eye(4))
LENGTHS = [
    ("phantom", "elbow", "elbow", "z"),
    ("phantom", "parallel_link_to_pin_p", "parallel_link_to_forearm", "z"),
    ("phantom", "crank", "crank", "y"),
    ("cea", "q3", "q3", "x"),
    ("cea", "q7", "pin6", "x"),
    ("fourbar", "coupler", "coupler", "x"),
    ("fourbar", "rocker_to_pin", "rocker_pin", "z"),
    ("fivebar", "right_elbow", "right_elbow", "z"),
    ("fivebar", "right_to_pin", "right_pin", "z"),
]


def tracked(name: str, seed: int, *, zeros: Mapping[str, float] | None = None, moves=(), **how) -> Recording:
    text = LINKAGES[name].text
    for joint, shift in moves:
        text = moved_joint(text, joint, shift)
    compliance = how.pop("compliance", {})
    return tracked_chain(
        TrueChain(LINKAGES[name], text, zeros or {}, compliance), seed, **({"root_poses": AT_ROOT} | how)
    )


def judged(name: str, recording: Recording) -> GeometryResult:
    result = diagnose_poses(LINKAGES[name].robot, (recording,))
    assert result is not None
    return result


def numbers_found(result: GeometryResult) -> set[tuple[str, str | None, str]]:
    """All numbers that are named, or listed as a rival."""
    named = {(f.effect, f.joint, name) for f in result.findings for name in f.parameters}
    rivals = (place for f in result.findings for rival in f.rivals for place in rival.places)
    return named | {(place.effect, place.joint, name) for place in rivals for name in place.parameters}


@pytest.mark.parametrize(
    ("name", "joint"), by_night([("phantom", "theta2"), ("cea", "q2"), ("fourbar", "crank"), ("fivebar", "left")], 0, 3)
)
def test_the_zero_of_an_active_joint_is_found_within_two_tenths_of_a_milliradian(name, joint):
    result = judged(name, tracked(name, 200, zeros={joint: 0.003}, poses=100, turned=True))
    (finding,) = result.findings
    assert (finding.effect, finding.joint) == ("encoder_offset", joint)
    assert finding.parameters["offset"].value == pytest.approx(0.003, abs=2e-4)
    assert result.verdict == "explained"


@pytest.mark.parametrize(("name", "moved", "joint", "axis"), by_night(LENGTHS, 0, 3, 8))
def test_a_link_length_is_found_within_two_tenths_of_a_millimetre(name, moved, joint, axis):
    shift = 0.002 * np.eye(3)["xyz".index(axis)]
    result = judged(name, tracked(name, 201, moves=[(moved, shift)]))
    (finding,) = result.findings
    assert ("link_geometry", joint, axis) in numbers_found(result)
    if finding.joint == joint:
        assert finding.parameters[axis].value == pytest.approx(0.002, abs=2e-4)
    assert result.frames[0].rms_after == pytest.approx(np.sqrt(3) * 1e-4, rel=0.2)


@pytest.mark.parametrize(("name", "seed"), by_night(product(LINKAGES, [210, 211, 212]), 0, 4, 6, 10))
def test_a_linkage_that_is_right_is_not_blamed(name, seed):
    how = {"poses": 20 + 20 * (seed % 3), "turned": bool(seed % 2)} | ({} if seed % 3 else {"root_poses": None})
    result = judged(name, tracked(name, seed, **how))
    assert (result.verdict, result.findings, result.minor) == ("no_gap", (), ())


def test_the_stiffness_of_an_active_joint_is_found_through_the_parallelogram():
    # Oracle: the slope of the energy while the loop stays closed. A balanced device bends little: it is made soft.
    result = judged("cea", tracked("cea", 220, compliance={"q5": 1 / 60}, poses=80))
    (finding,) = result.findings
    assert (finding.effect, finding.joint) == ("joint_elasticity", "q5")
    assert 1 / finding.parameters["compliance"].value == pytest.approx(60, rel=0.1)


def test_two_sides_of_a_parallelogram_that_are_the_same_are_one_of():
    # The forearm stays parallel to the crank: a longer arm of the one is a shorter one of the other.
    result = judged("phantom", tracked("phantom", 221, moves=[("crank", (0, 0.0005, 0))]))
    assert numbers_found(result) == {
        ("link_geometry", "crank", "y"),
        ("link_geometry", "forearm_to_parallel_link", "y"),
    }


def test_of_two_places_that_fit_alike_both_are_reported_and_none_as_too_small():
    # In these twenty poses another place fits better by less than a tenth of a square, in nearly all draws of blocks.
    result = judged("cea", tracked("cea", 100_008, moves=[("q8", (0.0026535557, 0, 0))], poses=20, root_poses=None))
    assert ("link_geometry", "pin3", "x") in numbers_found(result)
    (finding,) = result.findings
    assert finding.probability == pytest.approx(0.5, abs=0.1)
    silent = {(one.joint, one.parameter): one.why for one in result.not_testable}
    bound = {(one.joint, one.parameter) for one in result.bounds}
    alike = {(place.joint, name) for r in finding.rivals for place in r.places for name in place.parameters}
    assert alike
    assert not alike & bound
    assert {silent[one] for one in alike} == {"these poses do not separate it from what was found"}


def test_what_a_loop_takes_up_is_reported_as_not_testable():
    result = judged("fourbar", tracked("fourbar", 222))
    why = {(one.joint, one.parameter): one.why for one in result.not_testable}
    assert why["rocker_pin", "x"] == "passive joints of its loop take it up, so that it moves no measured frame"


def test_a_frame_on_a_passive_link_and_one_on_the_other_side_are_judged_together():
    linkage = LINKAGES["fivebar"]
    there = tracked("fivebar", 223, moves=[("right_to_pin", (0, 0, 0.002))])
    text = moved_joint(linkage.text, "right_to_pin", (0, 0, 0.002))
    other = tracked_chain(TrueChain(replace(linkage, frame="right_forearm"), text), 223, root_poses=AT_ROOT)
    both = replace(there, positions=there.positions | other.positions)
    result = judged("fivebar", both)
    assert {one.frame for one in result.frames} == {"tip", "right_forearm"}
    assert ("link_geometry", "right_pin", "z") in numbers_found(result)


def test_a_motion_that_is_stamped_late_is_reported_and_its_length_found():
    t = np.arange(0, 13, 0.05)
    q = np.column_stack([0.4 * np.sin(0.4 * t), 0.4 * np.cos(0.7 * t)])
    late = 0.05
    before = np.column_stack([np.interp(t - late, t, column) for column in q.T])
    found = tracked("fivebar", 224, moves=[("right_to_pin", (0, 0, 0.002))], q=before)
    result = judged("fivebar", replace(found, t=t, q=q))
    (lateness,) = result.delays
    assert lateness.delay == pytest.approx(late, abs=2e-3)
    assert ("link_geometry", "right_pin", "z") in numbers_found(result)


@pytest.mark.parametrize("tool", by_night([((0, 0, 0.01),), ((0.004, 0, 0),)], 0))
def test_known_places_zeros_and_targets_leave_nothing(tool):
    zeros, moves = {"crank": 0.004}, [("rocker_to_pin", (0, 0, 0.002))]
    recording = tracked("fourbar", 225, zeros=zeros, moves=moves, root_poses=(np.eye(4), pose(tool, (0, 0, 0))))
    known = (
        KnownEffect("encoder_offset", "crank", (0.004,)),
        KnownEffect("link_geometry", "rocker_pin", (0, 0, 0.002, 0, 0, 0)),
        KnownEffect("tool_pose", "coupler_pin", (*tool, 0, 0, 0)),
    )
    robot = LINKAGES["fourbar"].robot
    recordings = corrected_recordings(robot, (recording,), known)
    result = diagnose_poses(robot, recordings, places_of_loops(robot, known))
    assert result is not None
    assert (result.verdict, result.fitted) == ("no_gap", ())


def test_a_shift_across_the_plane_is_found_though_the_loop_stays_open():
    result = judged("fivebar", tracked("fivebar", 226, moves=[("to_tip", (0, 0.003, 0))]))
    assert ("tool_pose", "tip", "y") in numbers_found(result)


def test_a_file_of_a_linkage_is_written_that_closes_and_has_its_tip_in_place(tmp_path, rng):
    moves = {"right_to_pin": (0, 0, 0.002)}
    recording = tracked("fivebar", 230, zeros={"left": 0.004}, moves=moves.items(), noise=1e-5)
    out = _diagnosed(recording, tmp_path, "fivebar")
    written = {path.name for path in out.iterdir()}
    assert {"corrected.yaml", "corrected.urdf"} <= written
    linkage = LINKAGES["fivebar"]
    true = TrueChain(linkage, moved_joint(linkage.text, "right_to_pin", moves["right_to_pin"]), {"left": 0.004})
    found = TrueChain(linkage, (out / "corrected.urdf").read_text())
    for q in rng.uniform(-0.4, 0.4, (5, 2)):
        read = dict(zip(("left", "right"), q.tolist(), strict=True))
        here, there, given = (one.frames(read)["tip"][:3, 3] for one in (found, true, TrueChain(linkage, linkage.text)))
        assert np.abs(here - there).max() < 5e-5
        assert np.abs(given - there).max() > 5e-4
    again = _diagnosed(recording, tmp_path, "fivebar", "--with", str(out / "corrected.yaml"))
    assert json.loads((again / "diagnosis.json").read_text())["verdict"] == "no_gap"


def test_the_zeros_of_a_parallelogram_are_in_the_files_and_its_lengths_only_in_the_yaml(tmp_path, capsys, rng):
    recording = tracked("phantom", 231, zeros={"theta2": 0.004}, moves=[("elbow", (0, 0, 0.002))], noise=1e-5)
    out = _diagnosed(recording, tmp_path, "phantom")
    said = " ".join(capsys.readouterr().out.split())
    assert "have no place for where elbow sits: their passive joints follow formulas, which do not hold" in said
    assert "joint: elbow" in (out / "corrected.yaml").read_text()
    # Formulas of the given file hold for what encoders read, so that the tip is where the true zeros have it.
    text = (out / "corrected.urdf").read_text()
    for theta1, theta2, theta3 in rng.uniform(-0.5, 0.5, (5, 3)):
        read = {"theta1": theta1, "theta2": theta2, "theta3": theta3, "elbow": theta3 - theta2}
        linkage = LINKAGES["phantom"]
        true = TrueChain(linkage, linkage.text, {"theta2": 0.004})
        np.testing.assert_allclose(_tip(text, read), true.frames(read)["tip"][:3, 3], atol=5e-6)


def _tip(text: str, q: Mapping[str, float]) -> np.ndarray:
    return link_poses(text, q)["tip"][:3, 3]


def _diagnosed(recording: Recording, folder: Path, name: str, *more: str) -> Path:
    columns = {"t": recording.t} | {f"q.{j}": recording.q[:, k] for k, j in enumerate(recording.joint_names)}
    for frame, p in recording.positions.items():
        columns |= {f"p.{frame}.{axis}": p[:, k] for k, axis in enumerate("xyz")}
    log, out = folder / "poses.csv", folder / f"out{len(more)}"
    np.savetxt(log, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    linkage = LINKAGES[name]
    config = [] if linkage.config is None else ["--robot-config", linkage.config]
    assert main(["diagnose", linkage.source, str(log), "--out", str(out), *config, *more]) == 0
    return out


def test_loops_that_would_not_close_are_left_out_of_the_urdf_and_reported(tmp_path, capsys):
    # A tilt across the plane, which a solver of closed loops refuses.
    text = moved_joint(LINKAGES["fourbar"].text, "coupler", (0, 0, 0), (0.004, 0, 0))
    linkage = replace(LINKAGES["fourbar"], frame="coupler_pin")
    recording = tracked_chain(TrueChain(linkage, text), 232, root_poses=AT_ROOT, turned=False, noise=1e-5)
    out = _diagnosed(recording, tmp_path, "fourbar")
    found = json.loads((out / "diagnosis.json").read_text())["findings"]
    assert any(one["effect"] == "link_geometry" for one in found)
    said = " ".join(capsys.readouterr().out.split())
    assert re.search("corrected.urdf has no place for what poses showed: with its joints moved, .*coupler", said)
    assert 'xyz="0.1 0' in (out / "corrected.urdf").read_text()


def test_a_place_of_what_the_linkage_does_not_have_is_refused_with_its_pins(tmp_path):
    path = tmp_path / "corrected.yaml"
    entry = "{effect: link_geometry, joint: rocker_pn, parameters: {z: {value: 1, std: 1, unit: m}}, gap_closed: 1}"
    path.write_text(f"schema: phantom-dyn-model/1\nrobot: {{source: a, sha256: b}}\neffects: [{entry}]\nadjusted: []\n")
    with pytest.raises(ParameterError, match="rocker_pin"):
        known_effects((path,), LINKAGES["fourbar"].robot)


def test_a_frame_of_another_name_is_refused_with_those_there_are(tmp_path, capsys):
    recording = tracked("fourbar", 233, poses=20)
    renamed = replace(recording, positions={"coupler_pn": recording.positions["coupler_pin"]})
    with pytest.raises(AssertionError):
        _diagnosed(renamed, tmp_path, "fourbar")
    said = capsys.readouterr().err
    assert "are a position at a frame that fourbar does not have" in " ".join(said.split())
    assert "coupler_pin" in said


def test_a_frame_before_the_first_joint_is_refused():
    recording = tracked("fourbar", 234, poses=20)
    still = replace(recording, positions={"base": recording.positions["coupler_pin"]})
    with pytest.raises(LogError, match="No joint of fourbar moves base"):
        diagnosis_of_poses(LINKAGES["fourbar"].robot, (still,))


@pytest.fixture(scope="module")
def moving(lab, trusted):
    """Torques and poses of a five-bar in motion, by what is wrong: a length, or friction that the file lacks."""
    linkage = LINKAGES["fivebar"]
    robot = trusted(linkage.robot)
    motion = lab.motion(2, seconds=8.0, rate=100.0, swing=0.4)
    rows = np.arange(0, len(motion.t), 13)

    def make(wrong: str):
        text = moved_joint(linkage.text, "right_to_pin", (0, 0, 0.002 if wrong == "length" else 0.0))
        driven = robot
        if wrong == "friction":
            driven = replace(robot, viscous_friction=robot.viscous_friction + np.array([0.2, 0.0]))
        recording = lab.recording(driven, motion)
        poses = tracked_chain(TrueChain(linkage, text), 240, root_poses=AT_ROOT, q=motion.q[rows])
        rest = replace(recording, positions={}, file="torques.csv")
        return diagnose(robot, (rest, replace(poses, file="poses.csv")))

    return make


def test_a_wrong_length_is_no_finding_of_torques(moving):
    found = moving("length")
    assert [one.effect for one in found.findings] == []
    assert found.geometry is not None
    assert ("link_geometry", "right_pin", "z") in numbers_found(found.geometry)


def test_friction_is_no_finding_of_poses(moving):
    found = moving("friction")
    assert {(one.effect, one.joint) for one in found.findings} == {("viscous_friction", "left")}
    assert found.geometry is not None
    assert (found.geometry.verdict, found.geometry.findings) == ("no_gap", ())


def test_the_robots_of_these_tests_are_the_same_linkage(rng):
    # Oracle: the five-bar of another file, in which MuJoCo's connect closes the loop.
    q = rng.uniform(-0.4, 0.4, (5, 2))
    urdf, mjcf = LINKAGES["fivebar"].robot, load_robot(ROBOTS / "fivebar.xml")
    np.testing.assert_allclose(urdf.solutions.at(q).x, mjcf.solutions.at(q).x, atol=1e-9)
