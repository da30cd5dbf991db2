"""Robots as MJCF for the simulation and as URDF for the diagnosis."""

from __future__ import annotations

import numpy as np

from benchmarks.legged.robots import Numbers, Robot

Array = np.ndarray


def _text(values: Array | tuple[float, ...]) -> str:
    return " ".join(f"{x:.9g}" for x in np.ravel(values))


def plant(robot: Robot, numbers: Numbers, step: float, rubs: float = 0.8, softness: float = 0.02) -> str:
    """MJCF of a robot on flat ground, with an inertial sensor on the base and a touch sensor at every end.

    Dry friction is not included: MuJoCo's is softer than that of gears.

    Args:
        robot: Links, joints and ends.
        numbers: Inertial and joint numbers of the simulated robot.
        step: Integration step [s].
        rubs: Friction coefficient of the ground.
        softness: Time constant of contacts [s].
    """
    mass, moments = robot.trunk
    touch = "".join(f'<touch site="{end.name}"/>' for end in robot.ends)
    return f"""<mujoco model="{robot.name}"><compiler angle="radian" eulerseq="XYZ"/>
<option timestep="{step}" integrator="implicitfast"/>
<default><geom friction="{rubs} 0.02 0.01" solref="{softness} 1" condim="4"/></default>
<worldbody><geom type="plane" size="0 0 1"/><body name="trunk" pos="0 0 {robot.height}"><freejoint name="free"/>
<inertial mass="{mass:.9g}" pos="0.02 0 0" diaginertia="{_text(moments)}"/>
<site name="imu" pos="{_text(robot.imu_at)}" euler="{_text(robot.imu_turned)}"/>
{_bodies(robot, numbers, -1)}</body></worldbody>
<actuator>{"".join(f'<motor joint="{joint}"/>' for joint in robot.joints)}</actuator>
<sensor><gyro site="imu"/><accelerometer site="imu"/>{touch}</sensor></mujoco>"""


def _bodies(robot: Robot, numbers: Numbers, before: int) -> str:
    """The links on one link, with all their descendants."""
    out = []
    for j, part in enumerate(robot.parts):
        if part.before != before:
            continue
        balls = "".join(
            f'<geom name="{end.name}" size="{end.radius}" pos="{_text(end.place)}"/>'
            f'<site name="{end.name}" size="{1.2 * end.radius}" pos="{_text(end.place)}"/>'
            for end in robot.ends
            if end.part == j
        )
        out.append(
            f'<body name="{part.name}" pos="{_text(part.place)}">'
            f'<inertial mass="{numbers.mass[j]:.9g}" pos="{_text(numbers.center[j])}" '
            f'diaginertia="{_text(numbers.mass[j] * numbers.radius[j] ** 2)}"/>'
            f'<joint name="{part.name}_joint" axis="{part.axis}" armature="{numbers.armature[j]:.9g}" '
            f'damping="{numbers.damping[j]:.9g}"/>{balls}{_bodies(robot, numbers, j)}</body>'
        )
    return "".join(out)


def urdf(robot: Robot) -> str:
    """URDF that the diagnosis gets."""
    numbers = robot.numbers
    mass, (xx, yy, zz) = robot.trunk
    out = [
        f'<robot name="{robot.name}"><link name="trunk"><inertial><origin xyz="0.02 0 0"/><mass value="{mass:.9g}"/>'
        f'<inertia ixx="{xx:.9g}" iyy="{yy:.9g}" izz="{zz:.9g}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<link name="imu"/>'
    ]
    out.append(
        f'<joint name="imu_joint" type="fixed"><parent link="trunk"/><child link="imu"/>'
        f'<origin xyz="{_text(robot.imu_at)}" rpy="{_text(robot.imu_turned)}"/></joint>'
    )
    for j, part in enumerate(robot.parts):
        xx, yy, zz = numbers.mass[j] * numbers.radius[j] ** 2
        before = "trunk" if part.before < 0 else robot.parts[part.before].name
        out.append(
            f'<link name="{part.name}"><inertial><origin xyz="{_text(numbers.center[j])}"/>'
            f'<mass value="{numbers.mass[j]:.9g}"/><inertia ixx="{xx:.9g}" iyy="{yy:.9g}" izz="{zz:.9g}" ixy="0" '
            f'ixz="0" iyz="0"/></inertial></link><joint name="{part.name}_joint" type="revolute">'
            f'<parent link="{before}"/><child link="{part.name}"/><origin xyz="{_text(part.place)}"/>'
            f'<axis xyz="{part.axis}"/><limit lower="-3" upper="3" effort="100" velocity="40"/>'
            f'<dynamics damping="{numbers.damping[j]:.9g}" friction="{numbers.friction[j]:.9g}"/></joint>'
        )
    for end in robot.ends:
        out.append(
            f'<link name="{end.name}"/><joint name="{end.name}_fixed" type="fixed">'
            f'<parent link="{robot.parts[end.part].name}"/><child link="{end.name}"/>'
            f'<origin xyz="{_text(end.place)}"/></joint>'
        )
    return "\n".join([*out, "</robot>", ""])
