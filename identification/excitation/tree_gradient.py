r"""Converts a gradient with respect to the motion of all joints into one with respect to that of the active joints.

A closed chain is a tree of joints with loops: tree positions :math:`x(q)`, velocities :math:`v_t = G v` and
accelerations :math:`a_t = G a + d` follow from the active joints. If ``G`` is constant, the gradient is multiplied by
its transpose. If loops are solved numerically, ``G``, ``d`` and the distance from a singularity depend on the posture;
their derivatives are computed by central differences in each active joint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.excitation.closable import solved_numerically
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.tree_motion import TreeMotion, apply, project, tree_motion
from phantom_dyn.loops.solver import distance_from_singularity
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

_DIFFERENCE = 1e-5
"""Step of a central difference [rad or m]; loops are closed to 1e-11."""


@dataclass(frozen=True)
class TreeGradient:
    """Derivatives of a scalar with respect to the motion of the tree at N samples.

    Attributes:
        q: Derivatives by the positions, ``(N, nt)``.
        v: Derivatives by the velocities, ``(N, nt)``.
        a: Derivatives by the accelerations, ``(N, nt)``.
        G: Derivatives by ``G``, the Jacobian from active joints to the joints of the tree, ``(N, nt, nv)``.
        distance: Derivatives by the distance of the loops from a singularity, ``(N,)``.
    """

    q: Float[Array, "N nt"]
    v: Float[Array, "N nt"]
    a: Float[Array, "N nt"]
    G: Float[Array, "N nt nv"]
    distance: Float[Array, " N"]


def singularity_distance(robot: Robot, motion: Motion) -> Float[Array, "N c"]:
    """Distance of numerically solved loops from a singularity, as one column; no column for other robots."""
    if not solved_numerically(robot):
        return np.zeros((len(motion.q), 0))
    return distance_from_singularity(robot.solutions.at(motion.q).inverse)[:, None]


def gradient_of_active(
    robot: Robot, motion: Motion, tree: TreeMotion, gradient: TreeGradient
) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Derivatives with respect to positions, velocities and accelerations of the active joints, each ``(N, nv)``.

    Args:
        robot: The robot with its loops.
        motion: Motion of the active joints.
        tree: Motion of the tree.
        gradient: Derivatives with respect to the motion of the tree.

    Raises:
        ChainError: If loops cannot be closed or are singular next to a sample.
    """
    of_q, of_v, of_a = (project(tree.G, part) for part in (gradient.q, gradient.v, gradient.a))
    if not solved_numerically(robot):
        return of_q, of_v, of_a
    for joint in range(robot.nv):
        above, below = (_scalar_at(robot, motion, gradient, joint, sign * _DIFFERENCE) for sign in (1.0, -1.0))
        of_q[:, joint] += (above - below) / (2 * _DIFFERENCE)
        # The drift d is quadratic in the velocity, so that its central difference is exact.
        faster, slower = (_drift(robot, motion, joint, sign) for sign in (1.0, -1.0))
        of_v[:, joint] += 0.5 * (gradient.a * (faster - slower)).sum(axis=1)
    return of_q, of_v, of_a


def _scalar_at(robot: Robot, motion: Motion, gradient: TreeGradient, joint: int, step: float) -> Float[Array, " N"]:
    """Linearised scalar at each sample with one joint moved by a step, without the term of the tree positions ``x``."""
    q = np.array(motion.q)
    q[:, joint] += step
    shifted = replace(motion, q=q)
    tree = tree_motion(robot, shifted)
    value = (gradient.v * tree.v).sum(axis=1) + (gradient.a * tree.a).sum(axis=1)
    return (
        value + (gradient.G * tree.G).sum(axis=(1, 2)) + gradient.distance * singularity_distance(robot, shifted)[:, 0]
    )


def _drift(robot: Robot, motion: Motion, joint: int, change: float) -> Float[Array, "N nt"]:
    """Accelerations of the tree at zero acceleration of the active joints, with the velocity of one joint changed."""
    v = np.array(motion.v)
    v[:, joint] += change
    tree = tree_motion(robot, replace(motion, v=v))
    return tree.a - apply(tree.G, motion.a)
