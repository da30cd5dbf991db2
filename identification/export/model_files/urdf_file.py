# pyright: reportAttributeAccessIssue=false
"""Writes a robot as URDF: edits the inertias and friction in its given file, or writes a new file.

Editing leaves the rest of the file unchanged. If several links are fixed to each other and so form one moving body,
their inertias in the file add up to the body's inertia. A new file has tree, inertias and friction, but no shapes.
"""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from identification.export.model_files.tree import LinkInertia, bodies, frames
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.tree_motion import tree_friction
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.inertia import body_name, breaks_triangle, central_parameters, impossible_because
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_xml import Element

_SCHEMES = tuple(f"{name}://" for name in ("package", "file", "http", "https", "model"))


def stated_inertia(link: Element) -> pin.Inertia | None:
    """Inertia that a URDF link states, in the axes of the link; None if it states none."""
    inertial = link.find("inertial")
    mass, inertia = (None, None) if inertial is None else (inertial.find("mass"), inertial.find("inertia"))
    if inertial is None or mass is None or inertia is None:
        return None
    ixx, ixy, ixz, iyy, iyz, izz = (float(inertia.get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    matrix = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    place = placement(inertial.find("origin"))
    turn = place.rotation
    return pin.Inertia(float(mass.get("value", "0")), place.translation, turn @ matrix @ turn.T)


def placement(origin: Element | None) -> pin.SE3:
    """Placement that an ``<origin>`` of a URDF states; the identity without one."""
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array([float(x) for x in origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def child_of(element: Element, tag: str) -> Element:
    """The first child with this tag; a new child is added if the element has none."""
    found = element.find(tag)
    return ElementTree.SubElement(element, tag) if found is None else found


def comment_parser() -> ElementTree.XMLParser:
    """A parser that keeps comments, which often state where numbers come from."""
    return ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))


def link_of_joint(root: Element, joint: str) -> str | None:
    """Name of the child link of a joint in a URDF."""
    for element in root.findall("joint"):
        child = element.find("child")
        if element.get("name") == joint and child is not None:
            return child.get("link")
    return None


def fixed_links(robot: Robot, root: Element, body: int, own: str) -> dict[str, Float[Array, " 10"]]:
    """Standard inertial parameters of the links that are fixed to the link on a joint, about this joint.

    Links without an inertia in the URDF are left out.

    Args:
        robot: The robot, with the placements of the links.
        root: Root element of the URDF.
        body: Pinocchio's index of the joint.
        own: Name of the link on the joint, to which the others are fixed.
    """
    places = {f.name: f.placement for f in robot.model.frames if f.type == pin.FrameType.BODY and f.parentJoint == body}
    stated = {link.get("name", ""): stated_inertia(link) for link in root.findall("link")}
    return {
        name: places[name].act(inertia).toDynamicParameters()
        for name, inertia in stated.items()
        if inertia is not None and name in places and name != own
    }


def locked_links(robot: Robot, root: Element) -> frozenset[str]:
    """Names of the links that only a locked joint fixes to their body.

    They are the child links of locked joints and all links that are fixed to these.
    """
    children: dict[str, list[tuple[str, str]]] = {}
    for element in root.findall("joint"):
        parent, child = element.find("parent"), element.find("child")
        if parent is not None and child is not None:
            children.setdefault(parent.get("link", ""), []).append((element.get("name", ""), child.get("link", "")))
    moving = set(robot.model.names)
    out: set[str] = set()
    todo = [child for links in children.values() for joint, child in links if joint in robot.locked]
    while todo:
        link = todo.pop()
        out.add(link)
        todo += [child for joint, child in children.get(link, []) if joint not in moving]
    return frozenset(out)


def own_inertia(
    robot: Robot, body: int, fixed: dict[str, Float[Array, " 10"]], keeping: frozenset[str], *, broken: bool = False
) -> tuple[LinkInertia, frozenset[str]]:
    """Inertia of the link on a joint: the inertia of the whole body minus that of the links fixed to this link.

    If this difference is physically impossible, the inertia of the fixed links is moved to the link on the joint.

    Args:
        robot: The robot, with the inertia of the body.
        body: Pinocchio's index of the joint.
        fixed: Parameters of the links that are fixed to the link on the joint, from `fixed_links`.
        keeping: Links behind a locked joint, from `locked_links`; they keep their inertia.
        broken: True if the link's inertia in the given file already violates the triangle inequality.

    Returns:
        The inertia, and the names of the links that lose their inertia.

    Raises:
        ParameterError: If the difference is impossible in both cases.
    """
    whole = robot.model.inertias[body].toDynamicParameters()
    reason = None
    for losing in (frozenset[str](), frozenset(fixed) - keeping):
        difference = whole - sum((fixed[name] for name in fixed if name not in losing), np.zeros(10))
        mass, center, inertia = central_parameters(difference)
        reason = impossible_because(mass, inertia)
        if reason is None and ((broken and not fixed) or not breaks_triangle(inertia)):
            return LinkInertia(mass, center, inertia), losing
        reason = reason or _BROKEN
    raise ParameterError(_cannot_exist(body_name(robot, body), str(reason)))


_BROKEN = "one principal inertia exceeds the sum of the others"


def _cannot_exist(link: str, reason: str) -> str:
    """Error message for a link with a physically impossible inertia."""
    return (
        f"The link {link} cannot exist with the identified inertia, {reason}: record more motion, or take an estimator "
        "that keeps bodies possible."
    )


def edited_urdf(robot: Robot, given: Robot, file: Path, folder: Path) -> str:
    """The text of a given URDF with new inertias and friction where these differ from the given model.

    Args:
        robot: The robot with the new inertias and friction.
        given: The model in the file.
        file: The URDF.
        folder: Folder of the new file, to which file names of meshes are made relative.

    Raises:
        RobotError: If the file has no link on a joint of the robot.
        ParameterError: If the inertia of a link would be physically impossible.
    """
    root = ElementTree.parse(file, comment_parser()).getroot()
    links = {link.get("name", ""): link for link in root.findall("link")}
    keeping = locked_links(given, root)
    for body in range(1, robot.model.njoints):
        if robot.model.inertias[body] == given.model.inertias[body]:
            continue
        own = link_of_joint(root, robot.model.names[body])
        if own is None or own not in links:
            raise RobotError(f"{file} has no link on the joint {robot.model.names[body]}: give the robot's URDF.")
        stated = stated_inertia(links[own])
        broken = stated is not None and breaks_triangle(stated.inertia)
        inertia, losing = own_inertia(robot, body, fixed_links(given, root, body, own), keeping, broken=broken)
        for name in losing:
            for element in links[name].findall("inertial"):
                links[name].remove(element)
        set_inertial(links[own], inertial_element(inertia))
    _set_friction(root, robot, given)
    _relocate(root, file.resolve().parent, folder)
    ElementTree.indent(root)
    before = "".join(f"<!--{comment}-->\n" for comment in _comments_before(file))
    return f'<?xml version="1.0"?>\n{before}{ElementTree.tostring(root, encoding="unicode")}\n'


def _comments_before(file: Path) -> list[str]:
    """Comments before the root element, which the parser does not keep."""
    out = []
    for event, element in ElementTree.iterparse(file, events=("start", "comment")):
        if event == "start":
            break
        out.append(element.text or "")
    return out


def inertial_element(inertia: LinkInertia) -> Element:
    """The ``<inertial>`` of a link, with all digits of the numbers."""
    element = ElementTree.Element("inertial")
    ElementTree.SubElement(element, "origin", xyz=attribute_text(inertia.center), rpy="0 0 0")
    ElementTree.SubElement(element, "mass", value=repr(float(inertia.mass)))
    names = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
    entries = {name: repr(float(inertia.inertia[i, j])) for name, i, j in names}
    ElementTree.SubElement(element, "inertia", entries)
    return element


def attribute_text(numbers) -> str:
    """Numbers as the text of an attribute, with all digits."""
    return " ".join(repr(float(x)) for x in np.ravel(numbers))


def set_inertial(link: Element, inertial: Element) -> None:
    """Replaces the ``<inertial>`` of a link or body."""
    for element in link.findall("inertial"):
        link.remove(element)
    link.insert(0, inertial)


def _set_friction(root: Element, robot: Robot, given: Robot) -> None:
    """Writes each joint's damping and friction that differ from the given model."""
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    new, old = tree_friction(robot), tree_friction(given)
    for k, name in enumerate(list(robot.model.names)[1:]):
        for values, before, attribute in zip(new, old, ("damping", "friction"), strict=True):
            if values[k] != before[k] and name in joints:
                child_of(joints[name], "dynamics").set(attribute, repr(float(values[k])))


def _relocate(root: Element, source: Path, folder: Path) -> None:
    """Makes file names that are relative to ``source`` relative to ``folder`` instead."""
    for element in root.iter():
        name = element.get("filename") if isinstance(element.tag, str) else None
        if name and not name.startswith(_SCHEMES) and not Path(name).is_absolute() and (source / name).exists():
            element.set("filename", Path(os.path.relpath(source / name, folder.resolve())).as_posix())


def new_urdf(robot: Robot) -> str:
    """The text of a new URDF.

    Args:
        robot: The robot; closed loops are cut open, as a URDF is a tree.

    Raises:
        ParameterError: If the inertia of a body is physically impossible.
    """
    root = ElementTree.Element("robot", name=robot.name)
    tree, places = bodies(robot), frames(robot)
    taken = {body.name for body in tree} | {place.name for place in places}
    ground = next(name for name in ("ground", *(f"ground_{k}" for k in range(len(taken) + 1))) if name not in taken)
    names = [*(body.name for body in tree), ground]  # the ground is last, so that index -1 is the ground
    ElementTree.SubElement(root, "link", name=ground)
    for body in tree:
        if breaks_triangle(body.inertia.inertia):
            raise ParameterError(_cannot_exist(body.name, _BROKEN))
        link = ElementTree.SubElement(root, "link", name=body.name)
        link.append(inertial_element(body.inertia))
        kind = "prismatic" if body.prismatic else "revolute" if body.limits else "continuous"
        joint = _joint(root, body.joint, kind, names[body.parent], body.name, body.rotation, body.position)
        ElementTree.SubElement(joint, "axis", xyz=attribute_text(body.axis))
        # URDF requires limits of a linear joint, and an effort and a velocity wherever there are limits.
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
    """Adds a joint between two links; rotation and position are its placement in the parent link."""
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(
        joint, "origin", xyz=attribute_text(position), rpy=attribute_text(pin.rpy.matrixToRpy(np.array(rotation)))
    )
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint
