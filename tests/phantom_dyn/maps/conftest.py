"""Robots of many kinds, and configurations of them."""

import numpy as np
import pytest

from phantom_dyn import load_robot


@pytest.fixture(scope="session")
def phantom():
    return load_robot("phantom_1_5")


FOUR_BAR = """<?xml version="1.0"?>
<robot name="fourbar">
  <link name="base"/>
  <link name="turret"><inertial><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <link name="crank"><inertial><origin xyz="0.1 0 0"/><mass value="0.4"/>
    <inertia ixx="1e-3" ixy="0" ixz="0" iyy="2e-3" iyz="0" izz="2e-3"/></inertial></link>
  <link name="coupler"><inertial><origin xyz="0.2 0 0"/><mass value="0.5"/>
    <inertia ixx="1e-3" ixy="0" ixz="0" iyy="4e-3" iyz="0" izz="4e-3"/></inertial></link>
  <link name="slide"><inertial><origin xyz="0 0 0.1"/><mass value="0.2"/>
    <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
  <link name="rocker"><inertial><origin xyz="0.15 0 0"/><mass value="0.3"/>
    <inertia ixx="1e-3" ixy="0" ixz="0" iyy="3e-3" iyz="0" izz="3e-3"/></inertial></link>
  <link name="a_pin"/><link name="b_pin"/><link name="tip"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="turret"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="drive" type="revolute"><parent link="turret"/><child link="crank"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="float" type="revolute"><parent link="crank"/><child link="coupler"/><origin xyz="0.2 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="reach" type="prismatic"><parent link="coupler"/><child link="slide"/><origin xyz="0.45 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-0.5" upper="0.5" effort="9" velocity="9"/></joint>
  <joint name="rock" type="revolute"><parent link="turret"/><child link="rocker"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="a_mount" type="fixed"><parent link="coupler"/><child link="a_pin"/><origin xyz="0.35 0 0"/></joint>
  <joint name="b_mount" type="fixed"><parent link="rocker"/><child link="b_pin"/><origin xyz="0.3 0 0"/></joint>
  <joint name="tip_mount" type="fixed"><parent link="slide"/><child link="tip"/><origin xyz="0 0 0.1"/></joint>
</robot>
"""
FOUR_BAR_YAML = """loops:
  - {kind: point, frame_a: a_pin, frame_b: b_pin, start: {drive: -1.2, float: 1.0, rock: -1.8}}
joints:
  float: {actuated: false}
  rock: {actuated: false}
"""


@pytest.fixture(scope="session")
def four_bar(tmp_path_factory):
    """A turret with a four-bar of unequal links, closed numerically, and a slide on its coupler."""
    folder = tmp_path_factory.mktemp("fourbar")
    (folder / "robot.urdf").write_text(FOUR_BAR)
    (folder / "robot.yaml").write_text(FOUR_BAR_YAML)
    return load_robot(folder / "robot.urdf")


@pytest.fixture
def configurations(rng):
    """Random positions of a robot's joints within its limits, at most 1 rad or 0.3 m from zero."""

    def draw(robot, count=40):
        span = np.where(robot.prismatic, 0.3, 1.0)
        rows = [robot.model.joints[row + 1].idx_q for row in robot.tree_rows]
        simple = [robot.model.joints[row + 1].nq == 1 for row in robot.tree_rows]
        low = np.where(simple, robot.model.lowerPositionLimit[rows], -np.inf)
        high = np.where(simple, robot.model.upperPositionLimit[rows], np.inf)
        return rng.uniform(np.maximum(low, -span), np.minimum(high, span), (count, robot.nv))

    return draw
