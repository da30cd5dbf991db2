# pyright: reportAttributeAccessIssue=false
"""A corrected model as URDF: links, friction, torque limits, zeros of encoders, and a base that is not level."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from identification.export.corrected.corrected_mjcf import zeros_in_file
from identification.export.corrected.corrected_model import CorrectedModel, with_base_turned, with_zeros_moved
from identification.export.headers import root_of
from identification.export.model_files.urdf_file import attribute_text, edited_urdf, new_urdf
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_xml import Element

LEVEL = "level"
"""Link on which a tilted robot stands."""


def corrected_urdf(corrected: CorrectedModel, file: Path, folder: Path) -> str:
    """The text of a URDF; if the given file is one, everything without a finding is unchanged.

    Args:
        corrected: The corrected model.
        file: The robot's file.
        folder: Folder of the new file, to which file names of meshes are made relative.

    Raises:
        RobotError: If the file has no link on a joint of the robot.
        ParameterError: If the inertia of a link is that of no possible body.
    """
    robot = _without_rotors(corrected)
    text = edited_urdf(robot, corrected.given, file, folder) if file.suffix == ".urdf" else new_urdf(robot)
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    head = text[: root_of(text)]
    root = ElementTree.fromstring(text[len(head) :], parser)
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
    """The robot that the URDF describes: gravity and rotors as given, zeros and base moved."""
    robot = with_gravity(_without_rotors(corrected), corrected.given.model.gravity.linear)
    return with_base_turned(with_zeros_moved(robot, zeros_in_file(corrected)), corrected.turned.T)


def _without_rotors(corrected: CorrectedModel) -> Robot:
    """The robot with the given rotors, as a URDF has none."""
    model = corrected.robot.model.copy()
    model.armature = corrected.given.model.armature
    return replace(corrected.robot, model=model)


def _set_effort(joint: Element, limit: float) -> None:
    element = joint.find("limit")
    if element is None:
        element = ElementTree.SubElement(joint, "limit", velocity="1e3")
    element.set("effort", repr(limit))


def move_zero(joint: Element, zero: float) -> None:
    """Turn or shift the joint's origin back by the offset of its encoder, and shift its limits by that."""
    origin = joint.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(joint, "origin")
    stated = joint.find("axis")
    axis = _numbers(None if stated is None else stated.get("xyz"), "1 0 0")
    axis = axis / np.linalg.norm(axis)
    turn = pin.rpy.rpyToMatrix(_numbers(origin.get("rpy"), "0 0 0"))
    if joint.get("type") == "prismatic":
        origin.set("xyz", attribute_text(_numbers(origin.get("xyz"), "0 0 0") - turn @ axis * zero))
    else:
        turn = turn @ pin.AngleAxis(-zero, axis).matrix()
        origin.set("rpy", attribute_text(pin.rpy.matrixToRpy(turn)))
    limit = joint.find("limit")
    if limit is not None and joint.get("type") != "continuous":
        for key in ("lower", "upper"):
            limit.set(key, repr(float(limit.get(key, "0")) + zero))


def _tilt(root: Element, rotation: Float[Array, "3 3"]) -> None:
    """Add a level link as parent of the robot's root, which is rotated on it."""
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


def _numbers(text: str | None, default: str) -> Float[Array, " 3"]:
    return np.array([float(x) for x in (text or default).split()])
