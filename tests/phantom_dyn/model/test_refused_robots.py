"""Robot files that are no robots, cut off or impossible: each is refused in a sentence that says where."""

import re
from pathlib import Path

import pytest

from phantom_dyn import load_robot
from phantom_dyn.errors import RobotError
from places import ROBOTS

URDF = (ROBOTS / "arm3.urdf").read_text()
# Without its keyframe, whose length Pinocchio checks against the joints before anything else.
MJCF = re.sub(r"<keyframe>.*</keyframe>", "", (ROBOTS / "arm3.xml").read_text())


def assert_refused(path: Path, text: str, message: str) -> None:
    path.write_text(text)
    with pytest.raises(RobotError, match=message) as refusal:
        load_robot(path)
    assert str(path) in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty: give a URDF or MJCF file"),
        (" \n", "is empty"),
        ("t,q.j1,tau.j1\n0,0,0\n", "is not valid XML, or is cut off"),
        (URDF[:900], r"is not valid XML, or is cut off \(.*line \d+"),
        (MJCF[:900], r"is not valid XML, or is cut off \(.*line \d+"),
        ("<html></html>", "root element <html>, wanted <robot>"),
        ('<sdf version="1.6"></sdf>', "SDF file, and Pinocchio's wheel is built without SDF: convert it"),
        (
            '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
            "is a xacro source: expand it",
        ),
        ('<robot name="x"><link name="base"/><joint name="a" type="${kind}"/></robot>', "is a xacro source: expand it"),
        (
            '<robot name="x"><link name="base"/><link name="u"/><link name="w"/>'
            '<joint name="a" type="revolute"><parent link="u"/><child link="w"/></joint>'
            '<joint name="b" type="revolute"><parent link="w"/><child link="u"/></joint></robot>',
            "the links u, w hang on one another in a circle: a URDF is a tree",
        ),
        ('<robot name="x"><link name="base"/></robot>', "has no joint that moves"),
        ("<mujoco/>", "has no joint that moves"),
        ("<robot><link name='base'/></robot>", r"can read \(No name given for the robot\): correct the file"),
    ],
)
def test_what_is_no_robot_is_refused(tmp_path, text, message):
    assert_refused(tmp_path / "robot.urdf", text, message)


def test_of_a_robot_yaml_the_robot_file_is_asked_for(tmp_path):
    assert_refused(tmp_path / "arm.yaml", "band: 10.0\n", r"is a YAML file: give the robot's URDF or MJCF file; a rob")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<mass value="3"/>', '<mass value="-3"/>', r"link column cannot exist, its mass is -3 kg, below zero"),
        (
            "column",
            "x" * 3000,
            r"the name x{79}… of a link has 3000 letters, wanted at most 200: write a shorter one\.$",
        ),
        ('<mass value="3"/>', '<mass value="nan"/>', r"value='nan' in <mass> of link column must be finite numbers"),
        ('<mass value="3"/>', '<mass value="heavy"/>', r"value='heavy' in <mass> of link column must be finite"),
        ('<mass value="3"/>', '<mass value="3 4"/>', r"value='3 4' in <mass> of link column has 2 numbers, wanted 1"),
        ('<mass value="3"/>', "", r"the <inertial> of link column has no mass"),
        ('ixx="0.01"', 'ixx="-0.01"', r"link beam cannot exist, its smallest principal inertia is -0\.01.* below zero"),
        ('ixy="0.001"', 'ixy="0.9"', r"link beam cannot exist, its smallest principal inertia is -0\.8"),
        ('ixx="0.01"', 'ixx="inf"', r"ixx='inf' in <inertia> of link beam must be finite numbers"),
        ('ixx="0.01"', "", r"the <inertia> of link beam lacks ixx"),
        ('<origin xyz="0.2 0.03 -0.04"/>', '<origin xyz="0.2 nan 0"/>', r"xyz='0.2 nan 0' in <origin> of link beam"),
        ('<axis xyz="0.8 0 0.6"/>', '<axis xyz="0 0 0"/>', "the axis of joint slide is zero: give its direction"),
        ('damping="0.4"', 'damping="-0.4"', r"damping='-0.4' in <dynamics> of joint tilt is below zero"),
        ('friction="0.5"', 'friction="none"', r"friction='none' in <dynamics> of joint tilt must be finite numbers"),
        ('<limit lower="-2"', '<limits lower="-2"', r"can read \(Joint \[tilt\] is of type REVOLUTE but it does not"),
        ('<child link="beam"/>', '<child link="bean"/>', r"child link \[bean\] of joint \[tilt\] not found"),
        ('<link name="tool">', '<link name="">', "a link has an empty name: give it one, or leave the attribute out"),
        ('<link name="tool">', '<link name="rail">', "two links have the name rail: give each its own"),
        (
            'name="slide" type="prismatic"',
            'name="slide" type="floating"',
            r"slide is a floating base, and only",
        ),
        ('name="slide" type="prismatic"', 'name="slide" type="planar"', r"slide is a planar joint, .*lock: \[slide\]"),
        ('<mass value="3"/>', '<mass value="1e300"/>', r"value='1e300' in <mass> of link column is beyond 1e\+09"),
        (
            '<mass value="3"/>',
            '<mass value="3"/><mass value="4"/>',
            r"<inertial> of link column has <mass> 2 times",
        ),
        ('<axis xyz="0.8 0 0.6"/>', '<axis xyz="1 0 0"/><axis xyz="0 1 0"/>', "joint slide has <axis> 2 times, wanted"),
        ('<axis xyz="0.8 0 0.6"/>', '<axis xyz="0.8 0 0.6 1 0 0"/>', r"<axis> of joint slide has 6 numbers, wanted 3"),
        ("<inertial>", "<inertial/><inertial>", r"link column has <inertial> 2 times, wanted one: remove the others"),
        ('<limit lower="-2"', '<limit lower="7"', r"<limit> of joint tilt goes from 7 to .*: turn the two round"),
        (
            '<axis xyz="0.8 0 0.6"/>',
            '<axis xyz="0.8 0 0.6"/><mimic joint="tipt"/>',
            r"joint slide mimics 'tipt', the joints are .*did you mean tilt\?",
        ),
        ('<axis xyz="0.8 0 0.6"/>', '<axis xyz="0.8 0 0.6"/><mimic joint="slide"/>', "joint slide mimics itself"),
        ("<robot", '<!DOCTYPE robot [<!ENTITY a "b">]><robot', "defines entities, which no robot file needs"),
        (
            '<link name="base"/>',
            "<a>" * 300 + "</a>" * 300 + '<link name="base"/>',
            "elements nested more than 200 deep",
        ),
        # No parser of ours reads what is only seen, and corrected files keep it.
        (
            '<link name="base"/>',
            '<link name="base"><visual><origin xyz="nan 0 0"/></visual></link>',
            r"xyz='nan 0 0' in <origin> must be finite numbers: correct it",
        ),
        (
            'name="slide" type="prismatic"',
            'name="slide" type="screw"',
            r"joint slide is of the type 'screw', which URDF does not",
        ),
        (
            'name="slide" type="prismatic"',
            f'name="slide" type="{"x" * 3000}"',
            r"of the type 'x{79}…', which URDF does not",
        ),
    ],
)
def test_a_broken_urdf_is_refused_with_its_place(tmp_path, old, new, message):
    assert old in URDF
    assert_refused(tmp_path / "robot.urdf", URDF.replace(old, new, 1), message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('mass="3"', 'mass="-3"', "body column cannot exist, its mass is -3 kg, below zero"),
        ('mass="3"', 'mass="x"', r"mass='x' in <inertial> of body column must be finite numbers"),
        ('mass="3"', "", r"the <inertial> of body column needs mass and diaginertia"),
        ("0.004 0.005 0.003", "0.004 -0.005 0.003", "body rail cannot exist, its smallest principal inertia is -0.005"),
        ("0.004 0.005 0.003", "0.004 0.005", r"the <inertial> of body rail needs mass and diaginertia \(3\)"),
        ('damping="12"', 'damping="x"', r"damping='x' in <joint> of joint slide must be finite numbers"),
        ('frictionloss="3"', 'frictionloss="-3"', r"frictionloss='-3' in <joint> of joint slide is below zero"),
        ('type="slide"', 'type="ball"', "slide is a ball joint, and only revolute"),
        ('type="slide"', 'type="rope"', r"MuJoCo can read \(XML Error: invalid keyword: 'rope' .*line \d+"),
        # An element that MJCF does not have: nobody reads it, and corrected.xml keeps it.
        ("<compiler", '<axis xyz="0 -INF 0"/><compiler', r"xyz='0 -INF 0' in <axis> must be finite numbers"),
        (
            "<actuator>",
            '<equality><connect body1="tool" body2="bean" anchor="0 0 0"/></equality><actuator>',
            "MuJoCo can read .unknown element 'bean' in equality constraint 0",
        ),
        (
            "<actuator>",
            '<equality><connect body2="beam" anchor="0 0 0"/></equality><actuator>',
            "MuJoCo can read .*must be specified Element 'connect', line 2",
        ),
        (
            "<actuator>",
            '<equality><weld body1="tool" body2="beam" relpose="0 0 0"/></equality><actuator>',
            "MuJoCo can read .*attribute 'relpose' does not have enough data",
        ),
        (
            '<inertial pos="0 0 0.1" mass="0.4" diaginertia="0.001 0.001 0.001"/>',
            '<geom type="mesh" mesh="tool"/>',
            "MuJoCo can read .mesh 'tool' not found in geom 0",
        ),
        (
            '<inertial pos="0 0 0.1" mass="0.4" diaginertia="0.001 0.001 0.001"/>',
            '<geom type="sphere" size="0.1" mass="-1"/>',
            r"mass='-1' in <geom> of body tool is below zero",
        ),
        ('damping="12"', 'damping="12" range="1 -1"', r"range of joint slide goes from 1 to -1: turn the two round"),
        ('mass="3"', 'mass="1e200"', r"mass='1e200' in <inertial> of body column is beyond"),
        (
            "<actuator>",
            '<equality><joint joint1="slide" joint2="tlit"/></equality><actuator>',
            r"<equality> names the joint 'tlit', the joints are .*did you mean tilt\?",
        ),
        ('joint name="slide"', 'joint name=""', "a joint has an empty name: give it one, or leave the attribute out"),
        (
            "<compiler",
            '<option gravity="-9.81"/><compiler',
            "gravity='-9.81' in <option> of the file has 1 numbers",
        ),
    ],
)
def test_a_broken_mjcf_is_refused_with_its_place(tmp_path, old, new, message):
    assert old in MJCF
    assert_refused(tmp_path / "robot.xml", MJCF.replace(old, new, 1), message)


def test_a_floating_base_in_mjcf_is_refused(tmp_path):
    joint = '<joint name="turn" type="hinge" axis="0 0 1" damping="0.3" frictionloss="0.7"/>'
    assert joint in MJCF
    assert_refused(
        tmp_path / "robot.xml",
        MJCF.replace(joint, "<freejoint/>").replace('joint="turn"', 'joint="tilt"'),
        "is a floating base, and nothing says what its base does",
    )


def test_a_folder_named_as_a_robot_is_refused(tmp_path):
    (tmp_path / "robot.urdf").mkdir()
    with pytest.raises(RobotError, match=r"robot\.urdf is a folder, wanted a robot file"):
        load_robot(tmp_path / "robot.urdf")
