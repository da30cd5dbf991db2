"""Joint-space quantities of blocks of samples. Oracle: Pinocchio, through dynamics and kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.model.loading import load_robot
from phantom_dyn.dynamics.dynamics import gravity_torque, mass_matrix
from phantom_dyn.dynamics.kinematics import frame_jacobian, frame_pose
from phantom_dyn.maps.from_robot import map_model
from phantom_dyn.maps.map_model import joint_space, tip_of

BUILT = ["phantom_1_5", "cea_branch", "example:ur10", "example:panda", "example:kinova"]


@pytest.fixture(params=[*BUILT, "arm", "four_bar"])
def robot(request):
    named = request.param
    return request.getfixturevalue(named) if named in ("arm", "four_bar") else load_robot(named)


def test_the_tip_is_where_pinocchio_puts_it(robot, configurations):
    q, model = configurations(robot), map_model(robot)
    np.testing.assert_allclose(tip_of(model, q)[0], frame_pose(robot, q, model.frame)[1], rtol=0, atol=1e-12)


def test_the_jacobian_is_that_of_pinocchio(robot, configurations):
    q, model = configurations(robot), map_model(robot)
    expected = frame_jacobian(robot, q, model.frame, "hybrid")[:, :3]
    np.testing.assert_allclose(joint_space(model, q, inertia=False).J, expected, rtol=0, atol=1e-12)


def test_the_mass_matrix_is_that_of_pinocchio(robot, configurations):
    q = configurations(robot)
    M = joint_space(map_model(robot), q, inertia=True).M
    expected = mass_matrix(robot, q)
    np.testing.assert_allclose(M, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_the_weight_is_that_of_pinocchio(robot, configurations):
    q = configurations(robot)
    weight = joint_space(map_model(robot), q, inertia=True).weight
    np.testing.assert_allclose(weight, gravity_torque(robot, q), rtol=0, atol=1e-11)
