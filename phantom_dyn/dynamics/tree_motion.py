# pyright: reportAttributeAccessIssue=false
r"""Motion of the tree of a closed chain from that of its active joints, and projection of its torques on them.

With :math:`v_t = G(q)\,v` and :math:`a_t = G\,a + d(q, v)`, virtual work gives :math:`\tau = G^T \tau_t` for every
torque on the tree, so also :math:`W = G^T W_t` for a regressor and :math:`M = G^T M_t G`.
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
    """``N`` samples of the motion of every joint of a robot's tree; of a plain robot its own, with ``G`` the identity.

    Attributes:
        configuration: Pinocchio's configurations, shape ``(N, nq)``.
        q: Joint positions [rad or m], shape ``(N, nt)``.
        v: Velocities, shape ``(N, nt)``.
        a: Accelerations, shape ``(N, nt)``.
        G: Slope of the tree's positions in the active ones, shape ``(N, nt, nv)``; read-only, the same memory for
            every sample where it is constant.
        base: How the root moves; None for a robot that is bolted down.
    """

    configuration: Float[Array, "N nq"]
    q: Float[Array, "N nt"]
    v: Float[Array, "N nt"]
    a: Float[Array, "N nt"]
    G: Float[Array, "N nt nv"]
    base: BaseMotion | None = None


def tree_motion(robot: Robot, motion: Motion, *, near: Float[Array, " nt"] | None = None) -> TreeMotion:
    """Motion of the whole tree while the active joints move as given.

    Args:
        robot: A closed chain or a plain robot.
        motion: N samples of the active joints.
        near: Positions of the tree that close its loops, from which the search for the first sample begins, as in a
            simulation that asks state by state; by default where the chain starts.

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


def apply(G: Float[Array, "N nt nv"], values: Float[Array, "N nv"]) -> Float[Array, "N nt"]:
    """``G`` times a vector for each sample."""
    return np.einsum("nti,ni->nt", G, values) if _varies(G) else values @ G[0].T


def project(G: Float[Array, "N nt nv"], values: Float[Array, "N nt *k"]) -> Float[Array, "N nv *k"]:
    """``G^T`` times torques, or columns of torques, of the tree for each sample: what they are on the active joints."""
    if _varies(G):
        return np.einsum("nti,nt...->ni...", G, values, optimize=True)
    return values @ G[0] if values.ndim == 2 else G[0].T @ values


def _varies(G: Array) -> bool:
    """False if the same matrix holds for every sample."""
    return len(G) == 0 or G.strides[0] != 0


def joint_velocity(robot: Robot, motion: Motion, joint: str) -> tuple[Float[Array, " N"], Float[Array, "N nv"]]:
    """Velocity of an active or passive joint, and the torque on the active ones per unit of torque on it.

    Args:
        robot: Gives the joints.
        motion: N samples of the active joints.
        joint: Any joint of the tree that is not held fixed.

    Returns:
        Velocity [rad/s or m/s], and its row of ``G``: the torque on each active joint per unit of torque on this one.

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
    """Torque on the active joints that the modelled friction of the passive ones needs, ``sign(0) = 0``."""
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
