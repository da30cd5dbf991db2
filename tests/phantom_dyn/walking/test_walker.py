# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot_files import examples_folder, find_robot
from phantom_dyn.walking.walker import G1_POSTURE, G1_SOLE, TALOS_POSTURE, TALOS_SOLE, g1, load_walker, talos
from phantom_dyn.walking.zmp import support_polygon

G1_FILE, TALOS_FILE = "example:g1_29dof_rev_1_0", "example:talos_reduced"


@pytest.mark.parametrize("walker", [talos, g1])
def test_the_soles_stand_level_on_the_ground_beside_the_origin(walker):
    biped = walker()
    data = biped.model.createData()
    pin.framesForwardKinematics(biped.model, data, biped.posture)
    for side, y in (("left", biped.foot_distance / 2), ("right", -biped.foot_distance / 2)):
        pose = data.oMf[biped.model.getFrameId(f"{side}_sole")]
        np.testing.assert_allclose(pose.translation, [0, y, 0], atol=5e-4)
        np.testing.assert_allclose(pose.rotation, np.eye(3), atol=2e-3)


@pytest.mark.parametrize("walker", [talos, g1])
def test_the_mass_is_that_of_the_robot_file(walker):
    mass = {"TALOS": TALOS_FILE, "G1": G1_FILE}
    biped = walker()
    masses = [float(m.get("value", 0)) for m in ElementTree.parse(find_robot(mass[biped.name])).getroot().iter("mass")]
    assert pin.computeTotalMass(biped.model) == pytest.approx(sum(masses))


def test_the_soles_of_g1_are_the_contact_spheres_of_its_file():
    root = ElementTree.parse(find_robot(G1_FILE)).getroot()
    link = next(link for link in root.iter("link") if link.get("name") == G1_SOLE.frame)
    spheres = [shape for shape in link.iter("collision") if shape.find("geometry/sphere") is not None]
    points = np.array([[float(x) for x in shape.find("origin").get("xyz").split()] for shape in spheres])
    radius = {float(shape.find("geometry/sphere").get("radius")) for shape in spheres}
    assert G1_SOLE.below == pytest.approx(-points[0, 2] + radius.pop())
    corners = G1_SOLE.corners + G1_SOLE.middle[:2]
    np.testing.assert_allclose(corners[np.lexsort(corners.T)], points[np.lexsort(points.T[:2]), :2], atol=1e-15)


def test_the_sole_of_talos_lies_in_the_flat_of_its_collision_mesh():
    folder = examples_folder()
    assert folder is not None
    mesh = folder / "talos_data" / "meshes" / "v2" / "ankle_X_collision.stl"
    triangles = np.frombuffer(mesh.read_bytes()[84:], dtype=[("f", "<12f4"), ("pad", "<u2")])["f"]
    vertices = triangles.reshape(-1, 4, 3)[:, 1:].reshape(-1, 3).astype(float)
    flat = vertices[vertices[:, 2] < vertices[:, 2].min() + 2e-3, :2]
    assert support_polygon(flat).margin(TALOS_SOLE.corners + TALOS_SOLE.middle[:2]).min() > -0.01


def test_a_frame_that_is_not_there_is_refused():
    sole = replace(TALOS_SOLE, frame="left_sole")
    with pytest.raises(RobotError, match=r"unknown frame 'left_sole'.*did you mean left_sole_link"):
        load_walker(TALOS_FILE, left=sole, right=sole, posture=TALOS_POSTURE)


def test_a_joint_of_the_posture_that_is_not_there_is_refused():
    with pytest.raises(RobotError, match="unknown joint 'knee'"):
        load_walker(TALOS_FILE, left=TALOS_SOLE, right=TALOS_SOLE, posture={"knee": 1.0})


def test_a_posture_on_its_toes_is_refused():
    bent = dict(G1_POSTURE) | {"left_ankle_pitch_joint": 0.0}
    right = replace(G1_SOLE, frame="right_ankle_roll_link")
    with pytest.raises(RobotError, match=r"not level side by side.*correct the posture"):
        load_walker(G1_FILE, left=G1_SOLE, right=right, posture=bent)


def test_a_leg_without_six_joints_is_refused():
    sole = replace(TALOS_SOLE, frame="leg_left_4_link")
    with pytest.raises(RobotError, match="has 4 joints, and walking needs six"):
        load_walker(TALOS_FILE, left=sole, right=sole, posture=TALOS_POSTURE)
