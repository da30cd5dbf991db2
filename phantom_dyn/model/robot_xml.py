"""Facts that are read from a robot file itself, because Pinocchio drops them or passes over them in silence."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from phantom_dyn.errors import RobotError

Array = np.ndarray
Element = ElementTree.Element


@dataclass(frozen=True)
class Body:
    """Link as the file states it: mass [kg] and inertia about its centre of mass [kg m^2]."""

    name: str
    mass: float
    central_inertia: Float[Array, "3 3"]


@dataclass(frozen=True)
class MjcfLoop:
    """One equality that keeps two bodies or sites together.

    Attributes:
        label: For messages, such as ``<connect> of coupler and rocker``.
        kind: ``point``, or ``frame`` for a weld that holds rotation too.
        frame_a, frame_b: Names of bodies or sites; ``universe`` is the world.
        anchor: Point of the loop [m] in the axes of one of the bodies.
        relative: Pose of the second body in the first where the file states it: position [m], quaternion w x y z.
        anchor_on_first: Whether the anchor is in the first body's axes.
        on_sites: True if the frames are those of sites, which coincide.
    """

    label: str
    kind: Literal["point", "frame"]
    frame_a: str
    frame_b: str
    anchor: tuple[float, ...]
    relative: tuple[float, ...] | None
    anchor_on_first: bool
    on_sites: bool


@dataclass(frozen=True)
class RobotXml:
    """Facts of a robot file.

    Attributes:
        kind: Format, from the root element.
        name: The robot's, empty where the file has none.
        sha256: Of the file.
        bodies: Links with an inertia.
        followers: Joints that copy another one: the other's name and the position where that one is at zero.
        gravity: [m/s^2] where the file states it.
        warnings: Sentences on what will be left out.
        loops: Closed chains that the file states.
        driven: Joints that an actuator of the file acts on.
    """

    kind: Literal["urdf", "mjcf"]
    name: str
    sha256: str
    bodies: tuple[Body, ...]
    followers: dict[str, tuple[str, float]] = field(default_factory=dict)
    gravity: tuple[float, float, float] | None = None
    warnings: tuple[str, ...] = ()
    loops: tuple[MjcfLoop, ...] = ()
    driven: frozenset[str] = frozenset()


def read_root(path: Path) -> tuple[Element, str]:
    """Root element of a robot file, and the file's SHA-256.

    Raises:
        RobotError: If the file cannot be read, is no XML, or describes no robot in URDF or MJCF.
    """
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise RobotError(f"{path} cannot be read ({problem.strerror}): give a URDF or MJCF file.") from problem
    if not content.strip():
        raise RobotError(f"{path} is empty: give a URDF or MJCF file.")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as problem:
        raise RobotError(f"{path} is not valid XML, or is cut off ({problem}): give a whole URDF or MJCF file.") from (
            problem
        )
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise RobotError(f"{path} is a xacro source: expand it with `xacro FILE > robot.urdf` and give the result.")
    if root.tag == "sdf":
        raise RobotError(
            f"{path} is an SDF file, and Pinocchio's wheel is built without SDF: convert it to URDF or MJCF."
        )
    if root.tag not in ("robot", "mujoco"):
        raise RobotError(f"{path} has the root element <{root.tag}>, wanted <robot> (URDF) or <mujoco> (MJCF).")
    return root, hashlib.sha256(content).hexdigest()


def numbers(element: Element, attribute: str, owner: str, path: Path) -> list[float]:
    """Finite numbers of an attribute, empty where it is not there.

    Both parsers take text for zero without a word, so numbers are checked here.

    Raises:
        RobotError: If one of them is no finite number.
    """
    text = element.get(attribute)
    if text is None:
        return []
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if not values or not np.isfinite(values).all():
        raise RobotError(f"{path}: {attribute}={text!r} in <{element.tag}> of {owner} must be finite numbers.")
    return values


def require_not_negative(element: Element, attributes: tuple[str, ...], owner: str, path: Path) -> None:
    """Refuse a negative number among the attributes of an element, with a sentence."""
    for attribute in attributes:
        if any(value < 0 for value in numbers(element, attribute, owner, path)):
            text = f"{attribute}={element.get(attribute)!r} in <{element.tag}> of {owner}"
            raise RobotError(f"{path}: {text} is below zero, which no robot can have: correct it.")


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Float[Array, "3 3"]:
    """Symmetric matrix from its six entries."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def urdf_facts(root: Element, sha256: str, path: Path) -> RobotXml:
    """Facts of a URDF.

    Raises:
        RobotError: If a number is none, an axis is zero, or friction is negative.
    """
    bodies = [_urdf_body(link, path) for link in root.findall("link") if link.find("inertial") is not None]
    followers = {}
    for joint in root.findall("joint"):
        owner = f"joint {joint.get('name')}"
        for tag, attributes in (("origin", ("xyz", "rpy")), ("axis", ("xyz",)), ("mimic", ("multiplier", "offset"))):
            for element in joint.findall(tag):
                for attribute in attributes:
                    numbers(element, attribute, owner, path)
        for element in joint.findall("dynamics"):
            require_not_negative(element, ("damping", "friction"), owner, path)
        axis = joint.find("axis")
        fixed = axis is None or joint.get("type") in ("fixed", "floating")
        if axis is not None and not fixed and not any(numbers(axis, "xyz", owner, path) or [1.0]):
            raise RobotError(f"{path}: the axis of {owner} is zero: give its direction.")
        mimic = joint.find("mimic")
        if mimic is not None:
            offset = numbers(mimic, "offset", owner, path) or [0.0]
            followers[joint.get("name", "")] = (mimic.get("joint", ""), offset[0])
    return RobotXml("urdf", root.get("name", ""), sha256, tuple(bodies), followers)


def _urdf_body(link: Element, path: Path) -> Body:
    name = link.get("name", "")
    owner = f"link {name}"
    inertial = link.find("inertial")
    assert inertial is not None
    for element in inertial.findall("origin"):
        for attribute in ("xyz", "rpy"):
            numbers(element, attribute, owner, path)
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or mass.get("value") is None:
        raise RobotError(f"{path}: the <inertial> of {owner} has no mass: give <mass value=.../> or leave it out.")
    if inertia is None:
        raise RobotError(f"{path}: the <inertial> of {owner} has no <inertia>: give its six entries.")
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    missing = [entry for entry in names if inertia.get(entry) is None]
    if missing:
        raise RobotError(f"{path}: the <inertia> of {owner} lacks {', '.join(missing)}: give all six entries.")
    entries = [numbers(inertia, entry, owner, path)[0] for entry in names]
    return Body(owner, numbers(mass, "value", owner, path)[0], symmetric(*entries))
