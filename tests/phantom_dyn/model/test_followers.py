"""Joints that follow another one: ``<mimic>``, equalities, tendons, play; MuJoCo and algebra are the oracles."""

import re

import mujoco
import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import gravity_torque, mass_matrix
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.errors import RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

ARM = ROBOTS / "arm3.urdf"
MIMIC = '<axis xyz="0.8 0 0.6"/><mimic joint="tilt" multiplier="-0.5" offset="0.2"/>'


def hand(rest: str) -> str:
    """An arm with a hand of two fingers, each with a tip."""
    finger = (
        '<body name="{0}" pos="0 {1} .1"><joint name="{0}" axis="1 0 0"{2}/><geom type="box" size=".02 .01 .05" '
        'pos="0 0 .05"/><body pos="0 0 .1"><joint name="{0}_tip" axis="1 0 0.3"/><geom size=".02" pos="0 0 .03"/>'
        "</body></body>"
    )
    left, right = finger.format("left", 0.05, ""), finger.format("right", -0.05, ' ref="0.1"')
    return (
        '<mujoco><compiler angle="radian"/><worldbody><body name="arm"><joint name="arm" axis="0 1 0"/><geom '
        f'size=".05" pos=".1 0 .2"/><body name="palm" pos="0 0 .4"><geom size=".05"/>{left}{right}</body>'
        f"</body></worldbody>{rest}</mujoco>"
    )


FIXED = '<tendon><fixed name="{0}"><joint joint="{0}" coef="2"/><joint joint="{0}_tip" coef="-4"/></fixed></tendon>'
CASES = {
    "equality of joints": (
        '<equality><joint joint1="right" joint2="left" polycoef="0.05 -1.5 0 0 0"/></equality>',
        {"right": ("left", -1.5, 0.15)},
    ),
    "equality of one joint": ('<equality><joint joint1="left_tip" polycoef="0.3"/></equality>', {}),
    "equality of a tendon": (
        FIXED.format("left") + '<equality><tendon tendon1="left"/></equality>',
        {"left": ("left_tip", 2.0, 0.0)},
    ),
    "the driven one leads": (
        '<equality><joint joint1="left" joint2="left_tip" polycoef="0 2 0 0 0"/></equality><actuator><motor '
        'joint="left"/></actuator>',
        {"left_tip": ("left", 0.5, 0.0)},
    ),
    "two tendons": (
        FIXED.format("left")
        + FIXED.format("right")
        + '<equality><tendon tendon1="left"/><tendon tendon1="right"/></equality><actuator><motor joint="right"/>'
        '<motor joint="left"/></actuator>',
        {"left_tip": ("left", 0.5, 0.0), "right_tip": ("right", 0.5, -0.05)},
    ),
}


def reduced(robot, path, q, expected):
    """MuJoCo's mass matrix and weight in the robot's joints, by the laws that the case states."""
    model = mujoco.MjModel.from_xml_path(str(path))
    names = [model.joint(k).name for k in range(model.njnt)]
    data, S = mujoco.MjData(model), np.zeros((model.nv, robot.nv))
    for k, name in enumerate(robot.joint_names):
        S[names.index(name), k], data.qpos[names.index(name)] = 1.0, q[k]
    for name, (leader, factor, offset) in expected.items():
        S[names.index(name)] = factor * S[names.index(leader)]
        data.qpos[names.index(name)] = factor * data.qpos[names.index(leader)] + offset
    if "left_tip" in robot.locked:
        data.qpos[names.index("left_tip")] = 0.3
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    violation = data.efc_pos[: data.ne]
    return S.T @ full @ S, S.T @ data.qfrc_bias, violation


@pytest.mark.parametrize("name", CASES)
def test_followers_of_mjcf_follow_as_in_mujoco(tmp_path, rng, name):
    rest, expected = CASES[name]
    path = tmp_path / "hand.xml"
    path.write_text(hand(rest))
    robot = load_robot(path)
    assert set(robot.passive_names) == set(expected)
    q = rng.uniform(-0.5, 0.5, robot.nv)
    matrix, weight, violation = reduced(robot, path, q, expected)
    np.testing.assert_allclose(violation, 0, atol=1e-9)
    np.testing.assert_allclose(mass_matrix(robot, q[None])[0], matrix, atol=1e-9)
    np.testing.assert_allclose(gravity_torque(robot, q[None])[0], weight, atol=1e-9)


def test_a_joint_that_mimics_another_follows_it(edited, rng):
    q = rng.normal(size=(1, 2))
    robot = edited(ARM, ('<axis xyz="0.8 0 0.6"/>', MIMIC))
    assert (robot.joint_names, robot.passive_names) == (("turn", "tilt"), ("slide",))
    S = np.array([[1, 0], [0, 1], [0, -0.5]])
    full = mass_matrix(load_robot(ARM), (q @ S.T) + [0, 0, 0.2])[0]
    np.testing.assert_allclose(mass_matrix(robot, q)[0], S.T @ full @ S, atol=1e-12)


def test_a_joint_whose_leader_is_locked_is_held_where_that_one_holds_it(edited, rng):
    q = rng.normal(size=(5, 1))
    robot = edited(ARM, ('<axis xyz="0.8 0 0.6"/>', MIMIC), config="lock: [tilt]")
    assert robot.locked == ("tilt", "slide")
    assert "held fixed: slide (follows tilt, which is held)" in robot.warnings[0]
    full = mass_matrix(load_robot(ARM), np.hstack([q, 0 * q, 0.2 + 0 * q]))[:, :1, :1]
    np.testing.assert_allclose(mass_matrix(robot, q), full, atol=1e-12)


def test_a_loop_of_robot_yaml_goes_before_the_mimic_of_the_file(edited):
    loop = 'loops: [{kind: linear, active: [turn], passive: {slide: "0.1*turn"}}]'
    robot = edited(ARM, ('<axis xyz="0.8 0 0.6"/>', MIMIC), config=loop)
    tree = tree_motion(robot, Motion(np.zeros(1), *np.full((3, 1, 2), 0.5)))
    assert tree.q[0, 2] == pytest.approx(0.05)


def test_joints_that_follow_each_other_are_refused(edited):
    second = ('<axis xyz="0 0.6 0.8"/>', '<axis xyz="0 0.6 0.8"/><mimic joint="slide"/>')
    with pytest.raises(RobotError, match=r"lead in a circle \(.* follows "):
        edited(ARM, ('<axis xyz="0.8 0 0.6"/>', MIMIC), second)


def test_a_joint_that_follows_by_a_curve_is_refused(tmp_path):
    path = tmp_path / "hand.xml"
    path.write_text(hand('<equality><joint joint1="right" joint2="left" polycoef="0 1 0.4 0 0"/></equality>'))
    with pytest.raises(RobotError, match=r"right follows left by a curve .* only straight lines are taken"):
        load_robot(path)


def play(*, width: float, axis: str = "0 1 0", motor: str = "") -> str:
    """A knee with a second hinge on its body."""
    return (
        '<mujoco><compiler angle="radian"/><worldbody><body><joint name="knee" axis="0 1 0" pos="0 0 .1"/><joint '
        f'name="gap" axis="{axis}" pos="0 0 .1" range="{-width / 2} {width / 2}" armature=".001"/><geom type="capsule" '
        f'size=".03 .2"/></body></worldbody><actuator><motor joint="knee"/>{motor}</actuator></mujoco>'
    )


@pytest.mark.parametrize("first", ["knee", "gap"])
def test_play_as_a_hinge_before_or_after_the_driven_one_is_held_and_said(tmp_path, first):
    text = play(width=0.06)
    knee, gap = re.findall(r"<joint name.*?/>", text)
    (tmp_path / "leg.xml").write_text(text if first == "knee" else text.replace(knee + gap, gap + knee))
    robot = load_robot(tmp_path / "leg.xml")
    assert (robot.joint_names, robot.locked) == (("knee",), ("gap",))
    assert "held fixed: gap (the play of knee, 0.06 wide" in robot.warnings[0]


@pytest.mark.parametrize(
    ("text", "config"),
    [
        (play(width=1.0), None),
        (play(width=0.06, axis="1 0 0"), None),
        (play(width=0.06, motor='<motor joint="gap"/>'), None),
        (play(width=0.06), "joints: {gap: {actuated: false}}"),
    ],
)
def test_a_second_hinge_that_is_no_play_is_a_joint(tmp_path, text, config):
    (tmp_path / "leg.xml").write_text(text)
    if config:
        (tmp_path / "robot.yaml").write_text(config)
    assert load_robot(tmp_path / "leg.xml").joint_names == ("knee", "gap")


def test_a_fixed_joint_that_mimics_another_is_no_joint_to_hold(tmp_path):
    """Talos' reduced files have fixed fingers that keep their ``<mimic>``; Pinocchio has no such joint."""
    path = tmp_path / "arm.urdf"
    finger = '<joint name="finger" type="fixed"><parent link="lower"/><child link="finger"/><mimic joint="{}"/></joint>'
    text, last = ARM.read_text(), load_robot(ARM).joint_names[-1]
    parent = text.rsplit("<child link=", 1)[1].split('"')[1]
    finger = finger.format(last).replace('"lower"', f'"{parent}"')
    path.write_text(text.replace("</robot>", f'<link name="finger"/>{finger}</robot>'))
    (tmp_path / "robot.yaml").write_text(f"lock: [{last}]\n")
    assert load_robot(path).locked == (last,)
