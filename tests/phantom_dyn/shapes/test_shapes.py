"""Shapes of links: kept, reduced, of MJCF, primitive, of a whole robot."""

# pyright: reportAttributeAccessIssue=false
import os
from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phantom_dyn.model.loading import load_robot
from phantom_dyn.shapes import robot_shapes as made
from phantom_dyn.shapes.meshes import Mesh, ball, box, capsule, cylinder, face_budgets, joined, moved, reduced, surface
from phantom_dyn.shapes.robot_shapes import (
    KEPT,
    Shapes,
    capsules,
    joint_axis,
    joint_solid,
    keep,
    package_folders,
    robot_shapes,
    shapes_of_mjcf,
)
from places import ROBOTS


@pytest.fixture
def no_reader(monkeypatch) -> None:
    """Meshes that are read after this are none."""
    monkeypatch.setattr(made, "visuals", lambda _: [])


def same(found: Shapes, wanted: Shapes) -> bool:
    pairs = list(zip(found.links, wanted.links, strict=True))
    equal = all(
        np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces) for one, other in pairs
    )
    return equal and found.from_meshes == wanted.from_meshes


def test_the_second_time_the_same_shapes_come_from_the_cache(arm, request):
    first = robot_shapes(load_robot(arm))
    request.getfixturevalue("no_reader")
    assert same(robot_shapes(load_robot(arm)), first)


@pytest.mark.parametrize("other", ["mesh", "robot", "held", "faces"])
def test_what_is_kept_is_not_taken_for_something_else(arm, request, other):
    robot_shapes(load_robot(arm))
    mesh = arm.parents[1] / "meshes" / "t.stl"
    if other == "mesh":
        mesh.write_text(mesh.read_text().replace("vertex 0 0 1", "vertex 0 0 3"))
    elif other == "robot":
        arm.write_text(arm.read_text().replace("2 2 2", "3 3 3"))
    elif other == "held":
        (arm.parent / "robot.yaml").write_text("lock: [grip]")
    request.getfixturevalue("no_reader")
    assert not robot_shapes(load_robot(arm), 100 if other == "faces" else 2000).from_meshes


def test_a_mesh_that_is_gone_gives_capsules_though_its_shape_is_kept(arm):
    robot_shapes(load_robot(arm))
    (arm.parents[1] / "meshes" / "t.stl").unlink()
    assert not robot_shapes(load_robot(arm)).from_meshes


@pytest.mark.parametrize("length", [0, 10, 700])
def test_half_a_file_is_made_anew(arm, cache, length):
    first = robot_shapes(load_robot(arm))
    (file,) = cache.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:length])
    assert same(robot_shapes(load_robot(arm)), first)
    assert len(file.read_bytes()) == len(whole)


def test_a_cache_that_cannot_be_written_to_stops_nothing(arm, tmp_path):
    (tmp_path / "cache").write_text("no folder")
    assert robot_shapes(load_robot(arm)).from_meshes


def test_meshes_that_name_further_files_are_not_kept(arm, cache):
    (arm.parents[1] / "meshes" / "t.stl").rename(arm.parents[1] / "meshes" / "t.gltf")
    arm.write_text(arm.read_text().replace("t.stl", "t.gltf"))
    robot_shapes(load_robot(arm))
    assert not cache.exists()


def test_capsules_are_not_kept(arm, cache):
    (arm.parents[1] / "meshes" / "t.stl").write_text("no mesh")
    robot_shapes(load_robot(arm))
    assert not cache.exists()


def test_the_oldest_files_go(cache):
    cube: Mesh = box(np.array([0.0, 0.0, 1.0]), 1.0, 1.0)
    for k in range(KEPT + 2):
        keep(cache / f"{k}.npz", [cube])
        os.utime(cache / f"{k}.npz", (k, k))
    assert {Path(one).name for one in cache.iterdir()} == {f"{k}.npz" for k in range(2, KEPT + 2)}


def grid_sphere(n: int = 60) -> Mesh:
    """A sphere of radius one with about 2 n^2 faces."""
    polar, turn = np.meshgrid(np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, 2 * n), indexing="ij")
    points = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    k = np.arange(2 * n * n).reshape(n, 2 * n)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    return Mesh(points.reshape(-1, 3), np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))


def fine_cube(n: int = 20) -> Mesh:
    """The surface of a cube of side one, each face of 2 n^2 triangles with corners of their own."""
    u, w = np.meshgrid(np.linspace(-0.5, 0.5, n + 1), np.linspace(-0.5, 0.5, n + 1), indexing="ij")
    k = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    sides = []
    for axis in range(3):
        for sign in (-0.5, 0.5):
            flat = np.insert(np.column_stack([u.ravel(), w.ravel()]), axis, sign, axis=1)
            sides.append(flat)
    points = np.concatenate(sides)
    return Mesh(points, np.concatenate([faces + (n + 1) ** 2 * s for s in range(6)]))


def test_a_reduced_sphere_is_still_the_sphere():
    small = reduced(grid_sphere(), 300)
    assert np.linalg.norm(small.points, axis=1) == pytest.approx(1.0, abs=0.05)
    assert surface(small) == pytest.approx(4 * np.pi, rel=0.06)


def test_a_reduced_cube_keeps_its_corners_and_its_planes():
    small = reduced(fine_cube(), 150)
    assert np.abs(small.points).max(axis=1) == pytest.approx(0.5, abs=1e-9)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    nearest = np.linalg.norm(small.points[None] - corners[:, None], axis=2).min(axis=1)
    assert nearest == pytest.approx(0.0, abs=1e-6)


def test_no_triangle_of_a_reduced_mesh_is_there_twice():
    faces = np.sort(reduced(fine_cube(), 100).faces, axis=1)
    assert len(np.unique(faces, axis=0)) == len(faces)


def test_a_mesh_within_its_budget_stays_as_it_is():
    mesh = box(np.array([0.0, 0, 1]), 1, 1)
    assert reduced(mesh, 12) is mesh


def test_loose_triangles_are_reduced_too(rng):
    points = rng.standard_normal((3000, 3))
    loose = Mesh(points, np.arange(3000).reshape(-1, 3))
    assert 0 < len(reduced(loose, 100).faces) <= 100


@given(
    parts=st.lists(st.tuples(st.floats(0, 10), st.integers(1, 5000)), min_size=1, max_size=40),
    faces=st.integers(100, 5000),
)
def test_budgets_stay_below_the_sum_and_below_what_each_part_has(parts, faces):
    areas, counts = [list(column) for column in zip(*parts, strict=True)]
    given_ = face_budgets(areas, counts, faces)
    assert sum(given_) <= faces
    assert all(0 < g <= count for g, count in zip(given_, counts, strict=True))


def test_what_small_parts_do_not_need_goes_to_the_others():
    assert face_budgets([1.0, 1.0], [12, 5000], 1000)[1] > 950


TEXT = """<mujoco><compiler angle="radian"/><asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .2"/></asset>
<worldbody><geom size=".1" pos="1 1 1"/><body pos="0 0 .3" euler=".3 0 .2"><joint axis="0 1 0" ref=".4"/>
<geom type="box" size=".1 .2 .3" pos=".1 0 0" group="3"/><body pos="0 .1 .3"><joint axis="1 0 0" pos="0 0 .1"/>
<geom type="mesh" mesh="wedge" pos="0 0 .1" euler="0 1 0"/><geom type="ellipsoid" size=".1 .2 .3" contype="0"
conaffinity="0"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("use", "groups"), [("visual", [0, 2, 3]), ("collision", [0, 1, 2])])
def test_shapes_are_where_mujoco_has_them(tmp_path, use, groups):
    path = tmp_path / "robot.xml"
    path.write_text(TEXT)
    model, shapes = shapes_of_mjcf(path, use)
    compiled = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(compiled)
    data.qpos[:] = q = np.array([0.7, -0.5])
    mujoco.mj_kinematics(compiled, data)
    own, places = model.createData(), pin.GeometryData(shapes)
    pin.updateGeometryPlacements(model, own, shapes, places, q)
    found = [np.array(place.translation) for place in places.oMg]
    np.testing.assert_allclose(found, data.geom_xpos[groups], atol=1e-9)
    turned = [place.rotation.ravel() for place in places.oMg]
    np.testing.assert_allclose(turned, data.geom_xmat[groups], atol=1e-9)


Z = np.array([0.0, 0.0, 1.0])

SOLIDS = {
    "capsule": capsule(np.zeros(3), np.array([0.3, -0.2, 1.0]), 0.1),
    "ball": ball(np.ones(3), 0.2),
    "cylinder": cylinder(np.array([1.0, 1.0, 0.0]), 2.0, 0.5),
    "box": box(Z, 3.0, 1.0, 2.0),
}


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("name", SOLIDS)
def test_a_solid_is_closed_and_all_its_faces_look_outward(name):
    faces = SOLIDS[name].faces
    edges = Counter((int(f[k]), int(f[(k + 1) % 3])) for f in faces for k in range(3))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    assert volume(SOLIDS[name]) > 0


@pytest.mark.parametrize(
    ("name", "exact"),
    [
        ("capsule", np.pi * 0.01 * np.sqrt(1.13) + 4 / 3 * np.pi * 0.001),
        ("ball", 4 / 3 * np.pi * 0.008),
        ("cylinder", np.pi * 0.25 * 2),
    ],
)
def test_a_round_solid_has_nearly_the_volume_of_its_closed_form(name, exact):
    assert volume(SOLIDS[name]) == pytest.approx(exact, rel=0.15)
    assert volume(SOLIDS[name]) < exact


def test_a_box_has_its_sides_along_its_axes():
    assert np.ptp(SOLIDS["box"].points, axis=0) == pytest.approx([1.0, 2.0, 3.0])


def test_moving_turns_before_it_shifts():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mesh = Mesh(np.array([[1.0, 0, 0]]), np.zeros((0, 3), dtype=int))
    assert moved(mesh, turn, np.array([0, 0, 5.0])).points == pytest.approx(np.array([[0, 1, 5.0]]))


def test_joining_keeps_every_triangle():
    both = joined([SOLIDS["box"], SOLIDS["ball"]])
    assert volume(both) == pytest.approx(volume(SOLIDS["box"]) + volume(SOLIDS["ball"]))


def test_nothing_joined_is_an_empty_mesh():
    assert joined([]).faces.shape == (0, 3)


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
    for whole, drawn in zip(full.links, small.links, strict=True):
        assert np.ptp(drawn.points, axis=0) == pytest.approx(np.ptp(whole.points, axis=0), abs=0.025)


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
