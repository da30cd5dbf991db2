# pyright: reportAttributeAccessIssue=false
"""Inertia of a moving body split over the links of a robot file that are fixed to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import body_name, breaks_triangle, central_parameters, impossible_because
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_xml import Element

Array = np.ndarray


@dataclass(frozen=True)
class LinkInertia:
    """Inertia of one link in the axes of its own frame.

    Attributes:
        mass: In kg.
        center: Centre of mass [m].
        inertia: About the centre of mass [kg m^2].
    """

    mass: float
    center: Float[Array, " 3"]
    inertia: Float[Array, "3 3"]


def stated_inertia(link: Element) -> pin.Inertia | None:
    """Inertia that a URDF link states, in the axes of the link; None if it states none."""
    inertial = link.find("inertial")
    mass, inertia = (None, None) if inertial is None else (inertial.find("mass"), inertial.find("inertia"))
    if inertial is None or mass is None or inertia is None:
        return None
    origin = inertial.find("origin")
    xyz, rpy = (
        np.array([float(x) for x in ("0 0 0" if origin is None else origin.get(key, "0 0 0")).split()])
        for key in ("xyz", "rpy")
    )
    ixx, ixy, ixz, iyy, iyz, izz = (float(inertia.get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    matrix = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    turn = pin.rpy.rpyToMatrix(rpy)
    return pin.Inertia(float(mass.get("value", "0")), xyz, turn @ matrix @ turn.T)


def link_of_joint(root: Element, joint: str) -> str | None:
    """Name of the link that a URDF hangs on a joint."""
    for element in root.findall("joint"):
        child = element.find("child")
        if element.get("name") == joint and child is not None:
            return child.get("link")
    return None


def fixed_links(robot: Robot, root: Element, body: int, own: str) -> dict[str, Float[Array, " 10"]]:
    """Standard parameters, about the joint, of the other links of a body that state an inertia.

    Args:
        robot: Gives the places of the links.
        root: Of the URDF.
        body: Pinocchio's index of the body's joint.
        own: The link that hangs on the joint itself.
    """
    places = {f.name: f.placement for f in robot.model.frames if f.type == pin.FrameType.BODY and f.parentJoint == body}
    stated = {link.get("name", ""): stated_inertia(link) for link in root.findall("link")}
    return {
        name: places[name].act(inertia).toDynamicParameters()
        for name, inertia in stated.items()
        if inertia is not None and name in places and name != own
    }


def links_held(robot: Robot, root: Element) -> frozenset[str]:
    """Links that hang, at any depth, on a joint that is held fixed: a file without the lock lets them move."""
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
    robot: Robot, body: int, fixed: dict[str, Float[Array, " 10"]], held: frozenset[str]
) -> tuple[LinkInertia, frozenset[str]]:
    """Inertia of the link on a joint, such that it and the links fixed to it make the body's.

    Links fixed to it keep what the file states. Where nothing possible is left for the link itself, they lose their
    inertia to it; only those behind a joint that is held fixed keep it always.

    Args:
        robot: Gives the body's inertia.
        body: Pinocchio's index of its joint.
        fixed: See `fixed_links`.
        held: See `links_held`.

    Returns:
        The inertia, and the links that lose theirs.

    Raises:
        ParameterError: If no body can have what is left for the link.
    """
    whole = robot.model.inertias[body].toDynamicParameters()
    reason = None
    for losing in (frozenset[str](), frozenset(fixed) - held):
        rest = whole - sum((fixed[name] for name in fixed if name not in losing), np.zeros(10))
        mass, center, inertia = central_parameters(rest)
        reason = impossible_because(mass, inertia)
        if reason is None and not (fixed and breaks_triangle(inertia)):
            return LinkInertia(mass, center, inertia), losing
        reason = reason or "one principal inertia exceeds the sum of the others"
    raise ParameterError(
        f"The link {body_name(robot, body)} cannot exist with the identified inertia, {reason}: record more motion, or "
        "take an estimator that keeps bodies possible."
    )
