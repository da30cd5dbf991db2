# pyright: reportAttributeAccessIssue=false
"""Modelled friction of every joint of a robot's tree, and the torque that the whole tree needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from phantom_dyn.closed_chain import TreeMotion
from phantom_dyn.robot import Robot

Array = np.ndarray


def tree_friction(robot: Robot) -> tuple[Float[Array, " nt"], Float[Array, " nt"]]:
    """Viscous coefficients and Coulomb torques of all joints of the tree, passive ones included."""
    viscous, coulomb = np.zeros(robot.model.nv), np.zeros(robot.model.nv)
    viscous[list(robot.tree_rows)], coulomb[list(robot.tree_rows)] = robot.viscous_friction, robot.coulomb_friction
    if robot.chain is not None:
        passive = list(robot.chain.passive)
        viscous[passive], coulomb[passive] = robot.chain.viscous_friction, robot.chain.coulomb_friction
    return viscous, coulomb


def tree_torque(robot: Robot, tree: TreeMotion) -> Float[Array, "N nt"]:
    """Torque [N m or N] on every joint of the tree, as if each had a drive: links, rotors and friction.

    Args:
        robot: Gives model and friction.
        tree: N samples.
    """
    viscous, coulomb = tree_friction(robot)
    data = robot.model.createData()
    rigid = [
        np.array(pin.rnea(robot.model, data, q, v, a))
        for q, v, a in zip(tree.configuration, tree.v, tree.a, strict=True)
    ]
    return np.reshape(rigid, tree.v.shape) + viscous * tree.v + coulomb * np.sign(tree.v)


def with_tree_friction(robot: Robot, viscous: Float[Array, " nt"], coulomb: Float[Array, " nt"]) -> Robot:
    """The robot with other friction on every joint of its tree."""
    active = list(robot.tree_rows)
    chain = robot.chain
    if chain is not None:
        passive = list(chain.passive)
        chain = replace(chain, viscous_friction=viscous[passive], coulomb_friction=coulomb[passive])
    return replace(robot, viscous_friction=viscous[active], coulomb_friction=coulomb[active], chain=chain)
