# pyright: reportAttributeAccessIssue=false
"""Builds the URDF of a corrected model: links, friction, torque limits, encoder zeros, and a tilted base.

The module also writes joint placements that were corrected by measured poses into URDF and MJCF files.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from identification.diagnosis.columns.known_geometry import composed_twists, known_twists
from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_mjcf import zeros_in_file
from identification.export.corrected.corrected_model import CorrectedModel, with_base_turned, with_zeros_moved
from identification.export.file_names import MJCF, URDF
from identification.export.headers import root_start
from identification.export.model_files.urdf_file import (
    attribute_text,
    child_of,
    comment_parser,
    edited_urdf,
    new_urdf,
    placement,
)
from identification.geometry.pins import joints_of_loop, loops_of
from identification.geometry.terms import BASE_POSE, ELASTIC, LINK, PARTS, TOOL_POSE, ZERO
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_xml import Element

if TYPE_CHECKING:
    from identification.geometry.result import GeometryResult

LEVEL = "level"
"""Name of the level link that is added as the parent of a tilted robot's root."""


def corrected_urdf(corrected: CorrectedModel, file: Path, folder: Path) -> str:
    """The text of a URDF. If the given file is a URDF, all elements without a finding are unchanged.

    Args:
        corrected: The corrected model.
        file: The robot's file.
        folder: Folder of the new file, to which file names of meshes are made relative.

    Raises:
        RobotError: If the file has no link on a joint of the robot.
        ParameterError: If the inertia of a link is that of no possible body.
    """
    robot = with_rotors_of(corrected.robot, corrected.given)
    text = edited_urdf(robot, corrected.given, file, folder) if file.suffix == ".urdf" else new_urdf(robot)
    head = text[: root_start(text)]
    root = ElementTree.fromstring(text[len(head) :], comment_parser())
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for name, limit in corrected.limits.items():
        if limit != corrected.given.actuators[corrected.given.joint_names.index(name)].torque_limit:
            _set_effort(joints[name], limit)
    for name, zero in zeros_in_file(corrected).items():
        move_zero(joints[name], zero)
    if not np.array_equal(corrected.turned, np.eye(3)):
        _tilt(root, corrected.turned.T)
    ElementTree.indent(root)
    return f"{head}{ElementTree.tostring(root, encoding='unicode')}\n"


def robot_of_urdf(corrected: CorrectedModel) -> Robot:
    """The robot that the URDF describes: given gravity and rotors, and corrected zeros and tilt of the base."""
    robot = with_gravity(with_rotors_of(corrected.robot, corrected.given), corrected.given.model.gravity.linear)
    return with_base_turned(with_zeros_moved(robot, zeros_in_file(corrected)), corrected.turned.T)


def with_rotors_of(robot: Robot, other: Robot) -> Robot:
    """A robot with the rotor inertias of another one, because a URDF cannot state changed rotor inertias."""
    model = robot.model.copy()
    model.armature = other.model.armature
    return replace(robot, model=model)


def _set_effort(joint: Element, limit: float) -> None:
    """Set the torque limit of a joint; a new <limit> gets a speed limit that is never reached."""
    if joint.find("limit") is None:
        ElementTree.SubElement(joint, "limit", velocity="1e3")
    child_of(joint, "limit").set("effort", repr(limit))


def move_zero(joint: Element, zero: float) -> None:
    """Rotate or shift a joint's origin by minus the offset of its encoder, and shift its limits by the offset."""
    origin = child_of(joint, "origin")
    stated = joint.find("axis")
    axis = _numbers(None if stated is None else stated.get("xyz"), "1 0 0")
    axis = axis / np.linalg.norm(axis)
    place = placement(origin)
    if joint.get("type") == "prismatic":
        origin.set("xyz", attribute_text(place.translation - place.rotation @ axis * zero))
    else:
        turn = place.rotation @ pin.AngleAxis(-zero, axis).matrix()
        origin.set("rpy", attribute_text(pin.rpy.matrixToRpy(turn)))
    limit = joint.find("limit")
    if limit is not None and joint.get("type") != "continuous":
        for key in ("lower", "upper"):
            limit.set(key, repr(float(limit.get(key, "0")) + zero))


def _tilt(root: Element, rotation: Float[Array, "3 3"]) -> None:
    """Add a level link as the parent of the robot's root, with the given rotation between both."""
    links = [str(link.get("name")) for link in root.findall("link")]
    children = {str(child.get("link")) for joint in root.findall("joint") for child in joint.findall("child")}
    base = next(name for name in links if name not in children)
    level = next(name for name in (LEVEL, *(f"{LEVEL}_{k}" for k in range(len(links)))) if name not in links)
    joint = ElementTree.Element("joint", name=f"{level}_base", type="fixed")
    ElementTree.SubElement(joint, "parent", link=level)
    ElementTree.SubElement(joint, "child", link=base)
    ElementTree.SubElement(joint, "origin", xyz="0 0 0", rpy=attribute_text(pin.rpy.matrixToRpy(np.array(rotation))))
    root.insert(0, ElementTree.Element("link", name=level))
    root.insert(1, joint)


def _numbers(text: str | None, default: str) -> Float[Array, " k"]:
    return np.array([float(x) for x in (text or default).split()])


_OTHER_TURNS = ("euler", "axisangle", "xyaxes", "zaxis")
"""Attributes of MJCF elements that state a rotation, other than ``quat``."""


@dataclass(frozen=True)
class JointCorrection:
    """Correction of a joint.

    Attributes:
        twist: Error of the joint's placement; the true placement is ``placement @ exp(twist)``.
        zero: Offset of the joint's encoder [rad or m].
    """

    twist: Float[Array, " 6"]
    zero: float = 0.0


def joint_corrections(
    found: GeometryResult | None, known_zeros: Collection[str], known: tuple[KnownEffect, ...] = ()
) -> dict[str, JointCorrection]:
    """Corrections of the joints, by name, from known effects and from findings.

    Args:
        found: Findings of measured poses; None without poses.
        known_zeros: Joints whose zeros were found from the torques: the corrected model already contains them.
        known: Known effects, whose corrections are applied before those of the findings.
    """
    out = {joint: JointCorrection(twist) for joint, twist in known_twists(known).items()}
    for finding in () if found is None else found.findings:
        if finding.joint is None or finding.effect not in (LINK, ZERO):
            continue
        correction = out.get(finding.joint, JointCorrection(np.zeros(6)))
        if finding.effect == LINK:
            twist = np.array([finding.parameters[x].value if x in finding.parameters else 0.0 for x in PARTS])
            out[finding.joint] = JointCorrection(composed_twists(correction.twist, twist), correction.zero)
        elif finding.effect == ZERO and finding.joint not in known_zeros:
            out[finding.joint] = JointCorrection(correction.twist, finding.parameters["offset"].value)
    return out


@dataclass(frozen=True)
class FileCorrections:
    """Corrections that each model file can contain, and notes on those that it cannot."""

    urdf: Mapping[str, JointCorrection]
    mjcf: Mapping[str, JointCorrection]
    notes: tuple[Note, ...] = ()


def corrections_in_files(robot: Robot, corrections: Mapping[str, JointCorrection]) -> FileCorrections:
    """Corrections that model files can contain: for an open chain all, for a closed chain those that keep its loops.

    - A joint that follows others by a formula is also rotated by their zeros: the formula then holds for readings.
    - Links of a parallelogram that is stated by a formula are not moved: the formula would not hold for moved links.
    - In the MJCF of a robot with loops between frames nothing is moved: MuJoCo computes how the loops close from the
      zero positions in the file.

    Args:
        robot: The given model.
        corrections: Corrections by joint, or by frame of a loop's pin.
    """
    loops = loops_of(robot)
    if loops is None or robot.chain is None or not corrections:
        return FileCorrections(corrections, corrections)
    # The anchors after those of the robot's chain are of parallelograms, which the robot states by a formula.
    by_formula: set[str] = set()
    for anchor in loops.chain.anchors[len(robot.chain.anchors) :]:
        by_formula |= {loops.model.names[index] for index in joints_of_loop(loops.model, anchor)}
        by_formula |= {loops.model.frames[frame].name for frame in (anchor.frame_a, anchor.frame_b)}
    possible = {
        name: JointCorrection(np.zeros(6), own.zero) if name in by_formula else own for name, own in corrections.items()
    }
    zeros = np.array([corrections[name].zero if name in corrections else 0.0 for name in robot.joint_names])
    for row, name in zip(robot.chain.passive, robot.passive_names, strict=True):
        zero = float(robot.chain.linear_map[row, : robot.nv] @ zeros)
        if zero and row not in robot.chain.unknowns:
            possible[name] = JointCorrection(possible[name].twist if name in possible else np.zeros(6), zero)
    notes = []
    lost = [name for name, own in corrections.items() if name in by_formula and np.any(own.twist)]
    if lost:
        notes.append(Note(Code.NO_PLACE_FOR_LINKS, None, {"files": (URDF, MJCF), "names": tuple(lost)}))
    if robot.chain.anchors:
        notes.append(Note(Code.LOOPS_AS_DRAWN, None, {"files": (MJCF,)}))
    return FileCorrections(possible, {} if robot.chain.anchors else possible, tuple(notes))


def not_in_files(found: GeometryResult | None, known: tuple[KnownEffect, ...] = ()) -> tuple[Note, ...]:
    """Notes on the findings of elasticity and of poses of base and target, which URDF and MJCF cannot express.

    Args:
        found: Findings of measured poses; None without poses.
        known: Effects that the given model already contains.
    """
    places = [(one.effect, one.joint) for one in (*known, *(() if found is None else found.findings))]
    out = []
    for quantity, wanted in (("elasticity", ELASTIC), ("base", BASE_POSE), ("tool", TOOL_POSE)):
        joints = dict.fromkeys(joint for effect, joint in places if effect == wanted)
        if joints:
            names = tuple(joint for joint in joints if joint is not None)  # the pose of the base has no joint
            numbers = {"files": (URDF, MJCF), "quantity": quantity, "names": names}
            out.append(Note(Code.NO_PLACE_FOR_POSES, None, numbers))
    return tuple(out)


def urdf_with_corrected_joints(text: str, corrections: Mapping[str, JointCorrection]) -> tuple[str, tuple[str, ...]]:
    """The text of a URDF with corrected joints, and the names of corrections for which it has no joint.

    Args:
        text: Text of the file.
        corrections: Corrections by joint, or by link on a fixed joint at which a loop closes.
    """
    not_applied = set(corrections)

    def move(root: Element) -> None:
        for joint in root.findall("joint"):
            child = joint.find("child")
            names = [str(joint.get("name"))]
            if joint.get("type") == "fixed" and child is not None:
                names.append(str(child.get("link")))
            name = next((name for name in names if name in corrections), None)
            if name is None:
                continue
            own = corrections[name]
            not_applied.discard(name)
            origin = child_of(joint, "origin")
            place = placement(origin) * pin.exp6(own.twist)
            origin.set("xyz", attribute_text(place.translation))
            origin.set("rpy", attribute_text(pin.rpy.matrixToRpy(place.rotation)))
            if own.zero:
                move_zero(joint, own.zero)

    return _edited(text, move), tuple(name for name in corrections if name in not_applied)


def mjcf_with_corrected_joints(text: str, corrections: Mapping[str, JointCorrection]) -> tuple[str, tuple[str, ...]]:
    """The text of an MJCF with corrected bodies, and the names of corrections that were not applied.

    Only bodies with a placement by ``pos`` and ``quat``, and with a single joint at their origin, are moved. They are
    also rotated by the zeros of their joints, so that positions in the file are encoder readings.

    Args:
        text: Text of the file.
        corrections: Corrections by joint.
    """
    not_applied: list[str] = []

    def move(root: Element) -> None:
        owners = {child: owner for owner in root.iter("body") for child in owner.findall("joint")}
        named = {str(joint.get("name")): joint for joint in owners}
        for name, own in corrections.items():
            joint = named.get(name)
            body = None if joint is None else owners[joint]
            if joint is None or body is None or not _is_simple(joint, body):
                not_applied.append(name)
                continue
            quat = _numbers(body.get("quat"), "1 0 0 0")
            turn = pin.Quaternion(quat[0], *quat[1:]).normalized().toRotationMatrix()
            place = pin.SE3(turn, _numbers(body.get("pos"), "0 0 0")) * pin.exp6(own.twist)
            place = place * _displacement_to_zero(joint, own.zero)
            body.set("pos", attribute_text(place.translation))
            x, y, z, w = pin.Quaternion(place.rotation).coeffs()
            body.set("quat", attribute_text([w, x, y, z]))

    return _edited(text, move), tuple(not_applied)


def _is_simple(joint: Element, body: Element) -> bool:
    """True if a body can be moved: placed by ``pos`` and ``quat``, with a single joint at its origin."""
    return (
        len(body.findall("joint")) == 1
        and not np.any(_numbers(joint.get("pos"), "0 0 0"))
        and joint.get("axis") is not None
        and not any(body.get(name) for name in _OTHER_TURNS)
    )


def _displacement_to_zero(joint: Element, zero: float) -> pin.SE3:
    """The displacement of a joint from position zero to the position at which its encoder reads zero (``-zero``)."""
    axis = _numbers(joint.get("axis"), "0 0 1")
    axis = axis / np.linalg.norm(axis)
    if joint.get("type") == "slide":
        return pin.SE3(np.eye(3), -zero * axis)
    return pin.SE3(pin.AngleAxis(-zero, axis).matrix(), np.zeros(3))


def _edited(text: str, edit: Callable[[Element], None]) -> str:
    """The text of an XML file after an edit of its root element; the text before the root is kept."""
    at = root_start(text)
    root = ElementTree.fromstring(text[at:], comment_parser())
    edit(root)
    return f"{text[:at]}{ElementTree.tostring(root, encoding='unicode')}\n"
