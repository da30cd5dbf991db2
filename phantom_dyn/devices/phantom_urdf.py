"""URDF of a PHANToM from its parameters: a tree whose loop is closed by its ``robot.yaml``."""

from __future__ import annotations

import math

from phantom_dyn.devices.phantom import PhantomParameters

_Vector = tuple[float, float, float]

ROBOT_YAML = """\
gravity: [0, -9.81, 0]      # y is up
payload_frame: tip          # what a hand loads is the forearm, which is not the last link of the tree
joints:                     # rotors of theta2 and theta3 as seen at the joint; the one of theta1 is part of the base
  theta2: {{rotor_inertia: {rotor!r}, gear_ratio: {gear!r}}}
  theta3: {{rotor_inertia: {rotor!r}, gear_ratio: {gear!r}}}
loops:                      # the parallelogram of upper arm, forearm, parallel link and crank
  - {{kind: linear, active: [theta1, theta2, theta3], passive: {{elbow: theta3 - theta2, crank: theta2 - theta3}}}}
"""


def phantom_yaml(parameters: PhantomParameters) -> str:
    """The ``robot.yaml`` beside `phantom_urdf`: gravity, what carries a payload, rotors and the closed chain."""
    return ROBOT_YAML.format(rotor=parameters.rotor_inertia, gear=parameters.gear_ratio)


def phantom_urdf(parameters: PhantomParameters, name: str) -> str:
    """Text of the URDF; numbers are not rounded.

    Args:
        parameters: Parameters of the device.
        name: Name of the robot.

    Returns:
        Links base (fixed), shoulder, upper_arm (BE), forearm (A), rocker (DF), parallel_link (C), tip; joints theta1,
        theta2, elbow, theta3, crank and the fixed tip.
    """
    p = parameters
    # Mass of the base and its moments about x and z are not published, and have no effect: it only turns about y.
    shoulder = _link("shoulder", 0.3, (0, 0, 0), (p.inertia_base, p.inertia_base, p.inertia_base))
    links = [
        '  <link name="base"/>',
        shoulder,
        _link("upper_arm", p.m_be, (0, 0, p.l5), p.link_inertia_be),
        _link("forearm", p.m_a, (0, -p.l2 / 2, 0), p.inertia_a),
        _link("rocker", p.m_df, (0, p.l6, 0), p.link_inertia_df),
        _link("parallel_link", p.m_c, (0, 0, p.l1 / 2), p.inertia_c),
        '  <link name="tip"/>',
    ]
    half, turn = math.pi / 2, math.pi
    joints = [
        _joint("theta1", "base", "shoulder", (0, p.l2, -p.l1), (0, 1, 0), turn),
        _joint("theta2", "shoulder", "upper_arm", (0, 0, 0), (-1, 0, 0), turn),
        _joint("elbow", "upper_arm", "forearm", (0, 0, p.l1), (-1, 0, 0), half),
        _joint("theta3", "shoulder", "rocker", (0, 0, 0), (-1, 0, 0), turn),
        _joint("crank", "rocker", "parallel_link", (0, -p.l3, 0), (-1, 0, 0), half),
        _fixed("tip_mount", "forearm", "tip", (0, -p.l2, 0)),
    ]
    lines = ['<?xml version="1.0"?>', f'<robot name="{name}">', *links, *joints, "</robot>"]
    return "\n".join(lines) + "\n"


def _numbers(values: _Vector) -> str:
    return " ".join(repr(float(value)) for value in values)


def _link(name: str, mass: float, center: _Vector, moments: _Vector) -> str:
    x, y, z = (repr(float(moment)) for moment in moments)
    return (
        f'  <link name="{name}">\n    <inertial>\n'
        f'      <origin xyz="{_numbers(center)}"/>\n      <mass value="{mass!r}"/>\n'
        f'      <inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/>\n'
        "    </inertial>\n  </link>"
    )


def _joint(name: str, parent: str, child: str, origin: _Vector, axis: _Vector, limit: float) -> str:
    # Torque and speed limits are not published: these bind nothing.
    return (
        f'  <joint name="{name}" type="revolute">\n    <parent link="{parent}"/>\n    <child link="{child}"/>\n'
        f'    <origin xyz="{_numbers(origin)}"/>\n    <axis xyz="{_numbers(axis)}"/>\n'
        f'    <limit lower="{-limit!r}" upper="{limit!r}" effort="10" velocity="100"/>\n  </joint>'
    )


def _fixed(name: str, parent: str, child: str, origin: _Vector) -> str:
    return (
        f'  <joint name="{name}" type="fixed">\n    <parent link="{parent}"/>\n    <child link="{child}"/>\n'
        f'    <origin xyz="{_numbers(origin)}"/>\n  </joint>'
    )
