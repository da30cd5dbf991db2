# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.model.loading import load_robot
from phantom_dyn.shapes.robot_shapes import capsules, joint_axis, joint_solid, robot_shapes
from phantom_dyn.shapes.visuals import package_folders
from places import ROBOTS


def test_a_mesh_is_found_in_the_package_and_stands_where_the_file_says(arm):
    shapes = robot_shapes(load_robot(arm))
    # Known truth: corners from 0 to 1, scaled by 2, shifted by half a metre along z.
    assert shapes.from_meshes
    assert shapes.links[1].points.min(axis=0) == pytest.approx([0, 0, 0.5])
    assert shapes.links[1].points.max(axis=0) == pytest.approx([2, 2, 2.5])


def test_the_shape_of_the_base_is_not_moved_by_a_joint(arm):
    assert np.ptp(robot_shapes(load_robot(arm)).links[0].points, axis=0) == pytest.approx([0.2, 0.4, 0.6])


@pytest.mark.parametrize(("variable", "folder"), [("AMENT_PREFIX_PATH", "ws"), ("ROS_PACKAGE_PATH", "ws/share")])
def test_a_package_is_found_through_the_environment_of_ros(arm, tmp_path, monkeypatch, variable, folder):
    (tmp_path / "ws" / "share").mkdir(parents=True)
    (tmp_path / "arm_package").rename(tmp_path / "ws" / "share" / "arm_package")
    other = tmp_path / "elsewhere.urdf"
    other.write_text((tmp_path / "ws/share/arm_package/urdf/arm.urdf").read_text())
    assert not robot_shapes(load_robot(other)).from_meshes
    monkeypatch.setenv(variable, str(tmp_path / folder))
    assert robot_shapes(load_robot(other)).from_meshes


def test_packages_are_looked_for_above_the_file(monkeypatch):
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    assert package_folders(Path("/robots/arm/arm.urdf")) == [Path("/robots/arm"), Path("/robots"), Path("/")]


def test_a_missing_mesh_gives_capsules_for_the_whole_robot(arm):
    (arm.parents[1] / "meshes" / "t.stl").unlink()
    shapes = robot_shapes(load_robot(arm))
    assert not shapes.from_meshes
    assert len(shapes.links[1].faces) > 0


def test_a_mesh_that_cannot_be_read_gives_capsules(arm):
    (arm.parents[1] / "meshes" / "t.stl").write_text("no mesh")
    assert not robot_shapes(load_robot(arm)).from_meshes


def test_what_a_held_joint_carries_moves_with_the_joint_before_it(arm):
    (arm.parent / "robot.yaml").write_text("lock: [grip]")
    shapes = robot_shapes(load_robot(arm))
    assert len(shapes.links) == 2
    assert shapes.links[1].points[:, 2].max() == pytest.approx(3.1)


def test_geoms_of_an_mjcf_file_are_drawn(tmp_path):
    (tmp_path / "arm.xml").write_text(
        """<mujoco><worldbody><body name="a"><joint name="j" axis="0 0 1"/><inertial pos="0 0 0" mass="1"
        diaginertia="1 1 1"/><geom type="capsule" size="0.1 0.4"/></body></worldbody></mujoco>"""
    )
    shapes = robot_shapes(load_robot(tmp_path / "arm.xml"))
    assert shapes.from_meshes
    assert np.ptp(shapes.links[1].points, axis=0) == pytest.approx([0.2, 0.2, 1.0], rel=0.03)


@pytest.mark.parametrize("name", ["example:ur10", "example:panda"])
def test_a_real_arm_has_at_most_two_thousand_faces_and_keeps_its_size(name):
    robot = load_robot(name)
    full, small = robot_shapes(robot, faces=10**6), robot_shapes(robot)
    assert 1800 < sum(len(mesh.faces) for mesh in small.links) <= 2000
    for given, drawn in zip(full.links, small.links, strict=True):
        assert np.ptp(drawn.points, axis=0) == pytest.approx(np.ptp(given.points, axis=0), abs=0.025)


@pytest.mark.parametrize("file", ["pendulum.urdf", "planar2.urdf", "arm3.urdf", "arm3.xml", "fourbar.urdf"])
def test_without_shapes_every_joint_has_something_to_be_seen(file):
    model = load_robot(ROBOTS / file).model
    assert all(len(mesh.faces) for mesh in capsules(model)[1:])


def test_a_linear_joint_without_length_is_drawn_by_its_bar_alone():
    assert [len(mesh.faces) for mesh in capsules(load_robot("emps").model)] == [0, 0]


def test_a_capsule_leads_from_a_joint_to_the_next():
    planar2 = load_robot(ROBOTS / "planar2.urdf")
    upper = capsules(planar2.model)[1]
    length = np.linalg.norm(planar2.model.jointPlacements[2].translation)
    assert np.ptp(upper.points, axis=0).max() == pytest.approx(length, rel=0.2)


@pytest.mark.parametrize(("axis", "linear"), [("1 0 0", True), ("0 0.6 0.8", False)])
def test_the_axis_of_a_joint_is_that_of_its_file(arm, axis, linear):
    text = arm.read_text().replace("0 0 1", axis).replace("1 0 0", axis)
    arm.write_text(text)
    model = load_robot(arm).model
    found, is_linear = joint_axis(model, 2 if linear else 1)
    assert (found.tolist(), is_linear) == (pytest.approx([float(a) for a in axis.split()]), linear)


def test_a_joint_is_drawn_along_its_axis():
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "j")
    drum = joint_solid(model, 1, 1.0)
    assert np.ptp(drum.points, axis=0) == pytest.approx([0.11, 0.072, 0.072], rel=0.05)
