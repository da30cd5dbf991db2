# pyright: reportAttributeAccessIssue=false
"""Poses of links over time. Oracles: Pinocchio's forward kinematics, SciPy's quaternions, a closed form."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from identification.viewing.replay import link_poses
from phantom_dyn.model.loading import load_robot
from places import ROBOTS


@pytest.fixture(scope="module")
def arm():
    return load_robot(ROBOTS / "arm3.urdf")


def test_poses_are_those_of_pinocchio(arm, rng):
    q = rng.uniform(-1, 1, (5, arm.nv))
    poses, data = link_poses(arm, q), arm.model.createData()
    for row, pose in zip(q, poses, strict=True):
        pin.forwardKinematics(arm.model, data, row)
        for place, found in zip(data.oMi, pose, strict=True):
            np.testing.assert_allclose(found[:3], place.translation, atol=1e-12)
            turned = Rotation.from_quat(found[3:], scalar_first=True).as_matrix()
            np.testing.assert_allclose(turned, place.rotation, atol=1e-12)


def test_the_root_stands_still(arm):
    np.testing.assert_array_equal(link_poses(arm, np.ones((1, 3)))[0, 0], [0, 0, 0, 1, 0, 0, 0])


def test_the_loop_of_a_closed_chain_is_closed_at_every_frame(rng):
    # Published geometry (PHANToM 1.5, seed of its table): joint angles are absolute, so `elbow` turns against theta2.
    robot = load_robot("phantom_1_5")
    q = rng.uniform(-0.3, 0.3, (3, 3))
    data, poses = robot.model.createData(), link_poses(robot, q)
    for row, pose in zip(q, poses, strict=True):
        pin.forwardKinematics(robot.model, data, robot.configuration(row[None])[0])
        np.testing.assert_allclose(pose[:, :3], [place.translation for place in data.oMi], atol=1e-12)


def test_a_position_that_is_not_known_has_no_pose(arm):
    q = np.zeros((3, 3))
    q[1, 2] = np.nan
    assert np.isnan(link_poses(arm, q)[1]).all()
    assert np.isfinite(link_poses(arm, q)[[0, 2]]).all()
