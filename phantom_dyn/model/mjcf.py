# pyright: reportAttributeAccessIssue=false
"""Facts of a MJCF file that Pinocchio drops: gravity, equalities, loops, and features that would make the model wrong.

Loops that the file closes with ``<connect>`` and ``<weld>`` are placed on the frames of the bodies here, because
`buildModelAndConstraintsFromMJCF` of Pinocchio 4.1 misplaces an anchor on a body whose joint has a ``pos``, and closes
loops that ``active="false"`` opens.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin

from phantom_dyn.errors import RobotError, known_names, shortened
from phantom_dyn.model.robot_config import FrameLoop, PointLoop
from phantom_dyn.model.robot_xml import (
    Body,
    Element,
    MjcfLoop,
    RobotXml,
    SoftFriction,
    numbers,
    require_names,
    require_not_negative,
    require_once,
    require_order,
    symmetric,
)
from phantom_dyn.model.stated_loops import frame_index

Array = np.ndarray


_POSES = (("pos", 3), ("quat", 4), ("euler", 3), ("axisangle", 4), ("xyaxes", 6), ("zaxis", 3))
"""Attributes that place a body, and how many numbers each has."""
_REFERENCE, _IMPEDANCE = (0.02, 1.0), (0.9, 0.95)
"""MuJoCo's own ``solreffriction`` and the first two of its ``solimpfriction``."""
_STRUCTURE = ("include", "frame", "replicate", "attach", "composite", "flexcomp")
"""Elements that change the tree of bodies when MuJoCo compiles the file; Pinocchio does not compile it."""
_LEFT_OUT = (
    ("compiler", "settotalmass"),
    ("compiler", "boundmass"),
    ("compiler", "boundinertia"),
    ("compiler", "balanceinertia"),
    ("compiler", "inertiafromgeom"),
    ("joint", "stiffness"),
    ("body", "gravcomp"),
    ("fixed", "stiffness"),
    ("fixed", "damping"),
    ("spatial", "stiffness"),
    ("spatial", "damping"),
    ("option", "density"),
    ("option", "viscosity"),
    ("option", "wind"),
)
"""Attributes that act on the torques of MuJoCo and that Pinocchio does not read."""


def mjcf_facts(root: Element, sha256: str, path: Path) -> RobotXml:
    """Facts of a MJCF file; keyframes and contacts are not looked at.

    Raises:
        RobotError: If the file has to be compiled by MuJoCo first, or holds an impossible number.
    """
    for tag in _STRUCTURE:
        if any(True for _ in root.iter(tag)):
            raise RobotError(
                f"{path} uses <{tag}>, which Pinocchio does not read: load the file in MuJoCo, "
                "write it out whole with mujoco.mj_saveLastXML, and give that file."
            )
    require_names(root.iter("body"), "body", path)
    require_names((joint for body in root.iter("body") for joint in body.findall("joint")), "joint", path)
    bodies = [body for element in root.iter("body") if (body := _body(element, root, path)) is not None]
    for joint in root.iter("joint"):
        owner = f"joint {joint.get('name', '(default)')}"
        for attribute, count in (("pos", 3), ("axis", 3), ("ref", 1)):
            numbers(joint, attribute, owner, path, count=count)
        require_not_negative(joint, ("damping", "frictionloss", "armature"), owner, path, count=1)
        ends = numbers(joint, "range", owner, path, count=2, most=np.inf)
        if ends:
            require_order(ends[0], ends[1], "range", owner, path)
    option = root.find("option")
    gravity = numbers(option, "gravity", "the file", path) if option is not None else []
    if len(gravity) not in (0, 3):
        raise RobotError(f"{path}: gravity in <option> has {len(gravity)} numbers, wanted three.")
    x, y, z = gravity or (0.0, 0.0, -9.81)
    return RobotXml(
        "mjcf",
        root.get("model", ""),
        sha256,
        tuple(bodies),
        _followers(root, path),
        (x, y, z),
        _warnings(root, path),
        _loops(root, path),
        _driven(root),
        _soft_frictions(root, path),
    )


def _soft_frictions(root: Element, path: Path) -> dict[str, SoftFriction]:
    """How MuJoCo lets each joint rub, from ``solreffriction`` and ``solimpfriction``.

    The constraint has the reference acceleration ``-b v`` and gives way by what its impedance ``d`` leaves. A joint
    that does not state its own numbers has MuJoCo's. Source: MuJoCo's documentation, "Computation" (constraint model)
    and "Modeling" (solver parameters).
    """
    out = {}
    for body in root.iter("body"):
        for joint in body.findall("joint"):
            owner = f"joint {joint.get('name', '')}"
            reference = numbers(joint, "solreffriction", owner, path)
            impedance = numbers(joint, "solimpfriction", owner, path)
            reference = reference if len(reference) == 2 else _REFERENCE
            least, most = np.clip(impedance[:2] if len(impedance) > 1 else _IMPEDANCE, 1e-4, 1 - 1e-4).tolist()
            # Positive numbers are a time constant and a damping ratio, negative ones stiffness and damping.
            time = 0.5 * most * reference[0] if reference[0] > 0 else most / max(-reference[1], 1e-9)
            out[joint.get("name", "")] = SoftFriction(time, least / (1.0 - least))
    return out


def add_loop_frames(model: pin.Model, loops: tuple[MjcfLoop, ...], path: Path) -> dict[str, PointLoop | FrameLoop]:
    """The loops as robot.yaml would state them, by label; their frames are added to the model.

    Args:
        model: The whole model of the file; changed.
        loops: What `mjcf_facts` found.
        path: The file, for messages.

    Raises:
        RobotError: If a body or site of a loop is not in the model.
    """
    names = dict.fromkeys(frame.name for frame in model.frames)
    home = drawn_configuration(model)
    data = model.createData()
    pin.framesForwardKinematics(model, data, home)
    start = {
        model.names[j]: float(home[joint.idx_q])
        for j, joint in enumerate(model.joints)
        if j and joint.nq == 1 and home[joint.idx_q] != 0
    }
    out: dict[str, PointLoop | FrameLoop] = {}
    for index, loop in enumerate(loops):
        for name in (loop.frame_a, loop.frame_b):
            if name not in names:
                known = known_names(name, names, "bodies and sites")
                wanted = f"{loop.label} names {shortened(name)!r}, which the model does not have"
                raise RobotError(f"{path}: {wanted}, {known}")
        a, b = frame_index(model, loop.frame_a), frame_index(model, loop.frame_b)
        ends = [f"{loop.label} {index}{side}" for side in "ab"]
        for name, frame, placement in zip(ends, (a, b), _placements(data, loop, a, b), strict=True):
            parent = model.frames[frame]
            full = parent.placement * placement
            model.addFrame(pin.Frame(name, parent.parentJoint, frame, full, pin.FrameType.OP_FRAME), False)
        stated = FrameLoop if loop.kind == "frame" else PointLoop
        label = loop.label if loop.label not in out else f"{loop.label} ({index})"
        out[label] = stated(frame_a=ends[0], frame_b=ends[1], start=start)
    return out


def _body(element: Element, root: Element, path: Path) -> Body | None:
    """Stated inertia of a body; None where MuJoCo takes it from the geoms."""
    name = f"body {element.get('name', '(without a name)')}"
    for attribute, count in _POSES:
        numbers(element, attribute, name, path, count=count)
    require_once(element, ("inertial",), name, path)
    inertial = element.find("inertial")
    if inertial is None:
        for geom in element.findall("geom"):
            require_not_negative(geom, ("mass", "density"), name, path)
            if geom.get("mesh") is not None and geom.get("mass") is None and not _geoms_have_mass(root):
                raise RobotError(
                    f"{path}: the inertia of {name} comes from a mesh, and meshes are not read: give it an <inertial>."
                )
        return None
    for attribute, count in _POSES:
        numbers(inertial, attribute, name, path, count=count)
    mass = numbers(inertial, "mass", name, path)
    diagonal = numbers(inertial, "diaginertia", name, path)
    full = numbers(inertial, "fullinertia", name, path)
    if len(mass) != 1 or (len(diagonal), len(full)) not in ((3, 0), (0, 6)):
        raise RobotError(
            f"{path}: the <inertial> of {name} needs mass and diaginertia (3) or fullinertia (6 numbers): add them."
        )
    return Body(name, mass[0], symmetric(*full) if full else np.diag(diagonal))


def _geoms_have_mass(root: Element) -> bool:
    """True if a default gives geoms their mass, as files do with ``mass="0"`` for what is only seen."""
    return any(geom.get("mass") is not None for default in root.iter("default") for geom in default.findall("geom"))


def _followers(root: Element, path: Path) -> dict[str, tuple[str, float]]:
    followers = {}
    names = [joint.get("name", "") for body in root.iter("body") for joint in body.findall("joint")]
    for constraint in (element for group in root.iter("equality") for element in group):
        if constraint.tag == "joint" and constraint.get("active", "true") != "false":
            name = constraint.get("joint1", "")
            for attribute in ("joint1", "joint2"):
                given = constraint.get(attribute)
                if given is not None and given not in names:
                    known = known_names(given, names, "joints")
                    raise RobotError(f"{path}: <equality> names the joint {shortened(given)!r}, {known}")
            offset = numbers(constraint, "polycoef", f"the equality of joint {name}", path) or [0.0]
            followers[name] = (constraint.get("joint2", "nothing"), offset[0])
    return followers


def _loops(root: Element, path: Path) -> tuple[MjcfLoop, ...]:
    """The equalities that close chains and are active."""
    constraints = [element for group in root.iter("equality") for element in group]
    return tuple(
        _loop(element, path)
        for element in constraints
        if element.tag in ("connect", "weld") and element.get("active", "true") != "false"
    )


def _loop(element: Element, path: Path) -> MjcfLoop:
    on_sites = element.get("site1") is not None
    one, other = ("site1", "site2") if on_sites else ("body1", "body2")
    first, second = element.get(one), element.get(other, None if on_sites else "universe")
    if first is None or second is None:
        raise RobotError(f"{path}: <{element.tag}> in <equality> names no {one if first is None else other}: add it.")
    held_to = "the world" if second == "universe" else shortened(second)
    label = f"<{element.tag}> of {shortened(first)} and {held_to}"
    anchor = numbers(element, "anchor", label, path) or [0.0, 0.0, 0.0]
    relative = numbers(element, "relpose", label, path)
    turns = numbers(element, "torquescale", label, path) or [1.0]
    if len(anchor) != 3 or len(relative) not in (0, 7):
        raise RobotError(f"{path}: {label} needs three numbers as anchor and seven as relpose.")
    # MuJoCo takes a quaternion of zeros, its default, for the pose that the bodies have in the file.
    stated = tuple(relative) if any(relative[3:]) else None
    kind: Literal["point", "frame"] = "frame" if element.tag == "weld" and turns[0] > 0 else "point"
    frames = ["universe" if name == "world" else name for name in (first, second)]
    return MjcfLoop(label, kind, frames[0], frames[1], tuple(anchor), stated, element.tag == "connect", on_sites)


def _driven(root: Element) -> frozenset[str]:
    """Joints that an actuator of the file acts on."""
    actuators = [element for group in root.iter("actuator") for element in group]
    names = [element.get(attribute) for element in actuators for attribute in ("joint", "jointinparent")]
    return frozenset(name for name in names if name is not None)


def _warnings(root: Element, path: Path) -> tuple[str, ...]:
    found = []
    for tag, attribute in _LEFT_OUT:
        values = [element.get(attribute, "") for element in root.iter(tag)]
        if any(value not in ("", "false", "auto") and value.strip(" 0.") for value in values):
            found.append(f"{attribute} of <{tag}>")
    if not found:
        return ()
    return (f"{path} states {', '.join(found)}, which the model leaves out: a gap may come from it.",)


def drawn_configuration(model: pin.Model) -> Array:
    """Configuration in which a file draws the robot; not zero where MJCF joints have a ``ref`` or are free."""
    drawn = {entry.key(): entry.data() for entry in model.referenceConfigurations}
    return drawn.get("qpos0", pin.neutral(model))


def _placements(data: pin.Data, loop: MjcfLoop, a: int, b: int) -> tuple[pin.SE3, pin.SE3]:
    """Places of the two ends on their bodies or sites, as MuJoCo defines them."""
    anchor = pin.SE3(np.eye(3), np.array(loop.anchor))
    b_in_a = data.oMf[a].actInv(data.oMf[b])
    if loop.on_sites:
        return pin.SE3.Identity(), pin.SE3.Identity()
    if loop.anchor_on_first:
        return anchor, b_in_a.actInv(anchor)
    if loop.relative is None:
        return b_in_a * anchor, anchor
    w, x, y, z = np.array(loop.relative[3:]) / np.linalg.norm(loop.relative[3:])
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), np.array(loop.relative[:3])), anchor
