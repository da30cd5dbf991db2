# pyright: reportAttributeAccessIssue=false
"""From the loops that robot.yaml states to a `ClosedChain`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from phantom_dyn.errors import RobotError
from phantom_dyn.loops.chain import ClosedChain
from phantom_dyn.loops.expression import LinearExpression
from phantom_dyn.loops.linear import followed_joints
from phantom_dyn.robot_config import LinearLoop, RobotConfig

Array = np.ndarray


def closed_chain(model: pin.Model, stated: RobotConfig, config: Path) -> ClosedChain | None:
    """The closed chain of a tree, or None if no loop is stated.

    Args:
        model: The tree, without the joints that are held fixed; its friction is that of the joints.
        stated: Content of robot.yaml.
        config: The file, for messages.

    Raises:
        RobotError: If the loops contradict each other or do not say what every passive joint does.
    """
    followed = followed_joints(
        [(index, loop) for index, loop in enumerate(stated.loops) if isinstance(loop, LinearLoop)], config
    )
    if not followed:
        return None
    names = list(model.names)[1:]
    passive = tuple(k for k, name in enumerate(names) if name in followed)
    active = tuple(k for k, name in enumerate(names) if name not in followed)
    if not active:
        raise RobotError(f"{config}: loops leave no active joint: give at least one joint that is not passive.")
    linear_map, offset = _linear_map(names, followed, [names[k] for k in active])
    return ClosedChain(
        active=active,
        passive=passive,
        passive_names=tuple(names[k] for k in passive),
        unknowns=(),
        linear_map=linear_map,
        offset=offset,
        anchors=(),
        start=offset,
        viscous_friction=model.damping[list(passive)],
        coulomb_friction=model.upperDryFrictionLimit[list(passive)],
    )


def _linear_map(names: list[str], followed: dict[str, LinearExpression], free: list[str]) -> tuple[Array, Array]:
    """``S`` and ``o`` of `ClosedChain`, with the columns ``free``."""
    linear_map, offset = np.zeros((len(names), len(free))), np.zeros(len(names))
    for row, name in enumerate(names):
        expression = followed.get(name, LinearExpression(0.0, {name: 1.0}))
        offset[row] = expression.constant
        for joint, factor in expression.factors.items():
            linear_map[row, free.index(joint)] = factor
    return linear_map, offset
