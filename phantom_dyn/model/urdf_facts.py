"""Checks a URDF file, and reads its bodies and mimic joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from phantom_dyn.errors import RobotError, known_names, shortened
from phantom_dyn.model.robot_xml import (
    Body,
    Element,
    Follower,
    RobotXml,
    numbers,
    require_names,
    require_not_negative,
    require_once,
    require_order,
    symmetric,
)

# A shorter axis counts as zero.
_SHORTEST_AXIS = 1e-6
_ONCE_IN_JOINT = ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic")
_JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def urdf_facts(root: Element, sha256: str, path: Path) -> RobotXml:
    """Check a URDF, and read its bodies and mimic joints.

    Raises:
        RobotError: If a number is invalid, an axis is zero, friction is negative, limits are swapped, an element
            occurs twice that may occur once, or a joint mimics a joint that does not exist.
    """
    require_names(root.findall("link"), "link", path)
    require_names(root.findall("joint"), "joint", path)
    for link in root.findall("link"):
        require_once(link, ("inertial",), f"link {link.get('name')}", path)
    joints = root.findall("joint")
    fixed_links = _fixed_links(root, joints)
    bodies = [
        _urdf_body(link, path, moves=link.get("name") not in fixed_links)
        for link in root.findall("link")
        if link.find("inertial") is not None
    ]
    for joint in joints:
        _check_urdf_joint(joint, path)
    _require_tree(joints, path)
    names = [joint.get("name", "") for joint in joints]
    followers = {}
    for joint in joints:
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("type") != "fixed":  # Talos' files have fixed joints with <mimic>
            followers[joint.get("name", "")] = _followed(joint, mimic, names, path)
    return RobotXml(root.get("name", ""), sha256, tuple(bodies), followers)


def _require_tree(joints: list[Element], path: Path) -> None:
    """Refuse links whose parents form a circle, because parsers would drop all of their joints."""
    above = {_link_of(joint, "child"): _link_of(joint, "parent") for joint in joints}
    for first in above:
        seen, link = [first], above[first]
        while link in above and link not in seen:
            seen.append(link)
            link = above[link]
        if link == first and link is not None:
            raise RobotError(
                f"{path}: the links {', '.join(shortened(str(one)) for one in reversed(seen))} hang on one another in "
                "a circle: a URDF is a tree; hang the first of them on the base, and state a closed chain under loops "
                "in robot.yaml."
            )


def _fixed_links(root: Element, joints: list[Element]) -> set[str | None]:
    """Roots of the tree, and the links that only fixed joints connect to them."""
    ends = [(_link_of(joint, "parent"), _link_of(joint, "child"), joint.get("type") == "fixed") for joint in joints]
    children = {child for _, child, _ in ends}
    found = {link.get("name") for link in root.findall("link")} - children
    for _ in ends:
        more = {child for parent, child, fixed in ends if fixed and parent in found} - found
        if not more:
            break
        found |= more
    return found


def _link_of(joint: Element, end: str) -> str | None:
    element = joint.find(end)
    return None if element is None else element.get("link")


def _check_urdf_joint(joint: Element, path: Path) -> None:
    owner, kind = f"joint {joint.get('name')}", joint.get("type", "")
    if kind not in _JOINT_TYPES:
        raise RobotError(
            f"{path}: {owner} is of the type {shortened(kind)!r}, which URDF does not have: write one of "
            f"{', '.join(_JOINT_TYPES)}; a ball joint is three revolute joints in a row, or fixed where it is held."
        )
    require_once(joint, _ONCE_IN_JOINT, owner, path)
    for tag, attributes, count in (("origin", ("xyz", "rpy"), 3), ("mimic", ("multiplier", "offset"), 1)):
        for element in joint.findall(tag):
            for attribute in attributes:
                numbers(element, attribute, owner, path, count=count)
    for element in joint.findall("dynamics"):
        require_not_negative(element, ("damping", "friction"), owner, path, count=1)
    axis = joint.find("axis")
    if axis is not None:
        along = numbers(axis, "xyz", owner, path, count=3) or [1.0]
        if kind not in ("fixed", "floating") and float(np.linalg.norm(along)) < _SHORTEST_AXIS:
            raise RobotError(f"{path}: the axis of {owner} is zero: give its direction.")
    limit = joint.find("limit")
    if limit is not None:
        # Some files state the largest float for a joint without a limit.
        ends = [numbers(limit, end, owner, path, count=1, most=np.inf) or [0.0] for end in ("lower", "upper")]
        for attribute in ("effort", "velocity"):
            given = numbers(limit, attribute, owner, path, count=1, most=np.inf)
            if given and given[0] < 0:
                raise RobotError(f"{path}: {attribute}={given[0]:g} in <limit> of {owner} is below zero: correct it.")
        if kind in ("revolute", "prismatic"):
            require_order(ends[0][0], ends[1][0], "<limit>", owner, path)


def _followed(joint: Element, mimic: Element, names: list[str], path: Path) -> Follower:
    """How a joint follows the joint that it mimics."""
    name, leader = joint.get("name", ""), mimic.get("joint", "")
    if leader not in names:
        raise RobotError(
            f"{path}: joint {shortened(name)} mimics {shortened(leader)!r}, {known_names(leader, names, 'joints')}"
        )
    if leader == name:
        raise RobotError(f"{path}: joint {shortened(name)} mimics itself: name the joint that it follows.")
    offset = numbers(mimic, "offset", f"joint {name}", path) or [0.0]
    factor = numbers(mimic, "multiplier", f"joint {name}", path) or [1.0]
    return Follower(leader, factor[0], offset[0])


def _urdf_body(link: Element, path: Path, *, moves: bool) -> Body:
    name = link.get("name", "")
    owner = f"link {name}"
    inertial = link.find("inertial")
    assert inertial is not None
    require_once(inertial, ("origin", "mass", "inertia"), f"the <inertial> of {owner}", path)
    for element in inertial.findall("origin"):
        for attribute in ("xyz", "rpy"):
            numbers(element, attribute, owner, path, count=3)
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or mass.get("value") is None:
        raise RobotError(f"{path}: the <inertial> of {owner} has no mass: give <mass value=.../> or leave it out.")
    if inertia is None:
        raise RobotError(f"{path}: the <inertial> of {owner} has no <inertia>: give its six entries.")
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    missing = [entry for entry in names if inertia.get(entry) is None]
    if missing:
        raise RobotError(f"{path}: the <inertia> of {owner} lacks {', '.join(missing)}: give all six entries.")
    entries = [numbers(inertia, entry, owner, path, count=1)[0] for entry in names]
    return Body(owner, numbers(mass, "value", owner, path, count=1)[0], symmetric(*entries), moves)
