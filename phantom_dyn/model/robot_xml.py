"""Reads and checks parts of the XML of a robot file that Pinocchio ignores without a message."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import RobotError, printable, shortened
from phantom_dyn.model.files.plain_file import require_plain_file

Element = ElementTree.Element

LARGEST = 1e9
"""Largest allowed number: no quantity of a robot in SI units is larger, and its square does not overflow."""
# Largest number of characters of a name: names are printed in sentences, tables and figures.
_LONGEST_NAME = 200
# Deepest allowed nesting of elements, because the parsers recurse.
_DEEPEST = 200
# Attributes that must be finite; ranges of MJCF may be infinite.
_PHYSICAL = frozenset(
    "xyz rpy pos quat euler axis axisangle xyaxes zaxis fromto value mass ixx iyy izz ixy ixz iyz inertia diaginertia "
    "fullinertia armature damping friction frictionloss lower upper effort velocity".split()
)
_NOT_FINITE = re.compile(r"[-+]?(nan|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True)
class Body:
    """Link as the file states it: mass [kg], inertia about its mass centre [kg m^2], and whether a joint moves it."""

    name: str
    mass: float
    central_inertia: Float[Array, "3 3"]
    moves: bool = True


@dataclass(frozen=True)
class MjcfLoop:
    """An equality of an MJCF file that keeps two bodies or sites together.

    Attributes:
        label: For messages, such as ``<connect> of coupler and rocker``.
        kind: ``point``, or ``frame`` for a weld that holds rotation too.
        frame_a, frame_b: Names of bodies or sites; ``universe`` is the world.
        in_a, in_b: Pose of the common point or frame in each of these frames: position [m], quaternion w x y z.
    """

    label: str
    kind: Literal["point", "frame"]
    frame_a: str
    frame_b: str
    in_a: tuple[float, ...]
    in_b: tuple[float, ...]


@dataclass(frozen=True)
class Follower:
    """A joint that follows another: ``q = offset + factor q_leader``; without a leader it stays at its offset."""

    leader: str | None
    factor: float
    offset: float


@dataclass(frozen=True)
class Drive:
    """Properties of a joint's drive, on the joint side of the gear; None where the file does not state them.

    ``reference_lag`` is the time constant [s] of a first-order filter of the reference.
    """

    kp: float | None = None
    kd: float | None = None
    torque_limit: float | None = None
    gear_ratio: float | None = None
    reference_lag: float = 0.0


@dataclass(frozen=True)
class SoftFriction:
    """Dry friction of MuJoCo, a soft constraint: ``clip(gain * M0 * (a + v / time), -T, T)`` against the motion.

    ``M0`` is one over the diagonal entry of the joint in the inverse of the mass matrix, with all positions at zero.

    Attributes:
        time: Time [s] by which the friction changes sign before the velocity does.
        gain: Share of the motion that the constraint removes, divided by the share that remains.
        beyond_model: Known Coulomb torque of the joint in addition to the modelled one [N m or N].
    """

    time: float
    gain: float
    beyond_model: float = 0.0


@dataclass(frozen=True)
class RobotXml:
    """What the XML of a robot file states.

    Attributes:
        name: Name of the robot, empty where the file has none.
        sha256: SHA-256 of the file.
        bodies: Links with an inertia.
        followers: Joints that follow another joint.
        gravity: Gravity [m/s^2], or None if the file does not state it.
        warnings: Sentences about parts of the file that are ignored.
        loops: Closed chains that the file states.
        driven: Joints that an actuator of the file acts on.
        soft_friction: Dry friction of each joint in the file's simulator; empty for a URDF.
        drives: Drive of each joint with an actuator.
        base_joints: Joints between the world and a body that has several joints.
        play: For each joint that models the play of another joint of its body: this other joint, and the width of the
            play [rad or m].
        unmodelled: Joints on which forces may act that the file states and the model leaves out.
    """

    name: str
    sha256: str
    bodies: tuple[Body, ...]
    followers: dict[str, Follower] = field(default_factory=dict)
    gravity: tuple[float, float, float] | None = None
    warnings: tuple[str, ...] = ()
    loops: tuple[MjcfLoop, ...] = ()
    driven: frozenset[str] = frozenset()
    soft_friction: dict[str, SoftFriction] = field(default_factory=dict)
    drives: dict[str, Drive] = field(default_factory=dict)
    play: dict[str, tuple[str, float]] = field(default_factory=dict)
    base_joints: frozenset[str] = frozenset()
    unmodelled: frozenset[str] = frozenset()


def read_root(path: Path) -> tuple[Element, str]:
    """Read the root element of a robot file, and compute the file's SHA-256.

    Raises:
        RobotError: If the file cannot be read, is not XML, or is neither URDF nor MJCF.
    """
    require_plain_file(path, RobotError, "a URDF or MJCF file")
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise RobotError(f"{path} cannot be read ({problem.strerror}): give a URDF or MJCF file.") from problem
    if not content.strip():
        raise RobotError(f"{path} is empty: give a URDF or MJCF file.")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as problem:
        if path.suffix in (".yaml", ".yml"):
            wanted = "give the robot's URDF or MJCF file; a robot.yaml in the same folder is read with it"
            raise RobotError(f"{path} is a YAML file: {wanted}.") from problem
        raise RobotError(f"{path} is not valid XML, or is cut off ({problem}): give a whole URDF or MJCF file.") from (
            problem
        )
    if b"<!ENTITY" in content:
        raise RobotError(f"{path} defines entities, which no robot file needs: write out what they stand for.")
    if _depth(root) > _DEEPEST:
        raise RobotError(f"{path} has elements nested more than {_DEEPEST} deep: give the file of one robot.")
    # A file that xacro generated still declares its namespace, but has no xacro elements and no ${...}.
    if any("xacro" in str(one.tag) or any("${" in text for text in one.attrib.values()) for one in root.iter()):
        raise RobotError(f"{path} is a xacro source: expand it with `xacro FILE > robot.urdf` and give the result.")
    if root.tag == "sdf":
        raise RobotError(
            f"{path} is an SDF file, and Pinocchio's wheel is built without SDF: convert it to URDF or MJCF."
        )
    if root.tag not in ("robot", "mujoco"):
        raise RobotError(
            f"{path} has the root element <{shortened(root.tag)}>, wanted <robot> (URDF) or <mujoco> (MJCF)."
        )
    return root, hashlib.sha256(content).hexdigest()


def _depth(root: Element) -> int:
    """Depth of the deepest element."""
    depth, row = 0, [root]
    while row:
        depth, row = depth + 1, [child for element in row for child in element]
    return depth


def require_names(elements: Iterable[Element], what: str, path: Path) -> None:
    """Refuse a name that is empty, occurs twice, is too long, or has control characters."""
    seen: set[str] = set()
    for element in elements:
        name = element.get("name")
        if name is None:
            continue
        if not name:
            raise RobotError(f"{path}: a {what} has an empty name: give it one, or leave the attribute out.")
        if printable(name) != name:
            raise RobotError(
                f"{path}: the name {name[:80]!r} of a {what} holds control characters: write it with letters, digits "
                "and _."
            )
        if len(name) > _LONGEST_NAME:
            raise RobotError(
                f"{path}: the name {shortened(name)} of a {what} has {len(name)} letters, wanted at most "
                f"{_LONGEST_NAME}: write a shorter one."
            )
        if name in seen:
            raise RobotError(f"{path}: two {what}s have the name {shortened(name)}: give each its own.")
        seen.add(name)


def numbers(
    element: Element, attribute: str, owner: str, path: Path, *, count: int | None = None, most: float = LARGEST
) -> list[float]:
    """Finite numbers of an attribute; an empty list if it is missing.

    The parsers of URDF and MJCF read invalid numbers as zero without a message, so they are checked here.

    Args:
        element: The element with the attribute.
        attribute: Name of the attribute.
        owner: The link or joint that the element belongs to, for messages.
        path: The file, for messages.
        count: How many numbers it must have; None for one or more.
        most: The largest allowed magnitude.

    Raises:
        RobotError: If a number is not finite or too large, or there are more or fewer than ``count``.
    """
    text = element.get(attribute)
    if text is None:
        return []
    try:
        # Python accepts 1_000 and digits of other scripts, which the parsers of URDF and MJCF do not.
        values = [float(word) for word in text.split()] if text.isascii() and "_" not in text else []
    except ValueError:
        values = []
    where = f"{path}: {attribute}={shortened(text)!r} in <{element.tag}> of {owner}"
    if not values or not np.isfinite(values).all():
        raise RobotError(f"{where} must be finite numbers: correct it.")
    if count is not None and len(values) != count:
        raise RobotError(f"{where} has {len(values)} numbers, wanted {count}: correct it.")
    if max(map(abs, values)) > most:
        raise RobotError(f"{where} is beyond {most:g}, which no robot has: give SI units.")
    return values


def require_finite(root: Element, path: Path) -> None:
    """Refuse poses, inertias and friction that are not finite, also in elements that this project does not use.

    A corrected model is a copy of the file with changes, so it would contain these numbers too.

    Raises:
        RobotError: If a number is NaN or infinite.
    """
    for element in root.iter():
        for attribute in sorted(_PHYSICAL.intersection(element.attrib)):
            if attribute == "value" and element.tag != "mass":
                continue
            text = element.get(attribute, "")
            if any(_NOT_FINITE.fullmatch(word) for word in text.split()):
                raise RobotError(
                    f"{path}: {attribute}={shortened(text)!r} in <{shortened(element.tag)}> must be finite numbers: "
                    "correct it."
                )


def require_once(parent: Element, tags: tuple[str, ...], owner: str, path: Path) -> None:
    """Refuse an element that occurs twice: the parsers would take the first or the last without a message."""
    for tag in tags:
        found = len(parent.findall(tag))
        if found > 1:
            raise RobotError(f"{path}: {owner} has <{tag}> {found} times, wanted one: remove the others.")


def require_order(low: float, high: float, what: str, owner: str, path: Path) -> None:
    """Refuse a lower limit above the upper limit."""
    if low > high:
        raise RobotError(f"{path}: {what} of {owner} goes from {low:g} to {high:g}: turn the two round.")


def require_not_negative(
    element: Element, attributes: tuple[str, ...], owner: str, path: Path, *, count: int | None = None
) -> None:
    """Refuse negative numbers in some attributes of an element."""
    for attribute in attributes:
        if any(value < 0 for value in numbers(element, attribute, owner, path, count=count)):
            text = f"{attribute}={shortened(element.get(attribute, ''))!r} in <{element.tag}> of {owner}"
            raise RobotError(f"{path}: {text} is below zero, which no robot can have: correct it.")


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Float[Array, "3 3"]:
    """Symmetric matrix from its six entries."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
