# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import base64
import dataclasses
import json

import numpy as np
import pinocchio as pin
import pytest

from identification.reporting.robot_scene import extent, posture, robot_scene, shaded, share_colour
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


def traces(scene):
    return json.loads(scene.figure)["data"]


def points(trace) -> np.ndarray:
    return np.array([np.frombuffer(base64.b64decode(trace[a]["bdata"]), trace[a]["dtype"]) for a in "xyz"]).T


def redness(trace) -> float:
    return max(int(c[1:3], 16) - int(c[5:7], 16) for c in trace["facecolor"])


def test_the_joint_with_the_largest_gap_is_the_reddest(made_up, planar2):
    drawn = traces(robot_scene(planar2, uneven(made_up(planar2.joint_names, samples=100), 1.0, 4.0)))
    named = {trace["hovertext"].split(":")[0]: trace for trace in drawn if "hovertext" in trace}
    assert redness(named["elbow"]) > 150 > 60 > redness(named["shoulder"])


def test_touching_a_joint_says_its_share_and_what_was_found(made_up, planar2):
    drawn = traces(robot_scene(planar2, made_up(planar2.joint_names, findings=1, samples=100)))
    hovers = [trace.get("hovertext", "").replace("\N{NO-BREAK SPACE}", " ") for trace in drawn]
    assert "shoulder: 50 % of the gap<br>Coulomb friction" in hovers


def test_joints_stand_where_forward_kinematics_puts_them(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    data = planar2.model.createData()
    pin.forwardKinematics(planar2.model, data, diagnosis.evidence.q[50])
    drums = [points(trace).mean(axis=0) for trace in traces(robot_scene(planar2, diagnosis))[1::2]]
    assert np.array(drums) == pytest.approx(np.array([m.translation for m in data.oMi][1:]), abs=1e-4)


def test_the_posture_is_that_of_the_middle_of_the_recording(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    assert posture(planar2, diagnosis) == pytest.approx(diagnosis.evidence.q[50])


def test_without_samples_the_robot_stands_in_its_neutral_posture(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=4)
    evidence = dataclasses.replace(diagnosis.evidence, q=np.full((4, 2), np.nan))
    assert posture(planar2, dataclasses.replace(diagnosis, evidence=evidence)) == pytest.approx(
        pin.neutral(planar2.model)
    )


def test_a_closed_chain_is_drawn_closed_and_passive_joints_take_no_share(made_up):
    robot = load_robot("phantom_1_5")
    diagnosis = made_up(robot.joint_names, samples=101)
    scene = robot_scene(robot, diagnosis)
    hovers = [trace.get("hovertext", "") for trace in traces(scene)]
    assert posture(robot, diagnosis).shape == (robot.model.nq,)
    assert "elbow: passive joint" in hovers


def test_a_linear_joint_has_a_rail_along_its_way(made_up):
    robot = load_robot("emps")
    diagnosis = made_up(robot.joint_names, samples=400, unit="N")
    way = np.ptp(diagnosis.evidence.q)
    assert any(
        np.ptp(points(trace)[:, 0]) == pytest.approx(way, rel=0.06) for trace in traces(robot_scene(robot, diagnosis))
    )


def test_names_with_markup_are_escaped_in_labels(made_up, planar2):
    joints = ("<b>a", "elbow")
    model = planar2.model.copy()
    model.names[1] = joints[0]
    robot = dataclasses.replace(planar2, model=model, joint_names=joints)
    layout = json.loads(robot_scene(robot, made_up(joints, samples=100)).figure)["layout"]
    assert layout["scene"]["annotations"][0]["text"] == "&lt;b&gt;a"


def test_both_sides_of_a_face_are_equally_bright():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0.3]])
    mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 1]]))
    front, back = shaded(mesh, share_colour(1.0))
    assert front == back


def test_a_single_point_has_a_size_to_draw_by():
    assert extent(np.zeros((1, 3))) == pytest.approx(0.1)
