# pyright: reportAttributeAccessIssue=false
"""Decides which joints of a robot file are held at a fixed position, and fixes them in the model.

Joints that follow another joint become linear loops.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phantom_dyn.model.from_mjcf.mjcf import drawn_configuration
from phantom_dyn.model.robot_config import LinearLoop, RobotConfig
from phantom_dyn.model.robot_xml import RobotXml

# Suffix of renamed frames; it is unique because names in a robot file contain no line break.
_SUFFIX = "\n"
_BALLS = ("JointModelSpherical", "JointModelSphericalZYX")


def held_and_following(
    model: pin.Model, stated: RobotConfig, facts: RobotXml
) -> tuple[dict[str, float | None], list[LinearLoop]]:
    """Held joints with their positions (None for the drawn position), and a linear loop for each following joint.

    The joint of a floating base is held, too: the motion of the base is not a joint motion, but measured by sensors.

    Args:
        model: Model with all joints of the file.
        stated: Content of robot.yaml; joints in its loops are not considered.
        facts: Content of the robot file.
    """
    in_loops = {name for loop in stated.loops if isinstance(loop, LinearLoop) for name in (*loop.active, *loop.passive)}
    held: dict[str, float | None] = {}
    bases = moving_bases(model)
    for name in list(model.names)[1:]:
        of_base = name in bases or (name in facts.base_joints and name not in stated.joints)
        if name in stated.lock:
            held[name] = None if model.joints[model.getJointId(name)].nv > 1 else 0.0
        elif (stated.base is not None and of_base) or (name in facts.play and name not in stated.joints):
            held[name] = None
    following = {name: f for name, f in facts.followers.items() if name not in in_loops and name not in held}
    # Joints that follow a held joint are held, too, and so are joints that follow these.
    while True:
        also_held = [name for name, f in following.items() if f.leader is None or f.leader in held]
        if not also_held:
            break
        for name in also_held:
            law = following.pop(name)
            leader_position = 0.0 if law.leader is None else held[law.leader]
            held[name] = law.offset + law.factor * (leader_position or 0.0)
    loops = [
        LinearLoop(kind="linear", active=[law.leader], passive={name: f"{law.offset!r} + {law.factor!r}*{law.leader}"})
        for name, law in following.items()
        if law.leader is not None
    ]
    return held, loops


def hold(model: pin.Model, held: dict[str, float | None]) -> tuple[pin.Model, tuple[str, ...]]:
    """The model with some joints fixed, and the names of these joints.

    Args:
        model: Model with all joints.
        held: Position of each fixed joint [rad or m]; None for the drawn position.
    """
    if not held:
        return model, ()
    q, drawn = pin.neutral(model), drawn_configuration(model)
    for name, position in held.items():
        joint = model.joints[model.getJointId(name)]
        if position is None:
            q[joint.idx_q : joint.idx_q + joint.nq] = drawn[joint.idx_q : joint.idx_q + joint.nq]
        elif joint.nq == 1:
            q[joint.idx_q] = position
    names = [name for name in list(model.names)[1:] if name in held]
    return _reduced(model, [model.getJointId(name) for name in names], q), tuple(names)


def _reduced(model: pin.Model, held: list[int], q: np.ndarray) -> pin.Model:
    """Pinocchio's reduced model.

    Bodies with the name of a joint have another name during the reduction, because Pinocchio 4 fails on such bodies.
    """
    model = model.copy()
    joints = set(model.names)
    for frame in model.frames:
        if frame.type != pin.FrameType.JOINT and frame.name in joints:
            frame.name += _SUFFIX
    reduced = pin.buildReducedModel(model, held, q)
    for frame in reduced.frames:
        frame.name = frame.name.removesuffix(_SUFFIX)
    return reduced


def moving_bases(model: pin.Model) -> frozenset[str]:
    """Joints on the world with several velocities, which move a base; a ball joint only if it carries all others."""
    out = set()
    for k in range(1, model.njoints):
        carries_all = len(model.subtrees[k]) == model.njoints - 1
        if (
            model.parents[k] == 0
            and model.joints[k].nv > 1
            and (carries_all or model.joints[k].shortname() not in _BALLS)
        ):
            out.add(model.names[k])
    return frozenset(out)
