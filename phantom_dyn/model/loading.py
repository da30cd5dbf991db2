# pyright: reportAttributeAccessIssue=false
"""Loads a `Robot` from a URDF or MJCF file and its robot.yaml.

MuJoCo reads MJCF, and Pinocchio reads URDF. Problems that Pinocchio's parser prints or ignores are raised as errors or
returned as warnings.
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

import msgspec
import numpy as np
import pinocchio as pin

from phantom_dyn.arguments import or_none, path_of, takes
from phantom_dyn.errors import RobotError, known_names, shortened
from phantom_dyn.loops.chain import ClosedChain
from phantom_dyn.model.body_warnings import body_warnings, is_negligible
from phantom_dyn.model.files.settings_file import load_mapping
from phantom_dyn.model.from_mjcf.mjcf import add_loop_frames, check_mjcf, mjcf_facts
from phantom_dyn.model.from_mjcf.mjcf_compiler import compiled_mjcf
from phantom_dyn.model.from_mjcf.mjcf_tree import tree_of_mjcf
from phantom_dyn.model.held_joints import held_and_following, hold
from phantom_dyn.model.inertia import breaks_triangle, impossible_because
from phantom_dyn.model.robot import Robot, Tolerance
from phantom_dyn.model.robot_config import JointConfig, LinearLoop, RobotConfig, read_robot_config
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.model.robot_xml import Drive, RobotXml, read_root, require_finite
from phantom_dyn.model.ros2_control import Ros2Config, is_ros2_control, ros2_config
from phantom_dyn.model.stated_drives import actuator_of
from phantom_dyn.model.stated_loops import closed_chain
from phantom_dyn.model.urdf_facts import urdf_facts
from phantom_dyn.motion import linear_joints

CONFIG_NAME = "robot.yaml"
_BALL = "a ball joint"
# Words for Pinocchio's joints with several degrees of freedom, for messages.
_KINDS = {
    "JointModelFreeFlyer": "a floating base",
    "JointModelPlanar": "a planar joint",
    "JointModelSpherical": _BALL,
    "JointModelSphericalZYX": _BALL,
}
# Keys of a joint in robot.yaml that describe its drive.
_OF_DRIVES = (
    "gear_ratio",
    "torque_constant",
    "torque_limit",
    "encoder_counts",
    "resistance",
    "voltage_limit",
    "controller",
)


@takes(
    source=path_of("a URDF or MJCF file, example:NAME, or a built-in name"),
    config=or_none(path_of("the path of a robot.yaml")),
)
def load_robot(source: str | Path, *, config: str | Path | None = None) -> Robot:
    """Robot from a URDF or MJCF file, ``example:NAME``, or a built-in name.

    Args:
        source: File or name.
        config: Path of the ``robot.yaml``; by default that in the folder of the robot file, if there is one.

    Returns:
        Robot with one velocity per joint. Joints under ``lock`` are held fixed; joints that follow others or close a
        loop are passive (`phantom_dyn.model.stated_loops`).

    Raises:
        RobotError: If file, name or configuration cannot be used; the message says why and what to do.
    """
    path = find_robot(source)
    config_path = path.with_name(CONFIG_NAME) if config is None else Path(config)
    stated = _config(config_path) if config is not None or config_path.is_file() else RobotConfig()
    facts, full = read_model(path)
    if facts.gravity is not None:
        full.gravity = pin.Motion(np.array(facts.gravity), np.zeros(3))
    _check_names(full, stated, config_path)
    carried = add_loop_frames(full, facts.loops)
    held, loops = held_and_following(full, stated, facts)
    model, locked = hold(full, held)
    _require_simple_joints(model, path)
    _check_payload_frame(model, stated, config_path)
    idle = frozenset(model.names) - facts.driven if facts.driven and facts.loops else frozenset()
    whole = msgspec.structs.replace(stated, loops=[*stated.loops, *loops])
    chain = closed_chain(model, whole, config_path if stated.loops else path, carried=carried, without_drive=idle)
    robot = _robot(model, str(source), path, facts, stated, locked, chain)
    return replace(robot, config=None if config is None else Path(config))


def _config(path: Path) -> RobotConfig:
    """Content of a robot.yaml, or of a ros2_control file."""
    content = load_mapping(path, RobotError)
    return ros2_config(content, path) if is_ros2_control(content) else read_robot_config(path)


def read_model(path: Path) -> tuple[RobotXml, pin.Model]:
    """Content of a robot file, and Pinocchio's model with all joints of the file; meshes are not read.

    Raises:
        RobotError: If the file cannot be read, or contains an impossible body or number.
    """
    root, sha256 = read_root(path)
    if root.tag == "mujoco":
        check_mjcf(root, path)
        require_finite(root, path)
        compiled = compiled_mjcf(path, root)
        return mjcf_facts(root, sha256, path, compiled), tree_of_mjcf(compiled)
    facts = urdf_facts(root, sha256, path)
    require_finite(root, path)
    full = parsed_urdf(path)
    for body in facts.bodies:
        reason = impossible_because(body.mass, body.central_inertia)
        if reason and body.moves and not is_negligible(full, body):
            raise RobotError(f"{path}: {body.name} cannot exist, {reason}: correct its <inertial>.")
    return facts, full


def parsed_urdf(path: Path) -> pin.Model:
    """Pinocchio's model of a URDF; meshes are not read.

    Raises:
        RobotError: If Pinocchio cannot read the file, or its parser ignores the inertia of a link.
    """
    model, reason = None, ""
    with _captured_output() as printed:
        try:
            model = pin.buildModelFromUrdf(str(path))
        except Exception as problem:  # Boost.Python turns C++ exceptions into several Python ones
            # Pinocchio writes a position in its source code before the message.
            reason = str(problem).rpartition("message:")[2].strip()
    errors = [line.removeprefix("Error:").strip() for line in printed if line.startswith("Error:")]
    # The URDF parser ignores an inertia or a visual that it cannot read; only the inertia changes the dynamics.
    if model is None or any("inertial" in line.casefold() for line in errors):
        reason = "; ".join(re.sub(r"\s+", " ", text).rstrip(".") for text in errors or [reason])
        raise RobotError(f"{path} is not a robot that Pinocchio can read ({reason}): correct the file.")
    return model


@contextmanager
def _captured_output() -> Iterator[list[str]]:
    """Collect the lines that C++ code prints, by redirecting the file descriptors: C++ does not use `sys.stderr`."""
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


def _check_names(model: pin.Model, stated: RobotConfig, config: Path) -> None:
    """Refuse names of joints and frames in robot.yaml that do not exist in the model."""
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
    """Refuse a payload frame that does not exist or does not move."""
    if stated.payload_frame is None:
        return
    _require_frame(model, stated.payload_frame, "payload_frame", config)
    if model.frames[model.getFrameId(stated.payload_frame)].parentJoint == 0:
        raise RobotError(
            f"{config}: payload_frame {stated.payload_frame!r} does not move: give a frame on a moving link."
        )


def _require_simple_joints(model: pin.Model, path: Path) -> None:
    """Refuse a model without joints, with joints that have several degrees of freedom, or with NaN or infinity."""
    if model.njoints == 1:
        raise RobotError(f"{path} has no joint that moves: give a robot with at least one revolute or linear joint.")
    for index, name in enumerate(list(model.names)[1:], start=1):
        if model.joints[index].nv == 1:
            continue
        kind = _KINDS.get(model.joints[index].shortname(), model.joints[index].shortname())
        on_world = model.parents[index] == 0
        carries_all = on_world and len(model.subtrees[index]) == model.njoints - 1
        fixed = f"write base: fixed into {CONFIG_NAME}"
        lock = f"hold it with lock: [{name}] in {CONFIG_NAME}"
        if carries_all and kind != _BALL:
            raise RobotError(
                f"{path}: {name} is {kind}, and nothing says what its base does: if the robot hangs on a rig, or its "
                f"base is held otherwise, {fixed}; if it moves and logs say how (w. and sf.), write base: floating."
            )
        if on_world and kind != _BALL:
            raise RobotError(
                f"{path}: {name} lets a body move freely beside the robot, of which no torque says anything: "
                f"{lock}, or leave that body out."
            )
        held = f"{fixed} if the robot is held there" if carries_all else lock
        hinges = ""
        if kind == _BALL:
            hinges = "write two or three hinges in its place (a rod between ball joints needs two), or "
        raise RobotError(
            f"{path}: {name} is {kind}, and only revolute, continuous and linear joints are taken: {hinges}{held}."
        )
    inertias = [inertia.toDynamicParameters() for inertia in model.inertias]
    placements = [placement.homogeneous for placement in model.jointPlacements]
    if not (np.isfinite(inertias).all() and np.isfinite(placements).all()):
        raise RobotError(f"{path} gives a model that is not finite: look for a zero axis, quaternion or vector in it.")


def _has_drive(stated: JointConfig) -> bool:
    """True if robot.yaml describes a drive of this joint."""
    default = JointConfig()
    return any(getattr(stated, key) != getattr(default, key) for key in _OF_DRIVES)


def _warnings(
    facts: RobotXml, stated: RobotConfig, locked: tuple[str, ...], chain: ClosedChain | None, path: Path
) -> tuple[str, ...]:
    """Sentences about ignored or impossible parts of the robot file and of robot.yaml."""
    impossible = [(body, impossible_because(body.mass, body.central_inertia)) for body in facts.bodies]
    broken = [body.name for body, why in impossible if why is None and breaks_triangle(body.central_inertia)]
    sentences = [*facts.warnings, *(stated.sentences if isinstance(stated, Ros2Config) else ())]
    sentences += [
        f"{path}: {body.name} cannot exist, {why}; "
        + (
            "it is less than a hundredth of the body that it is fixed in, and is used as it is."
            if body.moves
            else "it never moves, so that nothing depends on it."
        )
        for body, why in impossible
        if why is not None
    ]
    if broken:
        sentences.append(
            f"{path}: no rigid body has the inertia of {', '.join(broken)}, where one principal value exceeds "
            "the sum of the others; it is used as it is."
        )
    held = [
        f"{name} ({_why_held(facts, name)})"
        for name in locked
        if (name in facts.followers or name in facts.play) and name not in stated.lock
    ]
    if held:
        sentences.append(f"{path}: held fixed: {', '.join(held)}.")
    unused = [name for name in locked if name in stated.joints]
    if unused:
        sentences.append(f"The drives stated for {', '.join(unused)} are not used, as these joints are held fixed.")
    passive = () if chain is None else chain.passive_names
    idle = [name for name in passive if _has_drive(stated.joints.get(name, JointConfig()))]
    if idle:
        sentences.append(f"Of the drives of {', '.join(idle)} only the rotors count, as these joints are passive.")
    return tuple(sentences)


def _why_held(facts: RobotXml, name: str) -> str:
    """Reason in words why a joint that robot.yaml does not lock is held fixed."""
    if name in facts.play:
        joint, width = facts.play[name]
        return f"the play of {joint}, {width:.3g} wide; write it under joints in {CONFIG_NAME} if it is a joint"
    leader = facts.followers[name].leader
    return "its equality holds it" if leader is None else f"follows {leader}, which is held"


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
    actuators = tuple(
        actuator_of(drive, float(model.armature[k]), facts.drives.get(name, Drive()))
        for k, (name, drive) in enumerate(zip(names, drives, strict=True))
    )
    model.armature = np.array([actuator.rotor_inertia for actuator in actuators])
    if stated.gravity is not None:
        model.gravity = pin.Motion(np.array(stated.gravity), np.zeros(3))
    rows = list(range(model.nv) if chain is None else chain.active)
    soft = facts.soft_friction if chain is None else {}
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
        tolerance=Tolerance(stated.tolerance.inertia, stated.tolerance.friction, stated.tolerance.rotor_inertia),
        payload_frame=stated.payload_frame,
        warnings=(
            *_warnings(facts, stated, locked, chain, path),
            *body_warnings(model, facts, chain, path),
        ),
        locked=locked,
        chain=chain,
        soft_friction=tuple(soft.get(names[k]) for k in rows) if soft else (),
        gains_of_file=tuple(
            names[k]
            for k in rows
            if drives[k].controller is None and facts.drives.get(names[k], Drive()).kp is not None
        ),
        floating=stated.base == "floating",
        unmodelled=facts.unmodelled,
    )
