"""Robots whose base moves, and drives that model files state."""

import mujoco
import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.errors import RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller
from places import ROBOTS

BODY = """<inertial><origin xyz="0.02 0 -0.1"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"""
URDF = f"""<robot name="leg"><link name="world"/><link name="trunk">{BODY}</link><link name="thigh">{BODY}</link>
<joint name="root" type="KIND"><parent link="world"/><child link="trunk"/><origin xyz="0 0 1" rpy="0.4 0.2 0"/>
  <axis xyz="0 0 1"/></joint>
<joint name="hip" type="revolute"><parent link="trunk"/><child link="thigh"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>"""
MJCF = """<mujoco><worldbody><body name="trunk" pos="0 0 1" euler="40 0 20">ROOT
<geom type="sphere" size=".1" mass="1"/><body name="thigh" pos="0 0 .1"><joint name="hip" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .1 0 -.3" size=".02" mass="1"/></body></body></worldbody></mujoco>"""
FREE = '<freejoint name="root"/>'
AT = np.array([[0.0], [0.7], [-1.9]])


def written(folder, name: str, text: str, config: str | None = None):
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    if config is not None:
        (folder / "robot.yaml").write_text(config)
    return folder / name


@pytest.mark.parametrize(("kind", "word"), [("floating", "a floating base"), ("planar", "a planar joint")])
def test_a_moving_base_is_refused_with_the_advice(tmp_path, kind, word):
    file = written(tmp_path, "robot.urdf", URDF.replace("KIND", kind))
    said = (
        rf"robot\.urdf: root is {word}, and nothing says what its base does: if the robot hangs on a rig, or its base "
        r"is held otherwise, write base: fixed into robot\.yaml; if it moves and logs say how .*, write base: floating"
    )
    with pytest.raises(RobotError, match=said):
        load_robot(file)


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_held_base_of_a_urdf_is_a_fixed_one(tmp_path, kind):
    held = load_robot(written(tmp_path / "held", "robot.urdf", URDF.replace("KIND", kind), "base: fixed"))
    fixed = load_robot(written(tmp_path / "fixed", "robot.urdf", URDF.replace("KIND", "fixed")))
    assert (held.joint_names, held.locked, held.warnings) == (("hip",), ("root",), ())
    np.testing.assert_allclose(gravity_torque(held, AT), gravity_torque(fixed, AT), rtol=1e-12)


@pytest.mark.parametrize("root", [FREE, '<joint name="root" type="ball"/>'])
@pytest.mark.parametrize("config", ["base: fixed", "lock: [root]"])
def test_a_held_base_of_mjcf_stays_as_the_file_draws_it(tmp_path, root, config):
    held = load_robot(written(tmp_path, "robot.xml", MJCF.replace("ROOT", root), config))
    model = mujoco.MjModel.from_xml_string(MJCF.replace("ROOT", ""))
    data = mujoco.MjData(model)
    expected = []
    for q in AT:
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        expected.append(data.qfrc_bias.copy())
    np.testing.assert_allclose(gravity_torque(held, AT), expected, rtol=1e-9)


def test_several_joints_of_the_base_are_joints_or_are_held(tmp_path):
    joints = '<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>'
    file = written(tmp_path, "robot.xml", MJCF.replace("ROOT", joints))
    assert load_robot(file).joint_names == ("x", "z", "hip")
    written(tmp_path, "robot.xml", MJCF.replace("ROOT", joints), "base: fixed")
    assert load_robot(file).joint_names == ("hip",)


def test_a_ball_joint_behind_another_joint_is_refused_with_the_advice_to_lock_it(tmp_path):
    inner = MJCF.replace("ROOT", '<joint name="turn" axis="0 0 1"/>').replace('axis="0 1 0"', 'type="ball"')
    said = r"hip is a ball joint, .*: write two or three hinges in its place .*, or hold it with lock: \[hip\] in robot"
    with pytest.raises(RobotError, match=said):
        load_robot(written(tmp_path, "robot.xml", inner, "base: fixed"))


def test_a_ball_joint_of_a_urdf_gets_a_sentence_of_its_own(tmp_path):
    file = written(tmp_path, "robot.urdf", URDF.replace("KIND", "spherical"))
    with pytest.raises(RobotError, match=r"joint root is of the type 'spherical', which URDF does not have: write one"):
        load_robot(file)


def test_a_base_that_is_fixed_may_be_called_fixed(tmp_path):
    text = URDF.replace("KIND", "fixed")
    assert load_robot(written(tmp_path, "robot.urdf", text, "base: fixed")).joint_names == ("hip",)


def test_a_free_body_beside_the_robot_is_refused_as_that(tmp_path):
    text = MJCF.replace("ROOT", "").replace(
        "<worldbody>", '<worldbody><body name="cube"><freejoint name="loose"/><geom size=".1"/></body>'
    )
    with pytest.raises(RobotError, match=r"loose lets a body move freely beside the robot, .*lock: \[loose\] in robot"):
        load_robot(written(tmp_path, "robot.xml", text))
    assert load_robot(written(tmp_path, "robot.xml", text, "lock: [loose]")).joint_names == ("hip",)


def test_a_rod_with_a_ball_joint_in_a_loop_is_refused_for_the_ball_joint(tmp_path):
    rod = (
        '<body name="link" pos=".5 0 1"><joint name="rod" type="ball"/><geom type="capsule" fromto="0 0 0 0 0 .5" '
        'size=".01"/></body>'
    )
    loop = '<equality><connect body1="link" body2="thigh" anchor="0 0 .5"/></equality></mujoco>'
    text = MJCF.replace("ROOT", "").replace("</worldbody></mujoco>", f"{rod}</worldbody>{loop}")
    with pytest.raises(RobotError, match=r"rod is a ball joint, .*: write two or three hinges in its place"):
        load_robot(written(tmp_path, "robot.xml", text))


@pytest.mark.parametrize(
    ("name", "joints"),
    [("go2", 12), ("a1", 12), ("solo12", 12), ("anymal_c_simple_description/anymal", 12), ("bolt", 6)],
)
def test_robots_that_walk_have_the_joints_of_their_legs_and_a_base_that_floats(tmp_path, name, joints):
    config = tmp_path / "robot.yaml"
    config.write_text("base: floating\n")
    robot = load_robot(f"example:{name}", config=config)
    assert (robot.nv, robot.floating) == (joints, True)


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_base_that_floats_is_no_joint(tmp_path, kind):
    robot = load_robot(written(tmp_path, "robot.urdf", URDF.replace("KIND", kind), "base: floating"))
    assert (robot.joint_names, robot.locked, robot.floating) == (("hip",), ("root",), True)


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
