# pyright: reportAttributeAccessIssue=false
"""From a robot file and its robot.yaml to a `Robot`.

Pinocchio's parsers print what they refuse, and pass over some of what they do not read: both are turned into sentences.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from phantom_dyn.arguments import or_none, path_of, takes
from phantom_dyn.errors import RobotError, known_names, shortened
from phantom_dyn.loops.chain import ClosedChain
from phantom_dyn.model.inertia import breaks_triangle, impossible_because
from phantom_dyn.model.mjcf import add_loop_frames, drawn_configuration, mjcf_facts
from phantom_dyn.model.robot import Actuator, Controller, Robot, Tolerance
from phantom_dyn.model.robot_config import JointConfig, LinearLoop, RobotConfig, read_robot_config
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.model.robot_xml import RobotXml, read_root, require_finite, urdf_facts
from phantom_dyn.model.stated_loops import closed_chain
from phantom_dyn.model.unnamed_file import unnamed_file
from phantom_dyn.motion import linear_joints

CONFIG_NAME = "robot.yaml"
_AT_REST = "world_at_rest"
"""Name of the body that is added so that every body of an MJCF world hangs on one."""
_POSE = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")
"""Attributes that place a body of MJCF."""
_SEVERAL = "several joints on one body"
_KINDS = {
    "JointModelFreeFlyer": "a floating base",
    "JointModelPlanar": "a planar joint",
    "JointModelSpherical": "a ball joint",
    "JointModelSphericalZYX": "a ball joint",
    "JointModelComposite": _SEVERAL,
}
"""What Pinocchio's joints of more than one velocity are called in a message."""
_DRIVE = (
    "gear_ratio",
    "torque_constant",
    "torque_limit",
    "encoder_counts",
    "resistance",
    "voltage_limit",
    "controller",
)
"""Keys of a joint in robot.yaml that only a driven joint has a use for."""


@takes(
    source=path_of("a URDF or MJCF file, example:NAME, or a built-in name"),
    config=or_none(path_of("the path of a robot.yaml")),
)
def load_robot(source: str | Path, *, config: str | Path | None = None) -> Robot:
    """Robot from a URDF or MJCF file, ``example:NAME``, or a built-in name.

    Args:
        source: File or name.
        config: Its ``robot.yaml``; by default the one in the folder of the robot file, if there is one.

    Returns:
        Robot with one velocity per joint. Joints under ``lock`` and joints that mimic another are held fixed;
        joints that close a loop are passive, see `phantom_dyn.model.stated_loops`.

    Raises:
        RobotError: If file, name or configuration cannot be used; one sentence says why and what to do.
    """
    path = find_robot(source)
    facts = _facts(path)
    config_path = path.with_name(CONFIG_NAME) if config is None else Path(config)
    stated = read_robot_config(config_path) if config is not None or config_path.is_file() else RobotConfig()
    full = parse_model(path, facts.kind)
    if facts.gravity is not None:
        full.gravity = pin.Motion(np.array(facts.gravity), np.zeros(3))
    _check_names(full, stated, config_path)
    carried = add_loop_frames(full, facts.loops, path)
    model, locked = _hold(full, stated, facts)
    _require_simple_joints(model, path)
    _check_payload_frame(model, stated, config_path)
    idle = frozenset(model.names) - facts.driven if facts.driven and facts.loops else frozenset()
    chain = closed_chain(model, stated, config_path if stated.loops else path, carried=carried, without_drive=idle)
    robot = _robot(model, str(source), path, facts, stated, locked, chain)
    return replace(robot, config=None if config is None else Path(config))


def parse_model(path: Path, kind: Literal["urdf", "mjcf"]) -> pin.Model:
    """Pinocchio's model of a file, meshes not read.

    Raises:
        RobotError: If Pinocchio refuses it, or its parser drops the inertia of a link.
    """
    build = pin.buildModelFromUrdf if kind == "urdf" else pin.buildModelFromMJCF
    model, reason = None, ""
    with _captured_output() as printed:
        try:
            with _whole_tree(path, kind) as whole:
                model = build(str(whole))
        except Exception as problem:  # Boost.Python turns C++ exceptions into several Python ones
            # Pinocchio puts its source position in front of the message.
            reason = str(problem).rpartition("message:")[2].strip()
    errors = [line.removeprefix("Error:").strip() for line in printed if line.startswith("Error:")]
    # The URDF parser goes on without an inertia or a visual that it cannot read; only the first changes the dynamics.
    if model is None or any("inertial" in line.casefold() for line in errors):
        reason = "; ".join(re.sub(r"\s+", " ", text).rstrip(".") for text in errors or [reason])
        raise RobotError(f"{path} is not a robot that Pinocchio can read ({reason}): correct the file.")
    return model


@contextmanager
def _whole_tree(path: Path, kind: Literal["urdf", "mjcf"]) -> Iterator[Path]:
    """The file, or one in which every body of the world hangs on a body at rest.

    Pinocchio 4.1 reads the first body of a ``<worldbody>`` and drops the others without a word; of a first body without
    a joint, such as a base on a wall, it drops the pose.
    """
    root = ElementTree.parse(path).getroot()
    bodies = [(world, body) for world in root.iter("worldbody") for body in world.findall("body")]
    if kind == "urdf" or (len(bodies) < 2 and not any(_fixed_elsewhere(body) for _, body in bodies)):
        yield path
        return
    rest = ElementTree.SubElement(bodies[0][0], "body", {"name": _AT_REST})
    for world, body in bodies:
        world.remove(body)
        rest.append(body)
    with unnamed_file(ElementTree.tostring(root, encoding="utf-8"), suffix=path.suffix) as whole:
        yield whole


def _fixed_elsewhere(body: ElementTree.Element) -> bool:
    moves = body.find("joint") is not None or body.find("freejoint") is not None
    return not moves and any(body.get(key) is not None for key in _POSE)


@contextmanager
def _captured_output() -> Iterator[list[str]]:
    """Collect what C++ code prints: its streams know nothing of `sys.stderr`, so the descriptors are swapped."""
    lines: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    saved = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile() as sink:
        try:
            os.dup2(sink.fileno(), 1)
            os.dup2(sink.fileno(), 2)
            yield lines
        finally:
            for descriptor, original in zip((1, 2), saved, strict=True):
                os.dup2(original, descriptor)
                os.close(original)
            sink.seek(0)
            lines.extend(sink.read().decode(errors="replace").splitlines())


def _facts(path: Path) -> RobotXml:
    """Facts of the file, its inertias found possible."""
    root, sha256 = read_root(path)
    facts = urdf_facts(root, sha256, path) if root.tag == "robot" else mjcf_facts(root, sha256, path)
    require_finite(root, path)
    for body in facts.bodies:
        reason = impossible_because(body.mass, body.central_inertia)
        if reason:
            raise RobotError(f"{path}: {body.name} cannot exist, {reason}: correct its <inertial>.")
    return facts


def _check_names(model: pin.Model, stated: RobotConfig, config: Path) -> None:
    joints = list(model.names)[1:]
    named = [("joints", name) for name in stated.joints] + [("lock", name) for name in stated.lock]
    frames = []
    for index, loop in enumerate(stated.loops):
        key = f"loops[{index}]"
        named += [(f"{key}.active", name) for name in loop.active or ()]
        if isinstance(loop, LinearLoop):
            named += [(f"{key}.passive", name) for name in loop.passive]
        else:
            named += [(f"{key}.start", name) for name in loop.start or ()]
            frames += [(f"{key}.frame_a", loop.frame_a), (f"{key}.frame_b", loop.frame_b)]
    for key, name in named:
        if name not in joints:
            known = known_names(name, joints, "joints")
            raise RobotError(f"{config}: {key} names the unknown joint {shortened(name)!r}, {known}")
    for key, name in frames:
        _require_frame(model, name, key, config)
    held = [(key, name) for key, name in named if key.startswith("loops") and name in stated.lock]
    for key, name in held:
        raise RobotError(f"{config}: {key} names {name!r}, which lock holds fixed: take it out of one of the two.")


def _require_frame(model: pin.Model, name: str, key: str, config: Path) -> None:
    if not model.existFrame(name):
        known = known_names(name, dict.fromkeys(frame.name for frame in model.frames), "frames")
        raise RobotError(f"{config}: {key} names the unknown frame {shortened(name)!r}, {known}")


def _check_payload_frame(model: pin.Model, stated: RobotConfig, config: Path) -> None:
    if stated.payload_frame is None:
        return
    _require_frame(model, stated.payload_frame, "payload_frame", config)
    if model.frames[model.getFrameId(stated.payload_frame)].parentJoint == 0:
        raise RobotError(
            f"{config}: payload_frame {stated.payload_frame!r} does not move: give a frame on a moving link."
        )


def _hold(model: pin.Model, stated: RobotConfig, facts: RobotXml) -> tuple[pin.Model, tuple[str, ...]]:
    """Model without its locked and following joints, and their names."""
    in_loops = {name for loop in stated.loops if isinstance(loop, LinearLoop) for name in (*loop.active, *loop.passive)}
    following = facts.followers.keys() - in_loops
    base = _moving_bases(model) if stated.base == "fixed" else frozenset()
    held = [name for name in list(model.names)[1:] if name in base or name in stated.lock or name in following]
    if not held:
        return model, ()
    q, drawn = pin.neutral(model), drawn_configuration(model)
    for name in held:
        joint = model.joints[model.getJointId(name)]
        if joint.nv > 1:
            q[joint.idx_q : joint.idx_q + joint.nq] = drawn[joint.idx_q : joint.idx_q + joint.nq]
        elif joint.nq == 1 and name not in stated.lock:
            q[joint.idx_q] = facts.followers[name][1]
    return pin.buildReducedModel(model, [model.getJointId(name) for name in held], q), tuple(held)


def _moving_bases(model: pin.Model) -> frozenset[str]:
    """Joints of more than one velocity that hang on the world."""
    joints = zip(list(model.names)[1:], list(model.joints)[1:], list(model.parents)[1:], strict=True)
    return frozenset(name for name, joint, parent in joints if parent == 0 and joint.nv > 1)


def _require_simple_joints(model: pin.Model, path: Path) -> None:
    if model.njoints == 1:
        raise RobotError(f"{path} has no joint that moves: give a robot with at least one revolute or linear joint.")
    bases = _moving_bases(model)
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        if joint.nv == 1:
            continue
        kind = _KINDS.get(joint.shortname(), joint.shortname())
        fixed = f"write base: fixed into {CONFIG_NAME}"
        if name in bases and kind != _SEVERAL:
            raise RobotError(
                f"{path}: {name} is {kind}, and only robots on a fixed base are taken: if the robot hangs on a rig, or "
                f"its base is held otherwise, {fixed}."
            )
        held = (
            f"{fixed} if the robot is held there" if name in bases else f"hold it with lock: [{name}] in {CONFIG_NAME}"
        )
        raise RobotError(
            f"{path}: {name} is {kind}, and only revolute, continuous and linear joints are taken: give it one joint "
            f"per body, or {held}."
        )
    inertias = [inertia.toDynamicParameters() for inertia in model.inertias]
    placements = [placement.homogeneous for placement in model.jointPlacements]
    if not (np.isfinite(inertias).all() and np.isfinite(placements).all()):
        raise RobotError(f"{path} gives a model that is not finite: look for a zero axis, quaternion or vector in it.")


def _actuator(stated: JointConfig, armature: float) -> Actuator:
    controller = stated.controller
    return Actuator(
        rotor_inertia=armature if stated.rotor_inertia is None else stated.rotor_inertia,
        gear_ratio=stated.gear_ratio,
        torque_constant=stated.torque_constant,
        torque_limit=stated.torque_limit,
        encoder_counts=stated.encoder_counts,
        encoder_side=stated.encoder_side,
        actuated=stated.actuated,
        resistance=stated.resistance,
        voltage_limit=stated.voltage_limit,
        controller=controller and Controller(controller.kind, controller.kp, controller.kd, controller.delay),
    )


def _has_drive(stated: JointConfig) -> bool:
    plain = JointConfig()
    return any(getattr(stated, key) != getattr(plain, key) for key in _DRIVE)


def _warnings(
    facts: RobotXml, stated: RobotConfig, locked: tuple[str, ...], chain: ClosedChain | None, path: Path
) -> tuple[str, ...]:
    broken = [body.name for body in facts.bodies if breaks_triangle(body.central_inertia)]
    sentences = list(facts.warnings)
    if broken:
        sentences.append(
            f"{path}: no rigid body has the inertia of {', '.join(broken)}, where one principal value exceeds "
            "the sum of the others; it is used as it is."
        )
    following = [
        f"{name} (follows {facts.followers[name][0]})"
        for name in locked
        if name in facts.followers and name not in stated.lock
    ]
    if following:
        sentences.append(f"{path}: joints that follow another are held fixed: {', '.join(following)}.")
    unused = [name for name in locked if name in stated.joints]
    if unused:
        sentences.append(f"The drives stated for {', '.join(unused)} are not used, as these joints are held fixed.")
    passive = () if chain is None else chain.passive_names
    idle = [name for name in passive if _has_drive(stated.joints.get(name, JointConfig()))]
    if idle:
        sentences.append(f"Of the drives of {', '.join(idle)} only the rotors count, as these joints are passive.")
    return tuple(sentences)


def _idle_links(model: pin.Model, chain: ClosedChain | None, path: Path) -> tuple[str, ...]:
    """A sentence on joints that need no torque by the model; rods of a closed chain may well be without mass."""
    idle = [] if chain is not None else _without_inertia(model)
    # Of a model without any mass more is said, by the checks of recordings.
    if not idle or len(idle) == model.njoints - 1:
        return ()
    return (
        f"{path}: nothing that {' and '.join(idle)} moves has mass or inertia, so that no motion of it needs a torque "
        "by the model: give the links their <inertial>.",
    )


def _without_inertia(model: pin.Model) -> list[str]:
    """Joints of a tree beyond which nothing has mass or inertia, as where a file leaves out an <inertial>."""
    bodies = [inertia.toDynamicParameters().any() for inertia in model.inertias]
    out = [joint for joint in range(1, model.njoints) if not any(bodies[k] for k in model.subtrees[joint])]
    return [model.names[joint] for joint in out if not model.armature[model.joints[joint].idx_v]]


def _robot(
    model: pin.Model,
    source: str,
    path: Path,
    facts: RobotXml,
    stated: RobotConfig,
    locked: tuple[str, ...],
    chain: ClosedChain | None,
) -> Robot:
    names = tuple(model.names)[1:]
    drives = [stated.joints.get(name, JointConfig()) for name in names]
    actuators = tuple(_actuator(drive, float(model.armature[k])) for k, drive in enumerate(drives))
    model.armature = np.array([actuator.rotor_inertia for actuator in actuators])
    if stated.gravity is not None:
        model.gravity = pin.Motion(np.array(stated.gravity), np.zeros(3))
    rows = list(range(model.nv) if chain is None else chain.active)
    soft = facts.soft_friction if chain is None else {}
    trust = stated.tolerance
    return Robot(
        model=model,
        name=facts.name or path.stem,
        source=source,
        sha256=facts.sha256,
        joint_names=tuple(names[k] for k in rows),
        actuators=tuple(actuators[k] for k in rows),
        viscous_friction=model.damping[rows],
        coulomb_friction=model.upperDryFrictionLimit[rows],
        prismatic=linear_joints(model)[rows],
        torque_hold=stated.torque_hold,
        reference_hold=stated.reference_hold,
        torque_source=stated.torque_source,
        tolerance=Tolerance(trust.inertia, trust.friction, trust.rotor_inertia),
        payload_frame=stated.payload_frame,
        warnings=(*_warnings(facts, stated, locked, chain, path), *_idle_links(model, chain, path)),
        locked=locked,
        chain=chain,
        soft_friction=tuple(soft.get(names[k]) for k in rows) if soft else (),
    )
