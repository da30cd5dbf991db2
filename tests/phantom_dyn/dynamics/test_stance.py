# pyright: reportAttributeAccessIssue=false
"""Rows of base and joints that forces on feet do not change. Oracle: Pinocchio's free-flyer, forwards and backwards."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.dynamics.moving_base import base_motion, contact_null_space, wrench_and_torque
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from tests.phantom_dyn.dynamics.test_moving_base import URDF

FEET = ("left_shank", "right_shank")
Sample = tuple[np.ndarray, np.ndarray]


@pytest.fixture
def robot(tmp_path) -> Robot:
    (path := tmp_path / "robot.urdf").write_text(URDF)
    path.with_name("robot.yaml").write_text("base: floating\n")
    return load_robot(path)


@pytest.fixture
def free(robot, tmp_path) -> pin.Model:
    return pin.buildModelFromUrdf(str(tmp_path / "robot.urdf"), pin.JointModelFreeFlyer())


def pushed(free: pin.Model, data: pin.Data, forces: np.ndarray) -> np.ndarray:
    """Generalised force of forces at the feet, by Pinocchio's Jacobian."""
    rows = [pin.getFrameJacobian(free, data, free.getFrameId(foot), pin.LOCAL_WORLD_ALIGNED)[:3] for foot in FEET]
    return np.vstack(rows).T @ forces.ravel()


@pytest.fixture
def on_the_ground(robot, free, rng) -> Callable[[np.ndarray], Sample]:
    """What is asked for and what the model needs, rows of base and joints, where forces push the feet."""
    q = pin.integrate(free, pin.neutral(free), rng.normal(size=free.nv))
    v, tau = rng.normal(size=(2, free.nv))
    tau[:6] = 0.0

    def at(forces: np.ndarray) -> Sample:
        data = free.createData()
        pin.computeJointJacobians(free, data, q)
        pin.framesForwardKinematics(free, data, q)
        # Nobody drives the base: it accelerates as the forces and the joints let it.
        a = pin.aba(free, data, q, v, tau + pushed(free, data, forces))
        pin.forwardKinematics(free, data, q, v, a)
        frame = free.getFrameId("trunk")
        turn = pin.updateFramePlacement(free, data, frame).rotation
        felt = pin.getFrameClassicalAcceleration(free, data, frame, pin.LOCAL).linear - turn.T @ free.gravity.linear
        faster = pin.getFrameAcceleration(free, data, frame, pin.LOCAL).angular
        base = base_motion(robot, "trunk", "trunk", v[None, 3:6], faster[None, :], felt[None, :])
        motion = Motion(np.zeros(1), q[None, 7:], v[None, 6:], a[None, 6:], base=base)
        return tau, wrench_and_torque(robot, motion)[0]

    at.q = q[7:]  # pyright: ignore[reportFunctionMemberAccess]
    return at


def test_without_forces_the_rows_of_base_and_joints_are_those_of_pinocchio(on_the_ground):
    asked, needed = on_the_ground(np.zeros((2, 3)))
    np.testing.assert_allclose(needed, asked, rtol=0, atol=1e-10)


def test_projected_rows_do_not_depend_on_the_forces(robot, on_the_ground, rng):
    some = contact_null_space(robot, on_the_ground.q, FEET)
    for size in (0.0, 1.0, 30.0):
        asked, needed = on_the_ground(size * rng.normal(size=(2, 3)))
        np.testing.assert_allclose(some.T @ (asked - needed), 0.0, rtol=0, atol=1e-10)


def test_as_many_rows_are_left_as_two_points_do_not_take(robot, on_the_ground):
    assert contact_null_space(robot, on_the_ground.q, FEET).shape == (12, 6)


def test_a_joint_with_its_foot_in_the_air_is_one_of_the_rows(robot, on_the_ground):
    some = contact_null_space(robot, on_the_ground.q, FEET[:1])
    own = np.eye(12)[:, 9:]
    np.testing.assert_allclose(some @ (some.T @ own), own, atol=1e-10)
