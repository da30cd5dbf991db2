"""Robots as MJCF. Oracles: MuJoCo's inverse dynamics, and Pinocchio's own reading of the text."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.reload import mujoco_difference
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.support.changed_robot import with_rotor_inertia
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.loading import load_robot


@pytest.mark.parametrize("name", ["arm3.urdf", "arm3.xml", "fourbar.xml", "parallelogram.urdf", "pendulum.urdf"])
def test_mujoco_needs_the_same_torques(name, robots, changed, some):
    robot = changed(load_robot(robots / name))
    assert mujoco_difference(mjcf_text(robot), robot, some(robot)) < 1e-12


@pytest.mark.parametrize("name", ["phantom_1_5", "cea_branch", "emps"])
def test_mujoco_needs_the_torques_of_built_in_robots(name, changed, some):
    robot = changed(load_robot(name))
    assert mujoco_difference(mjcf_text(robot), robot, some(robot)) < 1e-12


def test_rotor_inertias_are_in_the_file(robots, some):
    robot = with_rotor_inertia(load_robot(robots / "arm3.urdf"), "tilt", 0.4)
    text = mjcf_text(robot)
    assert 'armature="0.4"' in text
    assert mujoco_difference(text, robot, some(robot)) < 1e-12


def test_our_own_reader_needs_the_same_torques(robots, changed, some, tmp_path):
    robot = changed(load_robot(robots / "arm3.urdf"))
    file = tmp_path / "robot.xml"
    file.write_text(mjcf_text(robot))
    motion = some(robot)
    again = inverse_dynamics(load_robot(file), motion)
    np.testing.assert_allclose(again, inverse_dynamics(robot, motion), rtol=0, atol=1e-9)


def test_a_loop_that_keeps_two_frames_together_is_closed_again(robots, some, tmp_path):
    robot = load_robot(robots / "fourbar.xml")
    file = tmp_path / "robot.xml"
    file.write_text(mjcf_text(robot))
    again = load_robot(file)
    assert (again.joint_names, again.passive_names) == (robot.joint_names, robot.passive_names)
    motion = some(robot)
    np.testing.assert_allclose(inverse_dynamics(again, motion), inverse_dynamics(robot, motion), rtol=0, atol=1e-9)


def test_every_active_joint_has_a_motor(robots):
    root = ElementTree.fromstring(mjcf_text(load_robot(robots / "fourbar.xml")))
    assert [motor.get("joint") for motor in root.iter("motor")] == ["drive"]


def test_a_body_without_mass_is_refused(robots, tmp_path):
    file = tmp_path / "robot.urdf"
    text = (robots / "pendulum.urdf").read_text()
    file.write_text(re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL))
    with pytest.raises(ParameterError, match=r"MuJoCo takes no moving body without mass .* and rod is one"):
        mjcf_text(load_robot(file))


def test_another_damping_in_the_text_is_noticed(robots, some):
    robot = load_robot(robots / "arm3.urdf")
    text = mjcf_text(robot).replace('damping="12.0"', 'damping="13.0"')
    assert mujoco_difference(text, robot, some(robot)) > 1e-3


def test_what_mujoco_refuses_is_said(robots, some):
    robot = load_robot(robots / "pendulum.urdf")
    with pytest.raises(RobotError, match="MuJoCo refuses the MJCF"):
        mujoco_difference(mjcf_text(robot).replace('type="hinge"', 'type="wheel"'), robot, some(robot))
