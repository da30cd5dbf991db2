# pyright: reportAttributeAccessIssue=false
"""Writes the findings into a copy of the given MJCF; all other content, such as shapes and sensors, is unchanged.

Link inertias, damping, dry friction, rotors and gravity are replaced if they differ. Findings on drives are written
into the existing actuators by `identification.export.corrected.given_drives`.
"""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from identification.export.corrected.corrected_mjcf import (
    add_cogging,
    add_couplings,
    compliances_in_mjcf,
    rotor_of,
    second_joint,
    zeros_in_file,
)
from identification.export.corrected.corrected_model import CorrectedModel
from identification.export.corrected.given_drives import set_drives
from identification.export.corrected.mjcf_defaults import GivenMjcf, given_mjcf
from identification.export.model_files.mjcf_file import add_followers, inertial_of
from identification.export.model_files.tree import LinkInertia
from identification.export.model_files.urdf_file import (
    attribute_text,
    child_of,
    comment_parser,
    own_inertia,
    set_inertial,
)
from identification.notes import Note
from phantom_dyn.dynamics.tree_motion import tree_friction
from phantom_dyn.errors import RobotError
from phantom_dyn.model.from_mjcf.mjcf_compiler import whole_mjcf
from phantom_dyn.model.inertia import body_name, breaks_triangle
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_xml import Element

_REWRITES = ("settotalmass", "boundmass", "boundinertia", "balanceinertia", "inertiafromgeom")
"""Attributes of <compiler> with which MuJoCo changes the inertias of the file."""
_EXPANDED = ("include", "frame", "replicate", "attach")
"""Elements that MuJoCo expands into other elements."""
_NEED_NAME = ("body", "joint", "freejoint")
"""Elements that need a name, by which they are found."""
_WIDTHS = {"free": (7, 6), "ball": (4, 3)}
"""Numbers of positions and of velocities of joint types with more than one."""
_FOLDERS = ("meshdir", "texturedir")
"""Attributes of <compiler> that state folders."""
_SAME = 1e-12
"""Relative difference up to which two numbers count as equal: numbers in files are rounded."""


def edited_mjcf(corrected: CorrectedModel, file: Path, folder: Path | None) -> tuple[str, dict[str, Note]]:
    """The text of the given MJCF with the findings, and notes by joint on numbers that its actuator cannot express.

    Args:
        corrected: The corrected model.
        file: The given MJCF.
        folder: Folder of the new file, to which paths of meshes are made relative; None for absolute paths.

    Raises:
        RobotError: If settings of the file would change the meaning of the findings.
        ParameterError: If no possible body has the inertia of a link.
    """
    given = given_mjcf(_whole_root(file))
    _require_plain(given, corrected, file)
    _set_inertias(given, corrected, file)
    _set_joints(given, corrected)
    gravity = corrected.robot.model.gravity.linear
    if not np.array_equal(gravity, _gravity(given.root)):
        _last_of(given.root, "option").set("gravity", attribute_text(gravity))
    _set_springs(given, corrected)
    for name, zero in zeros_in_file(corrected).items():
        _move_zero(given, name, zero)
    for name in (*corrected.plays, *compliances_in_mjcf(corrected)):
        _add_joint(given, corrected, name)
    left_out = set_drives(given, corrected)
    add_cogging(given.root, corrected)
    # Keyframes need a command for each added actuator.
    added = sum(len(waves) for waves in corrected.cogging.values())
    for key in _keyframes_with(given, "ctrl"):
        key.set("ctrl", str(key.get("ctrl")) + " 0" * added)
    add_couplings(given.root, corrected)
    if given.root.find(".//equality") is None:
        add_followers(given.root, corrected.robot)
    _relocate(given.root, file.resolve().parent, folder)
    ElementTree.indent(given.root)
    return ElementTree.tostring(given.root, encoding="unicode") + "\n", left_out


def _whole_root(file: Path) -> Element:
    """Root element with comments; if the file has includes, copies or unnamed elements, as expanded by MuJoCo."""
    root = ElementTree.parse(file, comment_parser()).getroot()
    elements = [element for element in root.iter() if isinstance(element.tag, str)]
    named = [element for world in root.iter("worldbody") for element in world.iter() if element.tag in _NEED_NAME]
    if any(element.tag in _EXPANDED for element in elements) or any(element.get("name") is None for element in named):
        return ElementTree.fromstring(whole_mjcf(file))
    return root


def _require_plain(given: GivenMjcf, corrected: CorrectedModel, file: Path) -> None:
    """Refuse files whose compiler changes inertias, whose joints have no names, or whose loops are in another file."""
    for compiler in given.root.iter("compiler"):
        for word in _REWRITES:
            # The values in the tuple switch a rewrite off. Zeros such as "0" or "0 0" become the empty text.
            if compiler.get(word, "auto").strip(" 0.") not in ("", "auto", "false", "-1"):
                raise RobotError(f"{word} of <compiler> in {file.name} would change the inertias again: remove it.")
    names = list(corrected.given.model.names)[1:]
    unnamed = [name for name in names if name not in given.joints]
    if unnamed:
        raise RobotError(f"{file.name} has a joint without a name ({unnamed[0]}): name it.")
    chain = corrected.given.chain
    # Labels of loops of the MJCF begin with <connect> or <weld>; all other loops are from robot.yaml.
    if chain is not None and any(not anchor.label.startswith("<") for anchor in chain.anchors):
        raise RobotError(f"robot.yaml closes loops of {file.name} between frames: state them as <equality> in it.")


def _set_inertias(given: GivenMjcf, corrected: CorrectedModel, file: Path) -> None:
    """Write the inertias of bodies that the findings changed."""
    robot, before = corrected.robot, corrected.given
    for body in range(1, robot.model.njoints):
        if robot.model.inertias[body] == before.model.inertias[body]:
            continue
        element = given.owners[given.joints[robot.model.names[body]]]
        inertia, losing = own_inertia(robot, body, _fixed_bodies(before, body), _bodies_on_own_joints(element))
        inertia = _in_axes_of_link(robot, body, inertia)
        if breaks_triangle(inertia.inertia):
            raise RobotError(f"MuJoCo takes no body with the inertia of {body_name(robot, body)} in {file.name}.")
        set_inertial(element, inertial_of(inertia))
        for name in losing:
            fixed = next((e for e in element.iter("body") if e.get("name") == name), None)
            if fixed is None:
                raise RobotError(f"{file.name} has no body {name} on {element.get('name')}.")
            set_inertial(fixed, inertial_of(LinkInertia(0.0, np.zeros(3), np.zeros((3, 3)))))


def _fixed_bodies(robot: Robot, body: int) -> dict[str, np.ndarray]:
    """Standard parameters, about the link's joint, of the bodies that are fixed to the link or locked."""
    out: dict[str, np.ndarray] = {}
    frames = list(robot.model.frames)
    for k, frame in enumerate(frames):
        if frame.type == pin.FrameType.FIXED_JOINT and frame.parentJoint == body and frame.inertia.mass > 0:
            behind = frames[k + 1] if k + 1 < len(frames) and frames[k + 1].type == pin.FrameType.BODY else frame
            out[behind.name] = frame.placement.act(frame.inertia).toDynamicParameters()
    return out


def _bodies_on_own_joints(link: Element) -> frozenset[str]:
    """Names of the bodies below a link that a joint of the file moves relative to the link: they keep their inertia."""
    out: set[str] = set()
    todo = [(body, False) for body in link.findall("body")]
    while todo:
        body, moves = todo.pop()
        moves = moves or body.find("joint") is not None
        out |= {str(body.get("name"))} if moves else set()
        todo += [(child, moves) for child in body.findall("body")]
    return frozenset(out)


def _in_axes_of_link(robot: Robot, body: int, inertia: LinkInertia) -> LinkInertia:
    """An inertia, transformed from the frame of a joint to that of its body, which may have another origin."""
    name = body_name(robot, body)
    frame = robot.model.frames[robot.model.getFrameId(name, pin.FrameType.BODY)]
    in_body_axes = frame.placement.actInv(pin.Inertia(inertia.mass, inertia.center, inertia.inertia))
    return LinkInertia(float(in_body_axes.mass), np.array(in_body_axes.lever), np.array(in_body_axes.inertia))


def _set_joints(given: GivenMjcf, corrected: CorrectedModel) -> None:
    """Write damping, dry friction and rotors, if they differ from the file with its defaults."""
    robot = corrected.robot
    viscous, coulomb = tree_friction(robot)
    for k, name in enumerate(list(robot.model.names)[1:]):
        joint = given.joints[name]
        wanted = (("damping", viscous[k]), ("frictionloss", coulomb[k]), ("armature", robot.model.armature[k]))
        for attribute, value in wanted:
            stated = float((given.attribute(joint, attribute) or "0").split()[0])
            if abs(stated - value) > _SAME * abs(value):
                joint.set(attribute, repr(float(value)))


def _set_springs(given: GivenMjcf, corrected: CorrectedModel) -> None:
    """Write the springs that were found on joints."""
    for name, (stiffness, rest) in corrected.springs.items():
        joint = given.joints[name]
        joint.set("stiffness", repr(stiffness))
        joint.set("springref", repr(given.angle(joint, rest)))


def _move_zero(given: GivenMjcf, name: str, zero: float) -> None:
    """Shift a joint's zero, range, spring and keyframes, so that its positions are encoder readings."""
    joint = given.joints[name]
    more = given.angle(joint, zero)
    joint.set("ref", repr(float(given.attribute(joint, "ref") or 0.0) + more))
    for attribute in ("range", "springref"):
        stated = given.attribute(joint, attribute)
        if stated:
            joint.set(attribute, attribute_text([float(x) + more for x in stated.split()]))
    for key in _keyframes_with(given, "qpos"):
        numbers = [float(x) for x in str(key.get("qpos")).split()]
        numbers[_first_index(given, joint, "qpos")] += zero
        key.set("qpos", attribute_text(numbers))


def _add_joint(given: GivenMjcf, corrected: CorrectedModel, name: str) -> None:
    """Add a second joint for backlash or a spring after a joint; it inherits no attributes from default classes."""
    joint = given.joints[name]
    joint.set("armature", repr(rotor_of(corrected, name)))
    own = second_joint(corrected, name)
    if "range" in own:
        own["range"] = attribute_text([given.angle(joint, float(x)) for x in own["range"].split()])
    place = {key: text for key in ("type", "axis", "pos") if (text := given.attribute(joint, key)) is not None}
    zeros = dict.fromkeys(("damping", "frictionloss", "armature", "stiffness", "ref", "springref"), "0")
    element = ElementTree.Element("joint", zeros | own | place | {"limited": "true" if "range" in own else "false"})
    body = given.owners[joint]
    body.insert(list(body).index(joint) + 1, element)
    for attribute in ("qpos", "qvel"):
        at = _first_index(given, element, attribute)
        for key in _keyframes_with(given, attribute):
            words = str(key.get(attribute)).split()
            key.set(attribute, " ".join([*words[:at], "0", *words[at:]]))


def _first_index(given: GivenMjcf, joint: Element, attribute: str) -> int:
    """Index of a joint's first value in ``qpos`` or ``qvel`` of a keyframe."""
    bodies = [body for world in given.root.iter("worldbody") for body in world.iter("body")]
    joints = [element for body in bodies for element in body if element.tag in ("joint", "freejoint")]
    kinds = ["free" if one.tag == "freejoint" else given.attribute(one, "type") for one in joints]
    return sum(_WIDTHS.get(kind or "hinge", (1, 1))[attribute == "qvel"] for kind in kinds[: joints.index(joint)])


def _keyframes_with(given: GivenMjcf, attribute: str) -> list[Element]:
    """Keyframes that have an attribute."""
    return [key for group in given.root.iter("keyframe") for key in group.findall("key") if key.get(attribute)]


def _gravity(root: Element) -> np.ndarray:
    stated = [option.get("gravity") for option in root.iter("option") if option.get("gravity")]
    return np.array([float(x) for x in str(stated[-1] if stated else "0 0 -9.81").split()])


def _last_of(root: Element, tag: str) -> Element:
    """The last child with a tag, whose attributes replace those of earlier ones; a new child if there is none."""
    child_of(root, tag)
    return root.findall(tag)[-1]


def _relocate(root: Element, source: Path, folder: Path | None) -> None:
    """Make the folders of meshes and textures relative to another folder."""
    if not any(element.get("file") for element in root.iter() if isinstance(element.tag, str)):
        return
    last, compilers = _last_of(root, "compiler"), root.findall("compiler")
    for attribute in _FOLDERS:
        stated = [text for one in compilers if (text := one.get(attribute) or one.get("assetdir"))]
        place = source / stated[-1] if stated else source
        text = str(place) if folder is None else os.path.relpath(place, folder.resolve())
        last.set(attribute, Path(text).as_posix())
