"""Rods of the double parallelogram: how many parameters they add, and which. Oracle: section V.D of the CEA paper."""

from __future__ import annotations

import numpy as np
import pytest

from identification.regression.base_parameters import BaseParameters, base_parameters_of_matrix
from phantom_dyn.devices.cea import LENGTHS
from phantom_dyn.devices.cea_rods import Rods, branch_with_rods_urdf, branch_with_rods_yaml
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.dynamics.kinematics import frame_pose
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

ALONG_X1, AWAY = (0.05, 0.0, 0.0), (0.0, 0.05, 0.03)


def branch(folder, arm, forearm) -> Robot:
    rods = Rods(arm, forearm)
    (folder / "robot.urdf").write_text(branch_with_rods_urdf(rods))
    (folder / "robot.yaml").write_text(branch_with_rods_yaml(rods))
    return load_robot(folder / "robot.urdf")


def base(robot: Robot, rng) -> BaseParameters:
    W = rigid_body_regressor(robot, Motion(np.arange(150.0), *rng.uniform(-2.0, 2.0, (3, 150, robot.nv))))
    return base_parameters_of_matrix(W.reshape(-1, W.shape[2]), parameter_names(robot), parameter_units(robot))


@pytest.mark.parametrize(
    ("arm", "forearm", "rank"),
    [
        (None, None, 22),  # 21 of the branch with axis 1 horizontal, and the piece's radial first moment
        (ALONG_X1, None, 23),
        (None, ALONG_X1, 23),
        (ALONG_X1, ALONG_X1, 24),
        ((0.05, 0.0, 0.0), (0.03, 0.0, 0.0), 24),
    ],
)
def test_each_rod_with_its_foot_along_x1_adds_one_parameter(tmp_path, rng, arm, forearm, rank):
    """Printed: "one parameter per rod can be identified"; EE' parallel to X1."""
    assert base(branch(tmp_path, arm, forearm), rng).rank == rank


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), AWAY])
def test_a_rod_that_moves_as_the_arm_does_adds_none(tmp_path, rng, offset):
    """Printed: with the same translational velocity all of it regroups."""
    assert base(branch(tmp_path, offset, offset), rng).rank == 22


def test_what_a_rod_adds_is_its_first_moment_across(tmp_path, rng):
    """Printed: "else, MYR2 can be identified"."""
    found = base(branch(tmp_path, ALONG_X1, None), rng)
    assert "rod2.my" in found.base_names  # without an R: nothing regroups with it
    assert not {"rod2.mx", "rod2.mxR"} & set(found.base_names)


def test_rods_stay_parallel_and_the_piece_keeps_the_direction_of_the_shoulder(tmp_path, rng):
    """Closed form: the elbow of rod and arm are apart by the offset, turned by q1 alone."""
    robot, q = branch(tmp_path, ALONG_X1, ALONG_X1), rng.uniform(-1.0, 1.0, (20, 3))
    elbow = frame_pose(robot, q, "r_piece")[1]
    foot = frame_pose(robot, q, "r_rod3")[1]
    turned = np.stack([np.cos(q[:, 0]), np.sin(q[:, 0]), 0 * q[:, 0]], axis=1)
    np.testing.assert_allclose(foot - elbow, 0.05 * turned, atol=1e-12)
    reach = LENGTHS.d3 * np.cos(q[:, 1])
    np.testing.assert_allclose(np.hypot(elbow[:, 0], elbow[:, 1]), np.abs(reach), atol=1e-12)


def test_rods_without_mass_are_refused():
    with pytest.raises(ParameterError, match="rod_mass of the rods is 0"):
        Rods(rod_mass=0.0)


def test_a_foot_that_is_nowhere_is_refused():
    with pytest.raises(ParameterError, match="give three lengths"):
        Rods(arm_offset=(float("nan"), 0.0, 0.0))
