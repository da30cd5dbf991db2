from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from identification.estimators.consistent.consistent_bodies import body_regions, bounding_ellipsoid, region_of_points
from phantom_dyn import load_robot
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.inertia import body_parameters

CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))


def test_the_ellipsoid_about_a_box_has_its_half_sides_times_the_root_of_three():
    # Closed form, by affine invariance from the sphere about a cube.
    sides = np.array([0.1, 0.2, 0.5])
    center, shape = bounding_ellipsoid(CUBE * sides + [1, 2, 3])
    np.testing.assert_allclose(center, [1, 2, 3], atol=1e-9)
    np.testing.assert_allclose(shape, np.diag(3 * sides**2), atol=1e-9)


def test_the_ellipsoid_holds_all_points_and_touches_one(rng):
    points = rng.normal(size=(200, 3))
    center, shape = bounding_ellipsoid(points)
    reach = np.einsum("ki,ij,kj->k", points - center, np.linalg.inv(shape), points - center)
    assert reach.max() == pytest.approx(1.0)


def test_the_ellipsoid_is_hardly_larger_than_that_about_a_regular_simplex():
    # Closed form: the sphere through its four corners.
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    points = np.vstack([corners, 0.3 * CUBE])
    _, shape = bounding_ellipsoid(points)
    assert np.linalg.det(shape) < 27 * 1.05


@pytest.mark.parametrize("points", [CUBE, np.vstack([CUBE, np.random.default_rng(0).uniform(-1, 1, (40, 3))])])
def test_the_hull_of_a_cube_has_six_faces(points):
    region = region_of_points(points)
    assert region.normals is not None
    assert len(region.normals) == 6


def test_the_hull_of_many_points_is_held_from_outside(rng):
    points = rng.normal(size=(3000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    region = region_of_points(points)
    assert region.normals is not None
    assert len(region.normals) == 200
    assert (points @ region.normals.T <= region.offsets + 1e-12).all()


def test_a_solid_ball_inside_a_cube_keeps_all_rows():
    # Closed form: 2/5 m r^2.
    inside = body_parameters(3.0, np.array([0.3, 0, 0]), 0.4 * 3 * 0.6**2 * np.eye(3))
    assert (region_of_points(CUBE).rows() @ inside > 0).all()


@pytest.mark.parametrize("points", [CUBE[:4], np.zeros((0, 3)), np.zeros((9, 3))])
def test_points_without_volume_are_refused(points):
    with pytest.raises(ParameterError, match="points span no volume: give at least four"):
        region_of_points(points)


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(ParameterError, match="not finite"):
        region_of_points(np.full((9, 3), np.nan))


BOX = """<robot name="box"><link name="base"/><link name="arm">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0.1 0 0"/><geometry><box size="0.4 0.2 0.6"/></geometry></visual></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_the_region_of_a_link_is_that_of_its_visual_shape(tmp_path):
    # Closed form: half sides 0.2, 0.1, 0.3 about (0.1, 0, 0).
    (tmp_path / "box.urdf").write_text(BOX)
    (region,) = body_regions(load_robot(tmp_path / "box.urdf"))
    assert region is not None
    np.testing.assert_allclose(region.center, [0.1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(region.shape, np.diag([0.12, 0.03, 0.27]), atol=1e-9)
    np.testing.assert_allclose(np.sort(region.offsets), [0.1, 0.1, 0.1, 0.3, 0.3, 0.3], atol=1e-9)


def test_a_robot_without_shapes_has_no_regions(arm):
    with pytest.raises(RobotError, match="has no shapes that can be read"):
        body_regions(arm)
