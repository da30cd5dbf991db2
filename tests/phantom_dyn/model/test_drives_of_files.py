"""Gains, limits and gears that a MJCF or a ros2_control file states; MuJoCo's actuator forces are the oracle."""

import mujoco
import numpy as np
import pytest

from phantom_dyn.errors import RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller
from places import ROBOTS

SLIDER = """<mujoco><compiler angle="radian"/>{defaults}<worldbody><body><joint name="lift" type="slide" axis="0 0 1"
{joint}/><geom size=".1"/><body pos="0 0 .2"><joint name="swing" axis="0 1 0"/><geom size=".1" pos="0 0 .2"/></body>
</body></worldbody><actuator>{actuators}</actuator></mujoco>"""


def loaded(tmp_path, actuators: str, *, defaults: str = "", joint: str = "", config: str | None = None):
    path = tmp_path / "slider.xml"
    path.write_text(SLIDER.format(actuators=actuators, defaults=defaults, joint=joint))
    if config is not None:
        (tmp_path / "robot.yaml").write_text(config)
    return load_robot(path), mujoco.MjModel.from_xml_path(str(path))


@pytest.mark.parametrize(
    ("actuators", "defaults"),
    [
        ('<position joint="lift" kp="900" kv="30"/>', ""),
        ('<position joint="lift" kp="900" kv="30" gear="3" forcerange="-50 50"/>', ""),
        ('<position joint="lift"/>', '<default><position kp="700" kv="20" forcerange="-25 25"/></default>'),
        ('<general joint="lift" gainprm="500" biastype="affine" biasprm="0 -500 -12"/>', ""),
        ('<position joint="lift" kp="900" dampratio="0.7"/>', ""),
    ],
)
def test_a_servo_pulls_as_mujoco_lets_it_pull(tmp_path, rng, actuators, defaults):
    robot, model = loaded(tmp_path, actuators, defaults=defaults)
    drive, data = robot.actuators[0], mujoco.MjData(model)
    assert drive.controller is not None
    gear = float(model.actuator_gear[0, 0])
    for _ in range(20):
        data.qpos[0], data.qvel[0] = rng.uniform(-0.3, 0.3), rng.uniform(-1, 1)
        reference = float(data.qpos[0]) + rng.uniform(-0.1, 0.1)
        data.ctrl[0] = gear * reference
        mujoco.mj_forward(model, data)
        asked = drive.controller.kp * (reference - data.qpos[0]) - drive.controller.kd * data.qvel[0]
        limit = np.inf if drive.torque_limit is None else drive.torque_limit
        assert np.clip(asked, -limit, limit) == pytest.approx(data.qfrc_actuator[0], rel=1e-9)
    assert robot.gains_of_file == ("lift",)


def test_a_motor_has_its_gear_and_the_least_of_its_limits(tmp_path):
    motor = '<motor joint="lift" gear="50" ctrlrange="-2 2" forcerange="-1.5 1.5"/>'
    drive = loaded(tmp_path, motor)[0].actuators[0]
    assert (drive.gear_ratio, drive.torque_limit, drive.controller) == (50, 75, None)
    limited = loaded(tmp_path, motor, joint='actuatorfrcrange="-30 30"')[0].actuators[0]
    assert limited.torque_limit == 30


def test_what_robot_yaml_states_goes_before_the_file(tmp_path):
    config = "joints: {lift: {controller: {kp: 3}, torque_limit: 7, gear_ratio: 2}}"
    robot, _ = loaded(tmp_path, '<position joint="lift" kp="900" gear="3" forcerange="-5 5"/>', config=config)
    drive = robot.actuators[0]
    assert (drive.controller, drive.torque_limit, drive.gear_ratio) == (Controller("pd", 3.0, 0.0), 7, 2)
    assert robot.gains_of_file == ()


@pytest.mark.parametrize(
    "actuators",
    [
        '<general joint="lift" gainprm="500" biastype="affine" biasprm="0 -300 -12"/>',
        '<position joint="lift" kp="900" timeconst="0.1"/>',
        '<position joint="lift" kp="900"/><velocity joint="lift" kv="3"/>',
        '<velocity joint="lift" kv="3"/>',
    ],
)
def test_what_is_no_position_controller_states_no_gains(tmp_path, actuators):
    assert loaded(tmp_path, actuators)[0].actuators[0].controller is None


ROS2 = """controller_manager: {ros__parameters: {update_rate: 500}}
arm_controller:
  ros__parameters:
    joints: [turn, tilt]
    command_interfaces: [effort]
    gains:
      turn: {p: 120.0, d: 4.0, i: 0.0, i_clamp: 1.0}
      tilt: {p: 60, d: 1.5, i: 2}
"""


def test_gains_of_a_ros2_control_file_are_those_of_the_joints(tmp_path):
    (tmp_path / "controllers.yaml").write_text(ROS2)
    robot = load_robot(ROBOTS / "arm3.urdf", config=tmp_path / "controllers.yaml")
    controllers = [drive.controller for drive in robot.actuators]
    assert controllers == [Controller("pd", 120.0, 4.0), Controller("pd", 60.0, 1.5), None]
    assert "the integral parts of tilt are left out" in robot.warnings[0]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[effort]", "[position]", r"without gains of a controller that commands effort \(arm_controller command no"),
        ("p: 120.0", "p: -1", r"arm_controller\.ros__parameters\.gains\.turn\.p is -1, wanted a number of 0 or more"),
        ("turn: {p", "trun: {p", r"joints names the unknown joint 'trun', .*did you mean turn"),
    ],
)
def test_a_ros2_control_file_that_says_no_gains_is_refused(tmp_path, old, new, said):
    (tmp_path / "controllers.yaml").write_text(ROS2.replace(old, new))
    with pytest.raises(RobotError, match=said):
        load_robot(ROBOTS / "arm3.urdf", config=tmp_path / "controllers.yaml")
