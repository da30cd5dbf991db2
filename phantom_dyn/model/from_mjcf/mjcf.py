# pyright: reportAttributeAccessIssue=false
"""Reads from a MJCF file what Pinocchio's tree does not contain: gravity, loops, following joints, drives, warnings.

Everything is read from MuJoCo's compiled model, in which MuJoCo has resolved classes, frames and units of angles.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array
from phantom_dyn.errors import RobotError, known_names, shortened
from phantom_dyn.model.from_mjcf.mjcf_drives import driven_joints, drives_of
from phantom_dyn.model.from_mjcf.mjcf_followers import followers_of, play_of
from phantom_dyn.model.from_mjcf.mjcf_forces import (
    gravity_and_force_warnings,
    joints_of,
    modelled_gravity,
    omitted_forces,
    switched_off,
)
from phantom_dyn.model.from_mjcf.mjcf_tree import pose_of
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

if TYPE_CHECKING:
    import mujoco

# Largest mass of a body [kg], above which numbers are not in SI units.
_LARGEST_MASS = 1e9
# Kinds of equalities, by MuJoCo's mjtEq.
_CONNECT, _WELD = 0, 1
_NO_EQUALITY = "mjDSBL_EQUALITY"


def check_mjcf(root: Element, path: Path) -> None:
    """Refuse wrong names and numbers of bodies and joints that MuJoCo accepts, or reports without their place.

    Raises:
        RobotError: If a name is repeated or empty, or a number is impossible.
    """
    require_names(root.iter("body"), "body", path)
    joints = root.findall(".//body/joint")
    require_names(joints, "joint", path)
    for element in root.iter("body"):
        _check_body(element, path)
    for joint in root.iter("joint"):
        owner = f"joint {joint.get('name', '(default)')}"
        for attribute, count in (("pos", 3), ("axis", 3), ("ref", 1)):
            numbers(joint, attribute, owner, path, count=count)
        require_not_negative(joint, ("frictionloss", "armature"), owner, path, count=1)
        require_not_negative(joint, ("damping",), owner, path)
        ends = numbers(joint, "range", owner, path, count=2, most=np.inf)
        if ends:
            require_order(ends[0], ends[1], "range", owner, path)
    for option in root.findall("option"):
        numbers(option, "gravity", "the file", path, count=3)
    names = [joint.get("name", "") for joint in joints]
    # Included files may contain more joints.
    equalities = root.findall(".//equality/*") if root.find(".//include") is None else []
    for element in equalities:
        for attribute in ("joint1", "joint2"):
            given = element.get(attribute)
            if given is not None and given not in names:
                known = known_names(given, names, "joints")
                raise RobotError(f"{path}: <equality> names the joint {shortened(given)!r}, {known}")


def mjcf_facts(root: Element, sha256: str, path: Path, compiled: mujoco.MjModel) -> RobotXml:
    """Facts of a MJCF file.

    Args:
        root: Root element of the file.
        sha256: SHA-256 of the file.
        path: Path of the file for messages.
        compiled: MuJoCo's model of the file.

    Raises:
        RobotError: If a joint follows another one by a curve.
    """
    x, y, z = modelled_gravity(compiled)
    omitted = omitted_forces(compiled)
    driven = driven_joints(compiled)
    return RobotXml(
        root.get("model", ""),
        sha256,
        tuple(_body(compiled, body, path) for body in range(1, compiled.nbody)),
        followers_of(compiled, driven, path) if not switched_off(compiled, _NO_EQUALITY) else {},
        (x, y, z),
        gravity_and_force_warnings(compiled, omitted, path),
        _loops(compiled) if not switched_off(compiled, _NO_EQUALITY) else (),
        driven,
        _soft_frictions(compiled),
        drives_of(compiled),
        play_of(compiled, driven),
        _base_joints(compiled),
        joints_of(omitted),
    )


def _base_joints(compiled: mujoco.MjModel) -> frozenset[str]:
    """Joints of bodies that several joints connect to the world: a file describes a sliding and turning base so."""
    on_world = np.flatnonzero(compiled.body_weldid[compiled.body_parentid] == 0)
    bases = [body for body in on_world if compiled.body_jntnum[body] > 1]
    return frozenset(compiled.joint(k).name for k in range(compiled.njnt) if compiled.jnt_bodyid[k] in bases)


def _soft_frictions(compiled: mujoco.MjModel) -> dict[str, SoftFriction]:
    """Softness of MuJoCo's dry friction for each joint, from ``solreffriction`` and ``solimpfriction``.

    The constraint has the reference acceleration ``-b v``; it is soft because its impedance ``d`` is below one. Source:
    MuJoCo's documentation, "Computation" (constraint model) and "Modeling" (solver parameters).
    """
    out = {}
    for k in range(compiled.nv):
        reference, impedance = compiled.dof_solref[k], compiled.dof_solimp[k]
        least, most = np.clip(impedance[:2], 1e-4, 1 - 1e-4).tolist()
        # Positive numbers are a time constant and a damping ratio, negative ones stiffness and damping.
        time = 0.5 * most * reference[0] if reference[0] > 0 else most / max(-reference[1], 1e-9)
        out[compiled.joint(int(compiled.dof_jntid[k])).name] = SoftFriction(float(time), least / (1.0 - least))
    return out


def add_loop_frames(model: pin.Model, loops: tuple[MjcfLoop, ...]) -> dict[str, PointLoop | FrameLoop]:
    """Add the frames of loops to the model, and return the loops by label, in the form of robot.yaml.

    Args:
        model: Model with all joints of the file, to which frames are added.
        loops: Loops that `mjcf_facts` found.
    """
    home = drawn_configuration(model)
    start = {
        model.names[j]: float(home[joint.idx_q])
        for j, joint in enumerate(model.joints)
        if j and joint.nq == 1 and home[joint.idx_q] != 0
    }
    out: dict[str, PointLoop | FrameLoop] = {}
    for index, loop in enumerate(loops):
        ends = [f"{loop.label} {index}{side}" for side in "ab"]
        for name, owner, placement in zip(ends, (loop.frame_a, loop.frame_b), (loop.in_a, loop.in_b), strict=True):
            frame = frame_index(model, owner)
            parent = model.frames[frame]
            full = parent.placement * pose_of(np.array(placement[:3]), np.array(placement[3:]))
            model.addFrame(pin.Frame(name, parent.parentJoint, frame, full, pin.FrameType.OP_FRAME), False)
        stated = FrameLoop if loop.kind == "frame" else PointLoop
        label = loop.label if loop.label not in out else f"{loop.label} ({index})"
        out[label] = stated(frame_a=ends[0], frame_b=ends[1], start=start)
    return out


def _check_body(element: Element, path: Path) -> None:
    name = f"body {element.get('name', '(without a name)')}"
    require_once(element, ("inertial",), name, path)
    for geom in element.findall("geom"):
        require_not_negative(geom, ("mass", "density"), name, path)
    inertial = element.find("inertial")
    if inertial is None:
        return
    mass = numbers(inertial, "mass", name, path)
    diagonal = numbers(inertial, "diaginertia", name, path)
    full = numbers(inertial, "fullinertia", name, path)
    if len(mass) != 1 or (len(diagonal), len(full)) not in ((3, 0), (0, 6)):
        raise RobotError(
            f"{path}: the <inertial> of {name} needs mass and diaginertia (3) or fullinertia (6 numbers): add them."
        )
    from phantom_dyn.model.inertia import impossible_because

    reason = impossible_because(mass[0], symmetric(*full) if full else np.diag(diagonal))
    if reason:
        raise RobotError(f"{path}: {name} cannot exist, {reason}: correct its <inertial>.")


def _body(compiled: mujoco.MjModel, body: int, path: Path) -> Body:
    mass = float(compiled.body_mass[body])
    name = f"body {compiled.body(body).name}"
    if not mass <= _LARGEST_MASS:
        raise RobotError(f"{path}: {name} has a mass of {mass:g} kg, which no robot has: give SI units.")
    return Body(name, mass, np.diag(compiled.body_inertia[body]), bool(compiled.body_weldid[body]))


def _loops(compiled: mujoco.MjModel) -> tuple[MjcfLoop, ...]:
    """The active equalities that close loops."""
    kinds = np.array(compiled.eq_type)
    closed = np.flatnonzero(np.isin(kinds, (_CONNECT, _WELD)) & np.array(compiled.eq_active0).astype(bool))
    return tuple(_loop(compiled, int(k)) for k in closed)


def _loop(compiled: mujoco.MjModel, k: int) -> MjcfLoop:
    import mujoco

    on_sites = int(compiled.eq_objtype[k]) == int(mujoco.mjtObj.mjOBJ_SITE)
    named = compiled.site if on_sites else compiled.body
    first, second = (named(int(row[k])).name for row in (compiled.eq_obj1id, compiled.eq_obj2id))
    data, weld = compiled.eq_data[k].tolist(), int(compiled.eq_type[k]) == _WELD
    held_to = "the world" if second == "world" else shortened(second)
    label = f"<{'weld' if weld else 'connect'}> of {shortened(first)} and {held_to}"
    upright = (1.0, 0.0, 0.0, 0.0)
    if on_sites:
        places: list[tuple[float, ...]] = [(0.0, 0.0, 0.0, *upright)] * 2
    elif weld:
        places = [tuple(data[3:10]), (*data[:3], *upright)]
    else:
        places = [(*data[:3], *upright), (*data[3:6], *upright)]
    frames = ["universe" if name == "world" else name for name in (first, second)]
    return MjcfLoop(label, "frame" if weld and data[10] > 0 else "point", frames[0], frames[1], *places)


def drawn_configuration(model: pin.Model) -> Array:
    """Configuration in which a file draws the robot; in MJCF it is not zero for joints with ``ref`` or free joints."""
    drawn = {entry.key(): entry.data() for entry in model.referenceConfigurations}
    return drawn.get("qpos0", pin.neutral(model))
