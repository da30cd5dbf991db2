"""Robots for excitation, and a short design that a test can afford."""

import pytest

from phantom_dyn import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS

BALL = '<collision><origin xyz="0 0 {at}"/><geometry><sphere radius="{radius}"/></geometry></collision>'
INERTIA = (
    '<inertial><origin xyz="0.1 0 -0.2"/><mass value="1.5"/>'
    '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial>'
)


@pytest.fixture(scope="session")
def planar() -> Robot:
    """Two hinges about y in gravity, with friction."""
    return load_robot(ROBOTS / "planar2.urdf")


@pytest.fixture(scope="session")
def spatial() -> Robot:
    """Three joints, one of them linear, without any limit."""
    return load_robot(ROBOTS / "arm3.xml")


@pytest.fixture
def chain_of_balls(tmp_path) -> Robot:
    """Three hinges about y, half a metre apart; the base, and the end of the last link, are balls of 0.1 m."""
    links = [
        f'<link name="base">{BALL.format(at=0, radius=0.1)}</link>',
        f'<link name="a">{INERTIA}</link>',
        f'<link name="b">{INERTIA}</link>',
        f'<link name="c">{INERTIA}{BALL.format(at=-0.5, radius=0.1)}</link>',
    ]
    joints = [
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {-0.5 if k else 0}"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="60" velocity="2"/></joint>'
        for k, (name, parent, child) in enumerate([("one", "base", "a"), ("two", "a", "b"), ("three", "b", "c")])
    ]
    path = tmp_path / "balls.urdf"
    path.write_text(f'<robot name="balls">{"".join(links + joints)}</robot>')
    return load_robot(path)
