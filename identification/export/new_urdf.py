# pyright: reportAttributeAccessIssue=false
"""A URDF written from nothing, for a robot whose own file is none: tree, inertias and friction, no shapes."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from identification.export.tree_xml import bodies, frames
from identification.export.urdf import inertial_element, words
from phantom_dyn.robot import Robot
from phantom_dyn.robot_xml import Element

Array = np.ndarray


def new_urdf(robot: Robot) -> str:
    """The text of a URDF.

    Args:
        robot: Gives the tree; joints of loops are plain joints in it.

    Raises:
        ParameterError: If a body cannot exist.
    """
    root = ElementTree.Element("robot", name=robot.name)
    tree, places = bodies(robot), frames(robot)
    taken = {body.name for body in tree} | {place.name for place in places}
    ground = next(name for name in ("ground", *(f"ground_{k}" for k in range(len(taken) + 1))) if name not in taken)
    names = [*(body.name for body in tree), ground]  # parent -1 is the last
    ElementTree.SubElement(root, "link", name=ground)
    for body in tree:
        link = ElementTree.SubElement(root, "link", name=body.name)
        link.append(inertial_element(body.inertia))
        kind = "prismatic" if body.prismatic else "revolute" if body.limits else "continuous"
        joint = _joint(root, body.joint, kind, names[body.parent], body.name, body.rotation, body.position)
        ElementTree.SubElement(joint, "axis", xyz=words(body.axis))
        # URDF wants effort and speed with the limits, and a linear joint never goes without.
        low, high = body.limits or ((-1e3, 1e3) if body.prismatic else (0.0, 0.0))
        limit = {"lower": repr(low), "upper": repr(high)} if kind != "continuous" else {}
        ElementTree.SubElement(joint, "limit", limit, effort="1e6", velocity="1e3")
        ElementTree.SubElement(joint, "dynamics", damping=repr(body.damping), friction=repr(body.friction))
    for place in places:
        ElementTree.SubElement(root, "link", name=place.name)
        _joint(root, f"{place.name}_fixed", "fixed", names[place.body], place.name, place.rotation, place.position)
    ElementTree.indent(root)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _joint(
    root: Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    rotation: Float[Array, "3 3"],
    position: Float[Array, " 3"],
) -> Element:
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "origin", xyz=words(position), rpy=words(pin.rpy.matrixToRpy(np.array(rotation))))
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint
