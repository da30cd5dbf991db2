# pyright: reportAttributeAccessIssue=false
import base64
import dataclasses
import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from identification.reporting.page import robot_scene as robot_scene_module
from identification.reporting.page.robot_scene import extent, robot_scene, shaded, share_colour
from phantom_dyn.model.loading import load_robot
from phantom_dyn.shapes.meshes import Mesh


def uneven(diagnosis, *ratios):
    """The diagnosis with these residuals in noise floors before."""
    sizes = [ratio * gap.noise_floor for gap, ratio in zip(diagnosis.joints, ratios, strict=True)]
    joints = [
        dataclasses.replace(gap, rms_before=size, rms_within_tolerance=size)
        for gap, size in zip(diagnosis.joints, sizes, strict=True)
    ]
    return dataclasses.replace(diagnosis, joints=tuple(joints))


def solids(scene):
    return json.loads(scene.figure)["solids"]


def unpacked(solid, name, kind) -> np.ndarray:
    return np.frombuffer(base64.b64decode(solid[name]), kind).reshape(-1, 3)


def points(solid) -> np.ndarray:
    return unpacked(solid, "points", "<f4")


def carried(figure, solid, frame) -> np.ndarray:
    """Points of a solid at an instant, in the cube of the viewer."""
    moves = figure["moves"]
    numbers = np.frombuffer(base64.b64decode(moves["places"]), "<f4").reshape(-1, moves["bodies"], 12)
    numbers = numbers[frame, solid["body"]]
    return (points(solid) - figure["middle"]) / figure["half"] @ numbers[:9].reshape(3, 3).T + numbers[9:]


def redness(solid) -> float:
    colours = unpacked(solid, "colours", "u1").astype(float)
    return (colours[:, 0] - colours[:, 2]).max()


def test_the_joint_with_the_largest_gap_is_the_reddest(made_up, planar2):
    drawn = solids(robot_scene(planar2, uneven(made_up(planar2.joint_names, samples=100), 1.0, 4.0)))
    named = {solid["text"].split(":")[0]: solid for solid in drawn}
    assert redness(named["elbow"]) > 150 > 60 > redness(named["shoulder"])


def test_touching_a_joint_says_its_share_and_what_was_found(made_up, planar2):
    drawn = solids(robot_scene(planar2, made_up(planar2.joint_names, findings=1, samples=100)))
    hovers = [solid["text"].replace("\N{NO-BREAK SPACE}", " ") for solid in drawn]
    assert "shoulder: 50 % of the gap\nCoulomb friction" in hovers


def test_joints_stand_where_forward_kinematics_puts_them(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    data = planar2.model.createData()
    pin.forwardKinematics(planar2.model, data, diagnosis.evidence.q[50])
    drums = [points(solid).mean(axis=0) for solid in solids(robot_scene(planar2, diagnosis))[1::2]]
    assert np.array(drums) == pytest.approx(np.array([m.translation for m in data.oMi][1:]), abs=1e-4)


def test_a_closed_chain_is_drawn_closed_and_passive_joints_take_no_share(made_up):
    robot = load_robot("phantom_1_5")
    diagnosis = made_up(robot.joint_names, samples=101)
    scene = robot_scene(robot, diagnosis)
    hovers = [solid["text"] for solid in solids(scene)]
    assert "elbow: passive joint" in hovers


def test_a_linear_joint_has_a_rail_along_its_way(made_up):
    robot = load_robot("emps")
    diagnosis = made_up(robot.joint_names, samples=400, unit="N")
    way = np.ptp(diagnosis.evidence.q)
    assert any(
        np.ptp(points(solid)[:, 0]) == pytest.approx(way, rel=0.06) for solid in solids(robot_scene(robot, diagnosis))
    )


def test_labels_are_plain_names_that_the_viewer_writes_as_text(made_up, planar2):
    joints = ("<b>a", "elbow")
    model = planar2.model.copy()
    model.names[1] = joints[0]
    robot = dataclasses.replace(planar2, model=model, joint_names=joints)
    labels = json.loads(robot_scene(robot, made_up(joints, samples=100)).figure)["labels"]
    assert labels[0]["text"] == "<b>a"
    viewer = Path(robot_scene_module.__file__).with_name("robot_viewer.js").read_text()
    assert "innerHTML" not in viewer


def test_every_face_has_a_colour_and_its_corners_exist(made_up):
    # Oracle: the counts in the packed numbers.
    robot = load_robot("phantom_1_5")
    for solid in solids(robot_scene(robot, made_up(robot.joint_names, samples=101))):
        faces = unpacked(solid, "faces", "<u2")
        assert len(faces) == len(unpacked(solid, "colours", "u1"))
        assert faces.max() < len(points(solid))


@pytest.mark.parametrize("frame", [0, 20, 40])
def test_the_whole_robot_fits_into_the_viewer_in_every_posture(made_up, frame):
    """Into a cube by its height; the viewer is wider by 1.3 at least."""
    robot = load_robot("cea_branch")
    figure = json.loads(robot_scene(robot, made_up(robot.joint_names, samples=101)).figure)
    every = np.concatenate([carried(figure, solid, frame) for solid in figure["solids"]])
    assert (np.abs(every).max(axis=0) <= [1.3 + 1e-3, 1.3 + 1e-3, 1.0 + 1e-3]).all()
    assert np.abs(every).max() > 0.5


@pytest.mark.parametrize("frame", [0, 13, 40])
def test_the_moves_carry_a_joint_to_where_forward_kinematics_puts_it(made_up, planar2, frame):
    diagnosis = made_up(planar2.joint_names, samples=101)
    figure = json.loads(robot_scene(planar2, diagnosis).figure)
    row = np.linspace(0, 100, 41).round().astype(int)[frame]
    data = planar2.model.createData()
    pin.forwardKinematics(planar2.model, data, diagnosis.evidence.q[row])
    drums = [carried(figure, solid, frame).mean(axis=0) for solid in figure["solids"][1::2]]
    wanted = (np.array([m.translation for m in data.oMi][1:]) - figure["middle"]) / figure["half"]
    np.testing.assert_allclose(drums, wanted, atol=1e-3)


@pytest.mark.parametrize("frame", range(0, 41, 10))
def test_a_rail_stays_and_its_joint_moves_along_all_of_it(made_up, frame):
    robot = load_robot("emps")
    figure = json.loads(robot_scene(robot, made_up(robot.joint_names, samples=400, unit="N")).figure)
    rail, joint = figure["solids"][0], figure["solids"][-1]
    assert (rail["body"], rail["text"]) == (0, "")
    ends = carried(figure, rail, frame)[:, 0]
    places = [carried(figure, joint, k)[:, 0].mean() for k in range(41)]
    assert ends.min() < min(places) < max(places) < ends.max()
    assert np.ptp(places) == pytest.approx(np.ptp(ends), rel=0.06)


def test_without_samples_there_is_nothing_to_slide(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=4)
    evidence = dataclasses.replace(diagnosis.evidence, q=np.full((4, 2), np.nan))
    assert json.loads(robot_scene(planar2, dataclasses.replace(diagnosis, evidence=evidence)).figure)["moves"] is None


def test_both_sides_of_a_face_are_equally_bright():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0.3]])
    mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 1]]))
    front, back = shaded(mesh, share_colour(1.0)).tolist()
    assert front == back


def test_a_single_point_has_a_size_to_draw_by():
    assert extent(np.zeros((1, 3))) == pytest.approx(0.1)
