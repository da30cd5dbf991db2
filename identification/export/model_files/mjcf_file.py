# pyright: reportAttributeAccessIssue=false
"""Writes a robot as MJCF: tree, inertias, damping, dry friction, rotor inertias and loops; no shapes.

A joint whose position is a linear function of other joints becomes an equality. With one other joint it is a joint
equality; with several it is the equality of a tendon.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from identification.export.model_files.tree import LinkInertia, TreeBody, TreeFrame, bodies, frames
from identification.export.model_files.urdf_file import attribute_text
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import breaks_triangle, central_parameters
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_xml import Element

_LEAST = 1e-15
"""Smallest mass [kg] and principal inertia [kg m^2] that MuJoCo accepts for a moving body."""


def mjcf_text(robot: Robot) -> str:
    """The text of an MJCF, with one motor per driven joint and an equality for each closed loop.

    Args:
        robot: The robot.

    Raises:
        ParameterError: If a body's inertia is physically impossible, or one that MuJoCo refuses.
    """
    root = ElementTree.Element("mujoco", model=robot.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", gravity=attribute_text(robot.model.gravity.linear))
    world = ElementTree.SubElement(root, "worldbody")
    if robot.floating:
        world = _trunk(world, robot)
    tree = bodies(robot)
    elements: list[Element] = []
    for body in tree:
        elements.append(_body(elements[body.parent] if body.parent >= 0 else world, body))
    for site in frames(robot):
        if site.name == world.get("name"):
            continue
        _site(elements[site.body] if site.body >= 0 else world, site)
    _loops(root, robot, [*elements, world])
    add_followers(root, robot)
    actuators = ElementTree.SubElement(root, "actuator")
    for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True):
        if actuator.actuated:
            ElementTree.SubElement(actuators, "motor", name=f"{joint}_motor", joint=joint)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _body(parent: Element, body: TreeBody) -> Element:
    """Adds a body with its joint and inertia to its parent element."""
    inertia = body.inertia
    if inertia.mass < _LEAST or np.linalg.eigvalsh(inertia.inertia)[0] < _LEAST:
        raise ParameterError(
            f"{body.name} has no mass, or no inertia about some axis, which MuJoCo requires of a moving body: state "
            "both in the robot's file."
        )
    if breaks_triangle(inertia.inertia):
        raise ParameterError(
            f"A principal inertia of {body.name} exceeds the sum of the others, which MuJoCo does not accept: correct "
            "it in the robot's file, or record more motion if it was identified."
        )
    element = ElementTree.SubElement(parent, "body", {"name": body.name, **_place(body.position, body.rotation)})
    joint = {"name": body.joint, "type": "slide" if body.prismatic else "hinge", "axis": attribute_text(body.axis)}
    for name, value in (("damping", body.damping), ("frictionloss", body.friction), ("armature", body.armature)):
        if value:
            joint[name] = repr(value)
    if body.limits is not None:
        joint["range"] = attribute_text(body.limits)
    ElementTree.SubElement(element, "joint", joint)
    element.append(inertial_of(inertia))
    return element


def inertial_of(inertia: LinkInertia) -> Element:
    """The ``<inertial>`` of a body, with all digits of the numbers."""
    entries = [inertia.inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    # MuJoCo refuses a full matrix of zeros.
    matrix = {"fullinertia": attribute_text(entries)} if inertia.mass else {"diaginertia": "0 0 0"}
    attributes = {"pos": attribute_text(inertia.center), "mass": repr(float(inertia.mass)), **matrix}
    return ElementTree.Element("inertial", attributes)


def _trunk(world: Element, robot: Robot) -> Element:
    """Adds the body of a floating base; returns the world instead if MuJoCo would refuse the base's inertia."""
    mass, center, inertia = central_parameters(robot.model.inertias[0].toDynamicParameters())
    if mass < _LEAST or np.linalg.eigvalsh(inertia)[0] < _LEAST or breaks_triangle(inertia):
        return world
    body_names = [f.name for f in robot.model.frames if f.parentJoint == 0 and f.type == pin.FrameType.BODY]
    trunk = ElementTree.SubElement(world, "body", name=body_names[0] if body_names else "trunk")
    ElementTree.SubElement(trunk, "freejoint")
    trunk.append(inertial_of(LinkInertia(mass, center, inertia)))
    return trunk


def _site(parent: Element, site: TreeFrame) -> None:
    ElementTree.SubElement(parent, "site", {"name": site.name, "size": "0.005", **_place(site.position, site.rotation)})


def _loops(root: Element, robot: Robot, owners: list[Element]) -> None:
    """Adds an equality between two sites for each loop that keeps two frames together."""
    if robot.chain is None or not robot.chain.anchors:
        return
    group = ElementTree.SubElement(root, "equality")
    for index, anchor in enumerate(robot.chain.anchors):
        names = [f"loop_{index}_a", f"loop_{index}_b"]
        for name, frame in zip(names, (anchor.frame_a, anchor.frame_b), strict=True):
            model_frame = robot.model.frames[frame]
            # Joint 0 is the ground, which is the last of the owners (index -1).
            tree_frame = TreeFrame(
                name, -1, np.array(model_frame.placement.rotation), np.array(model_frame.placement.translation)
            )
            _site(owners[model_frame.parentJoint - 1], tree_frame)
        kind = "connect" if anchor.kind == "point" else "weld"
        ElementTree.SubElement(group, kind, name=f"loop_{index}", site1=names[0], site2=names[1])


def _place(position: Float[Array, " 3"], rotation: Float[Array, "3 3"]) -> dict[str, str]:
    """A placement as the attributes ``pos`` and ``quat``."""
    turn = pin.Quaternion(np.array(rotation)).normalized()
    return {"pos": attribute_text(position), "quat": attribute_text([turn.w, turn.x, turn.y, turn.z])}


FOLLOWS = "{}_follows"
"""Name of the equality, and of its tendon, for a joint whose position depends on other joints."""
_SOFTNESS = {"solref": "0.004 1", "solimp": "0.99 0.9999 0.001"}
"""Stiffest equality that MuJoCo's default step of 2 ms allows: its time constant is two steps."""


def add_followers(root: Element, robot: Robot) -> None:
    """Adds an equality for each joint whose position is a linear function of other joints.

    MuJoCo measures the positions in an equality from each joint's ``ref``, which is zero unless the file states one.

    Args:
        root: Root element of an MJCF with the robot's joints; changed in place.
        robot: The robot; nothing is added for one without loops.
    """
    chain = robot.chain
    if chain is None:
        return
    names = list(robot.model.names)[1:]
    free = [*(names[k] for k in chain.active), *(names[k] for k in chain.unknowns)]
    following = [k for k in chain.passive if k not in chain.unknowns]
    if not following:
        return
    group = ElementTree.SubElement(root, "equality")
    tendons: Element | None = None
    for k in following:
        factors = {joint: float(x) for joint, x in zip(free, chain.linear_map[k], strict=True) if x != 0}
        offset = float(chain.offset[k])
        name = FOLLOWS.format(names[k])
        if len(factors) <= 1:
            leader, slope = next(iter(factors.items()), ("", 0.0))
            attributes = {"name": name, "joint1": names[k], "polycoef": attribute_text([offset, slope, 0, 0, 0])}
            ElementTree.SubElement(group, "joint", attributes | ({"joint2": leader} if leader else {}) | _SOFTNESS)
            continue
        tendons = ElementTree.SubElement(root, "tendon") if tendons is None else tendons
        tendon = ElementTree.SubElement(tendons, "fixed", name=name)
        for joint, share in ((names[k], 1.0), *((joint, -factor) for joint, factor in factors.items())):
            ElementTree.SubElement(tendon, "joint", joint=joint, coef=repr(float(np.float64(share))))
        attributes = {"name": name, "tendon1": name, "polycoef": attribute_text([offset, 0, 0, 0, 0])}
        ElementTree.SubElement(group, "tendon", attributes | _SOFTNESS)
