# pyright: reportAttributeAccessIssue=false
"""Makes a `ClosedChain` from the loops that robot.yaml or the robot file state.

A joint is passive in two cases: a linear loop has an expression for it, or it is between the two frames of a point or
frame loop and not in the list ``active`` of this loop. Without this list, the joints without a drive are passive
(``actuated: false``; in MJCF also those without an actuator). Every other joint is active, with a drive or without.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array
from phantom_dyn.errors import RobotError
from phantom_dyn.loops.assembly import assembled, require_determined
from phantom_dyn.loops.chain import Anchor, ClosedChain
from phantom_dyn.model.linear_loops import LinearExpression, following_joints
from phantom_dyn.model.robot_config import FrameLoop, LinearLoop, PointLoop, RobotConfig


def closed_chain(
    model: pin.Model,
    stated: RobotConfig,
    config: Path,
    *,
    carried: dict[str, PointLoop | FrameLoop] | None = None,
    without_drive: frozenset[str] = frozenset(),
) -> ClosedChain | None:
    """The closed chain of a tree, or None if no loop is stated.

    Args:
        model: The tree, without the joints that are held fixed, with the friction of the joints.
        stated: Content of robot.yaml.
        config: The file, for messages.
        carried: Loops of the robot file itself, by their labels. Such a loop is ignored if a linear loop of robot.yaml
            has an expression for one of its joints.
        without_drive: Joints without an actuator in the robot file.

    Raises:
        RobotError: If the loops contradict each other, cannot be closed, or do not say what every passive joint does.
    """
    names = list(model.names)[1:]
    following = following_joints(
        [(index, loop) for index, loop in enumerate(stated.loops) if isinstance(loop, LinearLoop)], config
    )
    loops: dict[str, PointLoop | FrameLoop] = {
        f"loops[{index}] ({loop.frame_a} to {loop.frame_b})": loop
        for index, loop in enumerate(stated.loops)
        if not isinstance(loop, LinearLoop)
    }
    for label, loop in (carried or {}).items():
        if not following.keys() & set(_around(model, loop)):
            loops[label] = loop
    if not following and not loops:
        return None
    idle = without_drive | {name for name, joint in stated.joints.items() if not joint.actuated}
    unknown = _unknown_joints(model, loops, following, idle, config)
    passive = tuple(k for k, name in enumerate(names) if name in following or name in unknown)
    active = tuple(k for k, name in enumerate(names) if k not in passive)
    if not active:
        raise RobotError(f"{config}: the loops leave no active joint: give at least one joint that is not passive.")
    free = [*(names[k] for k in active), *unknown]
    linear_map, offset = _linear_map(names, following, free)
    start = {joint: position for loop in loops.values() for joint, position in (loop.start or {}).items()}
    chain = ClosedChain(
        active=active,
        passive=passive,
        passive_names=tuple(names[k] for k in passive),
        unknowns=tuple(names.index(name) for name in unknown),
        linear_map=linear_map,
        offset=offset,
        anchors=tuple(
            Anchor(label, loop.kind, frame_index(model, loop.frame_a), frame_index(model, loop.frame_b))
            for label, loop in loops.items()
        ),
        start=linear_map @ np.array([start.get(name, 0.0) for name in free]) + offset,
        viscous_friction=model.damping[list(passive)],
        coulomb_friction=model.upperDryFrictionLimit[list(passive)],
    )
    if not loops:
        return chain
    chain = assembled(model, chain, config)
    require_determined(model, chain, config)
    return chain


def frame_index(model: pin.Model, name: str) -> int:
    """Index of a frame; where a link and a joint have the same name, the link's."""
    found = [k for k, frame in enumerate(model.frames) if frame.name == name]
    links = [k for k in found if model.frames[k].type == pin.FrameType.BODY]
    return (links or found)[0]


def _unknown_joints(
    model: pin.Model,
    loops: dict[str, PointLoop | FrameLoop],
    following: dict[str, LinearExpression],
    idle: set[str] | frozenset[str],
    config: Path,
) -> tuple[str, ...]:
    """Passive joints without an expression, whose positions are solved for, in the tree's order."""
    unknown: set[str] = set()
    driven = {name for loop in loops.values() for name in (loop.active or ())}
    for label, loop in loops.items():
        around = _around(model, loop)
        if not around:
            raise RobotError(
                f"{config}: no joint moves one of the frames of {label} and not the other: give frames on two "
                "branches of the robot."
            )
        wrong = [name for name in loop.active or () if name not in around or name in following]
        if wrong:
            what = "passive in a linear loop" if wrong[0] in following else "not one of its joints"
            raise RobotError(
                f"{config}: {label} names {wrong[0]!r} as active, which is {what}: its joints are {', '.join(around)}."
            )
        passive = idle if loop.active is None else set(around) - driven
        mine = [name for name in around if name in passive and name not in following]
        if not mine:
            raise RobotError(
                f"{config}: {label} has no passive joint: of {', '.join(around)}, list the driven ones under active, "
                "or say actuated: false of the others."
            )
        unknown |= set(mine) - driven
    return tuple(name for name in list(model.names)[1:] if name in unknown)


def _around(model: pin.Model, loop: PointLoop | FrameLoop) -> tuple[str, ...]:
    """Joints of a loop: those that move one of its frames and not the other."""
    frames = (frame_index(model, name) for name in (loop.frame_a, loop.frame_b))
    a, b = (set(model.supports[model.frames[frame].parentJoint]) for frame in frames)
    return tuple(model.names[joint] for joint in sorted(a ^ b))


def _linear_map(names: list[str], following: dict[str, LinearExpression], free: list[str]) -> tuple[Array, Array]:
    """Matrix ``S`` and vector ``o`` of `ClosedChain`; the columns of ``S`` are the joints ``free``."""
    linear_map, offset = np.zeros((len(names), len(free))), np.zeros(len(names))
    for row, name in enumerate(names):
        expression = following.get(name, LinearExpression(0.0, {name: 1.0}))
        offset[row] = expression.constant
        for joint, factor in expression.factors.items():
            linear_map[row, free.index(joint)] = factor
    return linear_map, offset
