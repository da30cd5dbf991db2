# pyright: reportAttributeAccessIssue=false
"""What a copy of the robot is drawn with. Oracles: Pinocchio's placements, SciPy's rotations, closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from identification.viewing.replay import link_poses
from identification.viewing.robot_solids import boxes, robot_solids
from phantom_dyn.model.loading import load_robot
from phantom_dyn.shapes.meshes import Mesh, joined
from places import ROBOTS


@pytest.fixture(scope="module")
def sliding(replay):
    """The same replay with a robot whose third joint slides by 0.4 m."""
    robot = load_robot(ROBOTS / "arm3.urdf")
    q = np.zeros((50, 3))
    q[:, 2] = np.linspace(-0.1, 0.3, 50)
    copy = replace(replay.copies[0], q=q, poses=link_poses(robot, q))
    return replace(replay, robot=robot, copies=(copy,))


def test_the_box_of_a_posture_is_that_of_its_turned_corners(rng):
    points, wxyz, place = rng.standard_normal((9, 3)), rng.standard_normal(4), rng.standard_normal(3)
    wxyz /= np.linalg.norm(wxyz)
    (found,) = boxes(np.array([[[*place, *wxyz]]]), (Mesh(points, np.zeros((0, 3), dtype=int)),))
    turned = Rotation.from_quat(wxyz, scalar_first=True).apply(points) + place
    every = np.vstack([turned, place])
    np.testing.assert_allclose(found, [every.min(axis=0), every.max(axis=0)], atol=1e-12)


def test_copies_do_not_reach_into_each_other(replay):
    solids = robot_solids(replay)
    offsets = solids.offsets(3)
    axis = int(np.argmax(offsets[1]))
    assert solids.size[axis] < offsets[1, axis]
    np.testing.assert_allclose(offsets[2], 2 * offsets[1])


def test_a_linear_joint_runs_on_a_rail_as_long_as_its_way(sliding):
    (rail,) = [mesh for mesh in robot_solids(sliding).rails if len(mesh.faces)]
    length = np.linalg.norm(rail.points.max(axis=0) - rail.points.min(axis=0))
    assert 0.4 < length < 0.42


def test_there_is_a_solid_for_every_joint(replay):
    solids = robot_solids(replay)
    assert [len(mesh.faces) > 0 for mesh in solids.drums] == [False, True, True]


def test_the_floor_is_below_what_stands_still(replay):
    solids = robot_solids(replay)
    assert replace(solids, links=(joined([]), *solids.links[1:])).floor == 0.0
    base = Mesh(np.array([[0, 0, -0.2], [1, 0, 0.1], [0, 1, 0.0]]), np.array([[0, 1, 2]]))
    assert replace(solids, links=(base, *solids.links[1:])).floor == -0.2
