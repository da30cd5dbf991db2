"""A quadruped of twelve joints as numbers, as MJCF for the simulation and as URDF for the diagnosis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray

LEGS = ("FL", "FR", "RL", "RR")
PARTS = ("hip", "thigh", "calf")
JOINTS = tuple(f"{leg}_{part}_joint" for leg in LEGS for part in PARTS)
THIGH, CALF = 0.213, 0.213  # lengths [m]
HIP_X, HIP_Y, OUT = 0.19, 0.047, 0.095  # places of the hips on the trunk, and of the thighs beside them [m]
FOOT = 0.022  # radius [m]
IMU_AT, IMU_TURNED = (-0.04, 0.02, 0.06), (0.0, 0.0, 0.3)  # on the trunk [m], roll, pitch, yaw [rad]


@dataclass(frozen=True)
class Numbers:
    """What differs between the robot and its model: inertial numbers of each leg's links and numbers of its joints.

    Attributes:
        mass: Of hip, thigh and calf of each leg [kg], ``(12,)``; so are all others, in the order of `JOINTS`.
        center: Centres of mass [m], ``(12, 3)``.
        radius: Radii of gyration about the centres [m], ``(12, 3)``.
        armature: Rotor inertia on the joint side [kg m^2].
        damping: [N m s/rad].
        friction: [N m].
        trunk: Mass of the trunk [kg].
    """

    mass: Array
    center: Array
    radius: Array
    armature: Array
    damping: Array
    friction: Array
    trunk: float = 7.0


def stated() -> Numbers:
    """A robot of 15 kg, the numbers rounded from those of common ones."""
    mass = np.tile([0.68, 1.15, 0.24], 4)
    center, radius = np.empty((12, 3)), np.empty((12, 3))
    for k, leg in enumerate(LEGS):
        x, y = (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)
        center[3 * k : 3 * k + 3] = [(-0.005 * x, 0.002 * y, 0.0), (-0.004, -0.022 * y, -0.033), (0.005, 0.0, -0.13)]
        radius[3 * k : 3 * k + 3] = [(0.027, 0.031, 0.024), (0.071, 0.067, 0.035), (0.079, 0.08, 0.013)]
    return Numbers(mass, center, radius, np.tile([0.01, 0.01, 0.02], 4), np.full(12, 0.05), np.tile([0.2, 0.2, 0.3], 4))


def _text(values: Array | tuple[float, ...]) -> str:
    return " ".join(f"{x:.9g}" for x in np.ravel(values))


def _sides(leg: str) -> tuple[float, float]:
    return (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)


def _place(leg: str, part: str) -> tuple[float, float, float]:
    """Of a joint on the link before it."""
    x, y = _sides(leg)
    return {"hip": (x * HIP_X, y * HIP_Y, 0.0), "thigh": (0.0, y * OUT, 0.0), "calf": (0.0, 0.0, -THIGH)}[part]


def _axis(part: str) -> str:
    return "1 0 0" if part == "hip" else "0 1 0"


def plant(numbers: Numbers, step: float) -> str:
    """MJCF on flat ground, with an inertial sensor on the trunk and a sensor of touch at every foot.

    Dry friction is left out: MuJoCo's is softer than that of gears.

    Args:
        numbers: Of the robot that moves.
        step: Of the simulation [s].
    """
    legs, motors, touch = [], [], []
    for k, leg in enumerate(LEGS):
        for i, part in enumerate(PARTS):
            j = 3 * k + i
            name = f"{leg}_{part}"
            moments = numbers.mass[j] * numbers.radius[j] ** 2
            legs.append(
                f'<body name="{name}" pos="{_text(_place(leg, part))}">'
                f'<inertial mass="{numbers.mass[j]:.9g}" pos="{_text(numbers.center[j])}" '
                f'diaginertia="{_text(moments)}"/>'
                f'<joint name="{name}_joint" axis="{_axis(part)}" armature="{numbers.armature[j]:.9g}" '
                f'damping="{numbers.damping[j]:.9g}"/>'
            )
            motors.append(f'<motor joint="{name}_joint"/>')
        legs.append(
            f'<geom name="{leg}_foot" size="{FOOT}" pos="0 0 {-CALF}"/>'
            f'<site name="{leg}_touch" size="{1.2 * FOOT}" pos="0 0 {-CALF}"/></body></body></body>'
        )
        touch.append(f'<touch site="{leg}_touch"/>')
    return f"""<mujoco model="quadruped"><compiler angle="radian" eulerseq="XYZ"/>
<option timestep="{step}" integrator="implicitfast"/>
<default><geom friction="0.8 0.02 0.01" solref="0.02 1" condim="4"/></default>
<worldbody><geom type="plane" size="0 0 1"/><body name="trunk" pos="0 0 0.34"><freejoint name="free"/>
<inertial mass="{numbers.trunk:.9g}" pos="0.02 0 0" diaginertia="0.025 0.098 0.107"/>
<site name="imu" pos="{_text(IMU_AT)}" euler="{_text(IMU_TURNED)}"/>
{"".join(legs)}</body></worldbody><actuator>{"".join(motors)}</actuator>
<sensor><gyro site="imu"/><accelerometer site="imu"/>{"".join(touch)}</sensor></mujoco>"""


def urdf(numbers: Numbers) -> str:
    """What the diagnosis is given."""
    out = ['<robot name="quadruped"><link name="trunk"/><link name="imu"/>']
    out.append(
        f'<joint name="imu_joint" type="fixed"><parent link="trunk"/><child link="imu"/><origin xyz="{_text(IMU_AT)}" '
        f'rpy="{_text(IMU_TURNED)}"/></joint>'
    )
    for k, leg in enumerate(LEGS):
        before = "trunk"
        for i, part in enumerate(PARTS):
            j, name = 3 * k + i, f"{leg}_{part}"
            xx, yy, zz = numbers.mass[j] * numbers.radius[j] ** 2
            out.append(
                f'<link name="{name}"><inertial><origin xyz="{_text(numbers.center[j])}"/>'
                f'<mass value="{numbers.mass[j]:.9g}"/><inertia ixx="{xx:.9g}" iyy="{yy:.9g}" izz="{zz:.9g}" ixy="0" '
                f'ixz="0" iyz="0"/></inertial></link><joint name="{name}_joint" type="revolute">'
                f'<parent link="{before}"/><child link="{name}"/><origin xyz="{_text(_place(leg, part))}"/>'
                f'<axis xyz="{_axis(part)}"/><limit lower="-3" upper="3" effort="100" velocity="40"/>'
                f'<dynamics damping="{numbers.damping[j]:.9g}" friction="{numbers.friction[j]:.9g}"/></joint>'
            )
            before = name
        out.append(
            f'<link name="{leg}_foot"/><joint name="{leg}_foot_fixed" type="fixed"><parent link="{before}"/>'
            f'<child link="{leg}_foot"/><origin xyz="0 0 {-CALF}"/></joint>'
        )
    return "\n".join([*out, "</robot>", ""])
