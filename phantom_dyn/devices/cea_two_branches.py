r"""URDF and robot.yaml of a haptic device of six degrees of freedom: two CEA branches, a platform and a handle.

The source (section IV) describes the whole device: a platform joins two branches of three degrees of freedom and
carries a motorized handle. There are seven motors in total, and extra links of constant orientation between branches
and platform (the `support` of each branch). The source identifies only the upper branch.
**Lengths and masses of platform and handle, and the place of the lower branch, are not published: they are inputs.**

Both branches are the built-in `cea_branch`, with parallel axes of their first joints; the lower branch is below the
upper one by the length of the platform. A universal joint connects the platform to the upper support, and a ball joint
(a point that both share) to the lower one. So the device has :math:`3 + 2 + 3 - 3 = 5` degrees of freedom, and the
rotation of the handle about the axis of the platform is the sixth. One of the seven motors is redundant: the others
determine the angle of the lower shoulder.

**Rods.** The source leaves the rods out of its model (section V.D) and states which parameters they would add. A second
rod runs beside the arm from a point E of the shoulder to a piece CDG at the elbow. A third rod runs beside the forearm
from this piece to the support of the handle. The piece keeps the direction of the shoulder, as the support does. "If
the arm and the second rod have the same translational velocity" all parameters of the rod regroup with the arm, "else
MYR2 can be identified": one parameter per rod.

**When a rod adds a parameter.** The source says that the offset of E and E' is along X1. Then the foot of the rod moves
with q1, and the first moment across the rod, MY, is a base parameter; the first moment along the rod, MX, regroups with
those of the arm and the piece. Without rods the branch has 21 inertial base parameters (axis 1 horizontal). The piece
adds its radial first moment, and each rod adds one parameter. A rod with an offset along another axis, or without an
offset, adds none. These numbers are ranks of the regressor of the closed chain; lengths and masses are inputs, as the
source gives none.

References:
    Sections IV and V.D, and figures 1 and 2 of [CEA]_ (`phantom_dyn.devices.cea`).
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.devices.cea import GRAVITY, LENGTHS
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import builtin_robots
from phantom_dyn.number_checks import require_positive

Vector = tuple[float, float, float]

_BRANCH = "cea_branch"
UPPER, LOWER = "upper_", "lower_"
"""Prefixes of the names of links and joints of the two branches."""
ACTIVE = ("lower_q2", "lower_q5", "upper_q1", "upper_q2", "handle", "upper_q5")
"""Joints that position the device, in the order of its tree; `lower_q1` and both angles of the platform are passive."""
MOTORS = ("upper_q1", "upper_q2", "upper_q5", "lower_q1", "lower_q2", "lower_q5", "handle")
"""The seven motors."""
_ARM, _FOREARM = math.radians(-15), math.radians(-105)
POSTURE = (_ARM, _FOREARM, 0.0, _ARM, 0.0, _FOREARM)
"""Angles of the `ACTIVE` joints [rad]: each branch at `cea_dynamics.nearest_posture`, the platform upright."""

_NO_OFFSET = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Platform:
    """Platform and handle; none of it is published.

    Attributes:
        length: Distance between the tips of both branches [m].
        mass: Mass of the platform, which is a thin rod of this length [kg].
        handle_mass: Mass of the handle, which is a cylinder [kg].
        handle_length: Length of the handle along the platform [m].
        handle_radius: Radius of the handle [m].

    Raises:
        ParameterError: If a number is not above 0.
    """

    length: float = 0.12
    mass: float = 0.05
    handle_mass: float = 0.05
    handle_length: float = 0.10
    handle_radius: float = 0.015

    def __post_init__(self) -> None:
        require_positive("the platform", **vars(self))


PLATFORM = Platform()
"""Default platform and handle, with round numbers."""


def two_branches_urdf(platform: Platform = PLATFORM) -> str:
    """Text of the URDF: both branches, joints ``tilt`` and ``swing`` of the platform, the handle with frame ``tip``.

    Raises:
        RobotError: If the built-in branch is not installed.
    """
    out = ET.Element("robot", name="cea_two_branches")
    ET.SubElement(out, "link", name="ground")
    for prefix, height in ((UPPER, 0.5 * platform.length), (LOWER, -0.5 * platform.length)):
        out.extend(branch_elements(prefix))
        add_joint(out, f"{prefix}mount", ("ground", f"{prefix}base"), (0.0, height, 0.0))
    half, radius = 0.5 * platform.length, platform.handle_radius
    # At `POSTURE` the -z axis of the upper support points down, to the lower one.
    add_link(out, "yoke", 1e-3, _NO_OFFSET, (1e-7, 1e-7, 1e-7))
    rod = platform.mass * platform.length**2 / 12
    add_link(out, "platform", platform.mass, (0.0, 0.0, -half), (rod, rod, 0.5 * platform.mass * radius**2))
    wide = platform.handle_mass * (3 * radius**2 + platform.handle_length**2) / 12
    add_link(out, "grip", platform.handle_mass, _NO_OFFSET, (wide, wide, 0.5 * platform.handle_mass * radius**2))
    ET.SubElement(out, "link", name="tip")
    ET.SubElement(out, "link", name="platform_end")
    add_joint(out, "tilt", (f"{UPPER}link4", "yoke"), _NO_OFFSET, axis=(1.0, 0.0, 0.0))
    add_joint(out, "swing", ("yoke", "platform"), _NO_OFFSET, axis=(0.0, 1.0, 0.0))
    add_joint(out, "handle", ("platform", "grip"), (0.0, 0.0, -half), axis=(0.0, 0.0, 1.0))
    add_joint(out, "tip_fixed", ("grip", "tip"), _NO_OFFSET)
    add_joint(out, "platform_end_fixed", ("platform", "platform_end"), (0.0, 0.0, -platform.length))
    return urdf_text(out)


def two_branches_yaml() -> str:
    """Text of the ``robot.yaml`` beside this URDF: gravity, loops of both branches, and the loop of the platform."""
    lines = [f"gravity: [{', '.join(f'{g:g}' for g in GRAVITY)}]", "payload_frame: tip", "loops:"]
    for prefix in (UPPER, LOWER):
        q2, q5 = f"{prefix}q2", f"{prefix}q5"
        passive = f'{prefix}q3: "{q5} - {q2}", {prefix}q4: "pi/2 - {q5}", {prefix}q6: "{q2} - {q5}"'
        lines.append(f"  - {{kind: linear, active: [{q2}, {q5}], passive: {{{passive}}}}}")
    start = ", ".join(f"{name}: {value!r}" for name, value in zip(ACTIVE, POSTURE, strict=True) if name != "handle")
    # Active joints between the two frames. The forearms' motors are not among them: they drive the parallelograms.
    driven = f"{UPPER}q1, {UPPER}q2, {LOWER}q2"
    lines.append("  - kind: point")
    lines.append(f"    frame_a: platform_end\n    frame_b: {LOWER}tip\n    active: [{driven}]\n    start: {{{start}}}")
    return "\n".join(lines) + "\n"


def motor_slope(robot: Robot, q: Float[Array, "N 6"]) -> Float[Array, "N 7 6"]:
    """Angles of the seven `MOTORS` per angle of the six `ACTIVE` joints, shape ``(N, 7, 6)``.

    Args:
        robot: Robot from `two_branches_urdf` and `two_branches_yaml`.
        q: Positions of the active joints [rad]; neighbouring samples have to be close to each other.

    Raises:
        RobotError: If the robot is not this one.
        ChainError: If the loops cannot be closed.
    """
    names = list(robot.model.names)[1:]
    if robot.joint_names != ACTIVE or not set(MOTORS) <= set(names):
        raise RobotError(
            f"{robot.name} has the active joints {', '.join(robot.joint_names)}: give the device of two branches, with "
            f"{', '.join(ACTIVE)}."
        )
    return robot.solutions.at(q).G[:, [names.index(name) for name in MOTORS]]


def shared_torque(slope: Float[Array, "N 7 6"], tau: Float[Array, "N 6"]) -> Float[Array, "N 7"]:
    r"""Torques of the seven motors with the least sum of squares [N m] that satisfy :math:`J_m^T \tau_m = \tau`.

    Args:
        slope: Result of `motor_slope`.
        tau: Torques at the active joints, from inverse dynamics [N m].

    Raises:
        ParameterError: If there are not as many torques as slopes.
    """
    if len(slope) != len(tau):
        raise ParameterError(f"{len(tau)} torques and {len(slope)} slopes were given: give one of each per sample.")
    return np.einsum("nij,nj->ni", np.linalg.pinv(np.swapaxes(slope, 1, 2)), tau)


@dataclass(frozen=True)
class Rods:
    """Rods beside arm and forearm; none of it is published.

    Attributes:
        arm_offset: Vector from the crossing of the axes of shoulder and arm to the foot of the second rod, in the axes
            of the shoulder [m]; None leaves the rod out.
        forearm_offset: Vector from the elbow to the foot of the third rod, in the axes of the piece CDG [m]; None
            leaves the rod out.
        rod_mass: Mass of either rod [kg].
        piece_mass: Mass of the piece CDG [kg].

    Raises:
        ParameterError: If a mass is not above 0, or an offset is not three finite numbers.
    """

    arm_offset: Vector | None = (0.05, 0.0, 0.0)
    forearm_offset: Vector | None = (0.05, 0.0, 0.0)
    rod_mass: float = 0.02
    piece_mass: float = 0.05

    def __post_init__(self) -> None:
        require_positive("the rods", rod_mass=self.rod_mass, piece_mass=self.piece_mass)
        for offset in (self.arm_offset, self.forearm_offset):
            if offset is not None and not (len(offset) == 3 and np.isfinite(offset).all()):
                raise ParameterError(f"The foot of a rod is at {offset}: give three lengths in metres, or None.")


def branch_with_rods_urdf(rods: Rods) -> str:
    """Text of the URDF of the built-in branch with the piece CDG (``piece``) and its rods (``rod2``, ``rod3``).

    Raises:
        RobotError: If the built-in branch is not installed.
    """
    out = ET.Element("robot", name="cea_branch_with_rods")
    out.extend(branch_elements())
    small = rods.piece_mass * 0.02**2
    add_link(out, "piece", rods.piece_mass, _NO_OFFSET, (small, small, small))
    # The piece keeps the axes that the arm has at q2 = 0.
    add_joint(out, "r_piece", ("link2", "piece"), (LENGTHS.d3, 0.0, 0.0), axis=(0.0, 0.0, 1.0))
    for name, parent, offset, length, turn in (
        ("rod2", "link1", rods.arm_offset, LENGTHS.d3, (-0.5 * math.pi, 0.0, 0.0)),
        ("rod3", "piece", rods.forearm_offset, LENGTHS.d4, _NO_OFFSET),
    ):
        if offset is not None:
            across = rods.rod_mass * length**2 / 12
            add_link(out, name, rods.rod_mass, (0.5 * length, 0.0, 0.0), (1e-3 * across, across, across))
            add_joint(out, f"r_{name}", (parent, name), offset, axis=(0.0, 0.0, 1.0), turn=turn)
    return urdf_text(out)


def branch_with_rods_yaml(rods: Rods) -> str:
    """Text of the ``robot.yaml`` beside this URDF: (8), (9), (11), and rods that stay parallel to arm and forearm."""
    passive = {"q3": "q5 - q2", "q4": "pi/2 - q5", "q6": "q2 - q5", "r_piece": "-q2"}
    passive |= {"r_rod2": "q2"} if rods.arm_offset is not None else {}
    passive |= {"r_rod3": "q5"} if rods.forearm_offset is not None else {}
    given = ", ".join(f'{name}: "{expression}"' for name, expression in passive.items())
    gravity = ", ".join(f"{g:g}" for g in GRAVITY)
    return f"gravity: [{gravity}]\nloops:\n  - {{kind: linear, active: [q2, q5], passive: {{{given}}}}}\n"


def branch_elements(prefix: str = "") -> list[ET.Element]:
    """Links and joints of the built-in branch, with a prefix before their names.

    Raises:
        RobotError: If the built-in branch is not installed.
    """
    found = builtin_robots().get(_BRANCH)
    if found is None:
        raise RobotError(f"The built-in robot {_BRANCH} is not there: install the package with its robots.")
    elements = list(ET.parse(found).getroot())
    for element in elements:
        for part in element.iter():
            for key in ("name", "link"):
                if key in part.attrib:
                    part.set(key, prefix + part.attrib[key])
    return elements


def add_link(robot: ET.Element, name: str, mass: float, center: Vector, moments: Vector) -> None:
    """Add a link to a robot.

    Args:
        robot: The robot's XML element.
        name: Name of the link.
        mass: Mass [kg].
        center: Centre of mass, in the link's axes [m].
        moments: Moments of inertia about the centre of mass, along the link's axes [kg m2].
    """
    inertial = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz=_words(center))
    ET.SubElement(inertial, "mass", value=repr(float(mass)))
    x, y, z = (repr(float(moment)) for moment in moments)
    ET.SubElement(inertial, "inertia", ixx=x, ixy="0", ixz="0", iyy=y, iyz="0", izz=z)


def add_joint(
    robot: ET.Element,
    name: str,
    links: tuple[str, str],
    origin: Vector,
    *,
    axis: Vector | None = None,
    turn: Vector = (0.0, 0.0, 0.0),
) -> None:
    """Add a revolute joint to a robot, or a fixed one if no axis is given.

    Args:
        robot: The robot's XML element.
        name: Name of the joint.
        links: Names of parent and child.
        origin: Origin of the joint in the parent [m].
        axis: Axis of rotation in the joint's axes.
        turn: Roll, pitch and yaw of the joint's axes in the parent [rad].
    """
    joint = ET.SubElement(robot, "joint", name=name, type="fixed" if axis is None else "revolute")
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    ET.SubElement(joint, "origin", xyz=_words(origin), rpy=_words(turn))
    if axis is not None:
        # A URDF needs limits. None are published, so these are so wide that no motion reaches them.
        ET.SubElement(joint, "axis", xyz=_words(axis))
        ET.SubElement(joint, "limit", lower=repr(-math.pi), upper=repr(math.pi), effort="10", velocity="10")


def urdf_text(robot: ET.Element) -> str:
    """Text of an indented URDF file."""
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _words(values: Vector) -> str:
    return " ".join(repr(float(value)) for value in values)
