# pyright: reportAttributeAccessIssue=false
"""Robots that are not bolted down, by sensors on their base; oracles: Pinocchio's free-flyer, MuJoCo's free joint."""

from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn._kernels import rigid_body
from phantom_dyn.dynamics.dynamics import (
    inverse_dynamics,
    inverse_dynamics_derivatives,
    rigid_body_regressor,
    standard_parameters,
)
from phantom_dyn.dynamics.moving_base import base_motion
from phantom_dyn.errors import RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

SAMPLES = 9
BODY = """<inertial><origin xyz="0.02 0.01 -0.1" rpy="0.3 0.1 0"/><mass value="1.3"/>
<inertia ixx="0.01" iyy="0.012" izz="0.015" ixy="0.001" ixz="0.002" iyz="0"/></inertial>"""


def leg(side: str, y: float) -> str:
    joints = [("hip", "trunk", "1 0 0", f"0.2 {y} 0"), ("thigh", "hip", "0 1 0", "0 0.1 0"),
              ("shank", "thigh", "0 1 0", "0 0 -0.3")]  # fmt: skip
    out = ""
    for name, parent, axis, place in joints:
        mother = parent if parent == "trunk" else f"{side}_{parent}"
        out += f"""<link name="{side}_{name}">{BODY}</link><joint name="{side}_{name}_joint" type="revolute">
        <parent link="{mother}"/><child link="{side}_{name}"/><origin xyz="{place}" rpy="0.1 0 0.2"/>
        <axis xyz="{axis}"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>"""
    return out


URDF = f"""<robot name="legs"><link name="trunk">{BODY}</link><link name="imu"/>
<joint name="at" type="fixed"><parent link="trunk"/><child link="imu"/><origin xyz="0.1 -0.2 0.3" rpy="0.5 -1.1 2.0"/>
</joint>{leg("left", 0.1)}{leg("right", -0.1)}</robot>"""


@dataclass(frozen=True)
class Flight:
    """Samples of a robot in the air, and what Pinocchio says of them."""

    robot: Robot
    motion: Motion
    torque: np.ndarray
    regressor: np.ndarray
    slopes: tuple[np.ndarray, np.ndarray]


@pytest.fixture(params=["trunk", "imu"])
def flight(request, tmp_path, rng) -> Flight:
    """Random poses and velocities of the base in the world, with gravity there, read by a sensor on the base."""
    path = tmp_path / "robot.urdf"
    path.write_text(URDF)
    path.with_name("robot.yaml").write_text("base: floating\n")
    robot = load_robot(path)
    free = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    free.gravity = pin.Motion(np.array([1.0, -2.0, -9.5]), np.zeros(3))
    data, frame = free.createData(), free.getFrameId(request.param)
    tangent, v, a = rng.normal(size=(3, SAMPLES, free.nv)) * 2
    readings, torque, regressor = np.empty((SAMPLES, 3, 3)), [], []
    to_q, to_v = [], []
    for k in range(SAMPLES):
        q = pin.integrate(free, pin.neutral(free), tangent[k])
        torque.append(np.array(pin.rnea(free, data, q, v[k], a[k]))[6:])
        regressor.append(pin.computeJointTorqueRegressor(free, data, q, v[k], a[k])[6:, 10:])
        pin.computeRNEADerivatives(free, data, q, v[k], a[k])
        to_q.append(data.dtau_dq[6:, 6:].copy())
        to_v.append(data.dtau_dv[6:, 6:].copy())
        pin.forwardKinematics(free, data, q, v[k], a[k])
        turn = pin.updateFramePlacement(free, data, frame).rotation
        moves = pin.getFrameVelocity(free, data, frame, pin.LOCAL).angular
        faster = pin.getFrameAcceleration(free, data, frame, pin.LOCAL).angular
        felt = pin.getFrameClassicalAcceleration(free, data, frame, pin.LOCAL).linear - turn.T @ free.gravity.linear
        readings[k] = moves, faster, felt
    base = base_motion(robot, request.param, request.param, *readings.transpose(1, 0, 2))
    motion = Motion(np.arange(float(SAMPLES)), tangent[:, 6:], v[:, 6:], a[:, 6:], base=base)
    return Flight(robot, motion, np.array(torque), np.array(regressor), (np.array(to_q), np.array(to_v)))


def test_the_torque_is_that_of_pinocchios_free_flyer(flight):
    np.testing.assert_allclose(inverse_dynamics(flight.robot, flight.motion), flight.torque, rtol=0, atol=1e-10)


def test_the_regressor_is_that_of_pinocchios_free_flyer(flight):
    found = rigid_body_regressor(flight.robot, flight.motion)
    np.testing.assert_allclose(found, flight.regressor, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found @ standard_parameters(flight.robot), flight.torque, rtol=0, atol=1e-10)


@pytest.mark.parametrize("worth_compiling", [0, 100])
def test_the_slopes_are_those_of_pinocchios_free_flyer(flight, worth_compiling, monkeypatch):
    monkeypatch.setattr(rigid_body, "_WORTH_COMPILING", worth_compiling)
    for found, expected in zip(inverse_dynamics_derivatives(flight.robot, flight.motion), flight.slopes, strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_some_samples_take_their_part_of_the_bases_motion(flight):
    rows = np.array([7, 2])
    found = inverse_dynamics(flight.robot, flight.motion.at(rows))
    np.testing.assert_allclose(found, flight.torque[rows], rtol=0, atol=1e-10)


def test_a_floating_robot_without_the_motion_of_its_base_is_refused(flight):
    m = flight.motion
    with pytest.raises(RobotError, match=r"legs is not bolted down \(base: floating\): give the motion of its base"):
        inverse_dynamics(flight.robot, Motion(m.t, m.q, m.v, m.a))


def test_a_sensor_on_a_leg_is_refused(flight):
    readings = np.zeros((3, SAMPLES, 3))
    with pytest.raises(RobotError, match=r"left_shank does not move with the base, as left_shank_joint turns it"):
        base_motion(flight.robot, "left_shank", "trunk", *readings)
    with pytest.raises(RobotError, match=r"legs has no frame 'imu_link', .*imu"):
        base_motion(flight.robot, "imu_link", "trunk", *readings)


MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="trunk" pos="0.1 0 1" euler=".4 0 .2">
<freejoint name="root"/><geom type="box" size=".2 .1 .05" mass="4"/><site name="imu" pos=".05 .1 .02" euler=".3 -.5 1"/>
<body name="thigh" pos=".2 .1 0"><joint name="hip" axis="0 1 0" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 .05 .02 -.3" size=".03" mass="1"/><body name="shank" pos=".05 .02 -.3">
<joint name="knee" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".4"/></body></body></body>
</worldbody><sensor><gyro site="imu"/><accelerometer site="imu"/></sensor></mujoco>"""


def test_a_free_joint_of_mjcf_with_mujocos_own_sensors_needs_the_torques_of_mujoco(tmp_path, rng):
    (tmp_path / "robot.xml").write_text(MJCF)
    (tmp_path / "robot.yaml").write_text("base: floating\n")
    robot = load_robot(tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_string(MJCF)
    data, rows = mujoco.MjData(model), []
    for _ in range(SAMPLES):
        quaternion = rng.normal(size=4)
        data.qpos[:] = *rng.normal(size=3), *(quaternion / np.linalg.norm(quaternion)), *rng.normal(size=2)
        data.qvel[:], data.qacc[:] = rng.normal(size=8), 3 * rng.normal(size=8)
        mujoco.mj_inverse(model, data)
        mujoco.mj_sensorVel(model, data)
        mujoco.mj_sensorAcc(model, data)
        # The angular part of a free joint is in the axes of the body.
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.site_quat[0])
        faster = turn.reshape(3, 3).T @ data.qacc[3:6]
        sensed = data.sensordata[:3].copy(), faster, data.sensordata[3:].copy()
        rows.append(
            (data.qpos[7:].copy(), data.qvel[6:].copy(), data.qacc[6:].copy(), *sensed, data.qfrc_inverse[6:].copy())
        )
    q, v, a, w, dw, force, tau = (np.array(column) for column in zip(*rows, strict=True))
    motion = Motion(np.arange(float(SAMPLES)), q, v, a, base=base_motion(robot, "imu", "imu", w, dw, force))
    np.testing.assert_allclose(inverse_dynamics(robot, motion), tau, rtol=0, atol=1e-10)
