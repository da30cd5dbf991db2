"""Elements of a URDF: a link with its inertia, a joint about an axis, and the built-in branch under other names."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot_files import builtin_robots

Vector = tuple[float, float, float]

_BRANCH = "cea_branch"


def branch_elements(prefix: str = "") -> list[ET.Element]:
    """Links and joints of the built-in branch, a prefix before their names.

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
    """Put a link into a robot.

    Args:
        robot: The element of the robot.
        name: Of the link.
        mass: [kg].
        center: Of mass, in the link's axes [m].
        moments: Of inertia about the centre of mass, along the link's axes [kg m2].
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
    """Put a revolute joint into a robot, or a fixed one where no axis is given.

    Args:
        robot: The element of the robot.
        name: Of the joint.
        links: Parent and child.
        origin: Of the joint in the parent [m].
        axis: In the joint's axes.
        turn: Roll, pitch and yaw of the joint's axes in the parent [rad].
    """
    joint = ET.SubElement(robot, "joint", name=name, type="fixed" if axis is None else "revolute")
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    ET.SubElement(joint, "origin", xyz=_words(origin), rpy=_words(turn))
    if axis is not None:
        # Limits of torque and speed are not published: these bind nothing.
        ET.SubElement(joint, "axis", xyz=_words(axis))
        ET.SubElement(joint, "limit", lower=repr(-math.pi), upper=repr(math.pi), effort="10", velocity="10")


def urdf_text(robot: ET.Element) -> str:
    """The file, indented."""
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _words(values: Vector) -> str:
    return " ".join(repr(float(value)) for value in values)
