# pyright: reportAttributeAccessIssue=false
r"""Motion of all joints of a closed chain from the active joints, and projection of torques on the active joints.

The tree is the chain with its loops cut; its positions, velocities and torques have the index :math:`t`. With
:math:`v_t = G(q)\,v` and :math:`a_t = G\,a + d(q, v)`, virtual work gives :math:`\tau = G^T \tau_t` for every torque on
the tree, so also :math:`W = G^T W_t` for a regressor and :math:`M = G^T M_t G` for a mass matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import RobotError, known_names
from phantom_dyn.loops.solver import drift, solve
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion, Motion, configurations


@dataclass(frozen=True)
class TreeMotion:
    """``N`` samples of the motion of every joint of a robot's tree; without loops, ``G`` is the identity.

    Attributes:
        configuration: Pinocchio's configurations, shape ``(N, nq)``.
        q: Joint positions [rad or m], shape ``(N, nt)``.
        v: Velocities, shape ``(N, nt)``.
        a: Accelerations, shape ``(N, nt)``.
        G: Derivative of the tree's positions by the active ones, shape ``(N, nt, nv)``, read-only. If it is constant,
            all samples share one matrix in memory.
        base: Motion of the root; None for a robot that is bolted down.
    """

    configuration: Float[Array, "N nq"]
    q: Float[Array, "N nt"]
    v: Float[Array, "N nt"]
    a: Float[Array, "N nt"]
    G: Float[Array, "N nt nv"]
    base: BaseMotion | None = None


def tree_motion(robot: Robot, motion: Motion, *, near: Float[Array, " nt"] | None = None) -> TreeMotion:
    """Motion of the whole tree for a motion of the active joints.

    Args:
        robot: The robot.
        motion: N samples of the active joints.
        near: Positions of the tree that close its loops, from which the search for the first sample starts; by default
            the stated start of the chain. Simulations, which need one state at a time, give those of the last state.

    Raises:
        ChainError: If a loop cannot be closed or is singular at a sample.
    """
    if robot.chain is None:
        G = np.broadcast_to(np.eye(robot.nv), (len(motion.q), robot.nv, robot.nv))
        return TreeMotion(robot.configuration(motion.q), motion.q, motion.v, motion.a, G, motion.base)
    if near is None:
        found = robot.solutions.at(motion.q)
    else:
        found = solve(robot.model, robot.chain, motion.q, near, arrays=robot.arrays)
    v = apply(found.G, motion.v)
    a = apply(found.G, motion.a) + drift(robot.model, robot.chain, found, v, arrays=robot.arrays)
    return TreeMotion(configurations(robot.model, found.x), found.x, v, a, found.G, motion.base)


def tree_at_rest(robot: Robot, q: Float[Array, "N nv"], *, near: Float[Array, " nt"] | None = None) -> TreeMotion:
    """The tree at rest at N positions ``q`` of the active joints [rad or m]; ``near`` as in `tree_motion`."""
    zeros = np.zeros_like(q)
    return tree_motion(robot, Motion(np.arange(float(len(q))), q, zeros, zeros), near=near)


def apply(G: Float[Array, "N nt nv"], values: Float[Array, "N nv"]) -> Float[Array, "N nt"]:
    """``G`` times a vector of the active joints, for each sample."""
    return np.einsum("nti,ni->nt", G, values) if _varies(G) else values @ G[0].T


def project(G: Float[Array, "N nt nv"], values: Float[Array, "N nt *k"]) -> Float[Array, "N nv *k"]:
    """``G^T`` times torques (or columns of torques) on the tree, for each sample: the torques on the active joints."""
    if _varies(G):
        return np.einsum("nti,nt...->ni...", G, values, optimize=True)
    return values @ G[0] if values.ndim == 2 else G[0].T @ values


def _varies(G: Array) -> bool:
    """False if all samples share one matrix in memory."""
    return len(G) == 0 or G.strides[0] != 0


def joint_velocity(robot: Robot, motion: Motion, joint: str) -> tuple[Float[Array, " N"], Float[Array, "N nv"]]:
    """Velocity of an active or passive joint, and the torque on the active joints per unit of torque on this joint.

    Args:
        robot: The robot.
        motion: N samples of the active joints.
        joint: Name of a joint of the tree that is not held fixed.

    Returns:
        Velocity [rad/s or m/s], shape ``(N,)``, and the row of ``G`` of this joint, shape ``(N, nv)``.

    Raises:
        RobotError: If the robot has no such joint.
        ChainError: If a loop cannot be closed or is singular at a sample.
    """
    if joint in robot.joint_names:
        index = robot.joint_names.index(joint)
        return motion.v[:, index], np.broadcast_to(np.eye(robot.nv)[index], (len(motion.q), robot.nv))
    if robot.chain is None or joint not in robot.passive_names:
        known = [*robot.joint_names, *robot.passive_names]
        raise RobotError(f"{robot.name} has no joint {joint!r}: {known_names(joint, known, 'joints')}")
    row = robot.chain.passive[robot.passive_names.index(joint)]
    tree = tree_motion(robot, motion)
    return tree.v[:, row], tree.G[:, row, :]


def passive_friction(robot: Robot, tree: TreeMotion) -> Float[Array, "N nv"]:
    """Torque on the active joints against the modelled friction of the passive ones, with ``sign(0) = 0``."""
    chain = robot.chain
    if chain is None or not (chain.viscous_friction.any() or chain.coulomb_friction.any()):
        return np.zeros((len(tree.v), robot.nv))
    rows = list(chain.passive)
    v = tree.v[:, rows]
    return project(tree.G[:, rows, :], chain.viscous_friction * v + chain.coulomb_friction * np.sign(v))


def tree_friction(robot: Robot) -> tuple[Float[Array, " nt"], Float[Array, " nt"]]:
    """Viscous coefficients and Coulomb torques of all joints of the tree, passive ones included."""
    viscous, coulomb = np.zeros(robot.model.nv), np.zeros(robot.model.nv)
    viscous[list(robot.tree_rows)], coulomb[list(robot.tree_rows)] = robot.viscous_friction, robot.coulomb_friction
    if robot.chain is not None:
        passive = list(robot.chain.passive)
        viscous[passive], coulomb[passive] = robot.chain.viscous_friction, robot.chain.coulomb_friction
    return viscous, coulomb
