r"""Slopes of a scalar in the motion of a chain's tree, converted to slopes in the motion of its active joints.

With :math:`x(q)`, :math:`v_t = G v` and :math:`a_t = G a + d`, slopes in the tree's motion are pulled back through the
loops. If ``G`` is constant this is a product with it. If loops are closed numerically, ``G``, ``d`` and the distance
from a singularity change with the posture, which is computed by central differences in each active joint.
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
"""Step of a central difference [rad or m]: loops are closed to 1e-11."""


@dataclass(frozen=True)
class TreePulls:
    """Slopes of a scalar in the motion of the tree at N samples.

    Attributes:
        q: Slope in the positions, ``(N, nt)``.
        v: Slope in the velocities, ``(N, nt)``.
        a: Slope in the accelerations, ``(N, nt)``.
        G: Slope in ``G``, the derivative of its positions by the active ones, ``(N, nt, nv)``.
        clear: Slope in the distance of the loops from a singularity, ``(N,)``.
    """

    q: Float[Array, "N nt"]
    v: Float[Array, "N nt"]
    a: Float[Array, "N nt"]
    G: Float[Array, "N nt nv"]
    clear: Float[Array, " N"]


def clear_of(robot: Robot, motion: Motion) -> Float[Array, "N c"]:
    """Distance of numerically closed loops from a singularity, as one column; no column without such loops."""
    if not solved_numerically(robot):
        return np.zeros((len(motion.q), 0))
    return distance_from_singularity(robot.solutions.at(motion.q).inverse)[:, None]


def pulled_to_active(
    robot: Robot, motion: Motion, tree: TreeMotion, pulls: TreePulls
) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Slopes in positions, velocities and accelerations of the active joints, each ``(N, nv)``.

    Args:
        robot: Gives the loops.
        motion: Motion of the active joints.
        tree: Motion of the tree.
        pulls: Slopes in the motion of the tree.

    Raises:
        ChainError: If a loop cannot be closed or is singular next to a sample.
    """
    of_q, of_v, of_a = (project(tree.G, pull) for pull in (pulls.q, pulls.v, pulls.a))
    if not solved_numerically(robot):
        return of_q, of_v, of_a
    for joint in range(robot.nv):
        beside = _both_sides(robot, motion, pulls, joint)
        of_q[:, joint] += (beside[0] - beside[1]) / (2 * _DIFFERENCE)
        # The drift is quadratic in the velocity, so that its central difference is exact.
        faster, slower = (_drift(robot, motion, joint, sign) for sign in (1.0, -1.0))
        of_v[:, joint] += 0.5 * (pulls.a * (faster - slower)).sum(axis=1)
    return of_q, of_v, of_a


def _both_sides(robot: Robot, motion: Motion, pulls: TreePulls, joint: int) -> list[Float[Array, " N"]]:
    """The scalar's dependence on the posture through velocities, accelerations, G and distance, a step to each side."""
    out = []
    for sign in (1.0, -1.0):
        q = np.array(motion.q)
        q[:, joint] += sign * _DIFFERENCE
        there = replace(motion, q=q)
        tree = tree_motion(robot, there)
        value = (pulls.v * tree.v).sum(axis=1) + (pulls.a * tree.a).sum(axis=1)
        value += (pulls.G * tree.G).sum(axis=(1, 2)) + pulls.clear * clear_of(robot, there)[:, 0]
        out.append(value)
    return out


def _drift(robot: Robot, motion: Motion, joint: int, more: float) -> Float[Array, "N nt"]:
    """Accelerations of the tree at zero acceleration of the active joints, with one joint faster by ``more``."""
    v = np.array(motion.v)
    v[:, joint] += more
    tree = tree_motion(robot, replace(motion, v=v))
    return tree.a - apply(tree.G, motion.a)
