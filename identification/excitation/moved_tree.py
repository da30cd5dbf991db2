r"""How a scalar of the motion of a chain's tree depends on the motion of its active joints.

With :math:`x(q)`, :math:`v_t = G v` and :math:`a_t = G a + d`, slopes in the tree's motion are pulled back through the
loops. Where ``G`` is constant that is a product with it; where loops are closed numerically ``G``, ``d`` and the
distance from a singularity change with the posture, which central differences in each active joint show.
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
    """Slopes of a scalar in what the tree does at N samples.

    Attributes:
        q: In its positions, ``(N, nt)``.
        v: In its velocities.
        a: In its accelerations.
        G: In the slope of its positions in the active ones, ``(N, nt, nv)``.
        clear: In the distance of the loops from a singularity, ``(N,)``.
    """

    q: Float[Array, "N nt"]
    v: Float[Array, "N nt"]
    a: Float[Array, "N nt"]
    G: Float[Array, "N nt nv"]
    clear: Float[Array, " N"]


def clear_of(robot: Robot, motion: Motion) -> Float[Array, "N c"]:
    """Distance of loops that are closed numerically from a singularity, one column; without such loops none."""
    if not solved_numerically(robot):
        return np.zeros((len(motion.q), 0))
    return distance_from_singularity(robot.solutions.at(motion.q).inverse)[:, None]


def pulled_to_active(
    robot: Robot, motion: Motion, tree: TreeMotion, pulls: TreePulls
) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"], Float[Array, "N nv"]]:
    """The slopes in positions, velocities and accelerations of the active joints.

    Args:
        robot: Gives the loops.
        motion: Of the active joints.
        tree: That of the tree.
        pulls: Slopes in the latter.

    Raises:
        ChainError: If a loop cannot be closed or is singular next to a sample.
    """
    of_q, of_v, of_a = (project(tree.G, pull) for pull in (pulls.q, pulls.v, pulls.a))
    if not solved_numerically(robot):
        return of_q, of_v, of_a
    for joint in range(robot.nv):
        beside = _both_sides(robot, motion, pulls, joint)
        of_q[:, joint] += (beside[0] - beside[1]) / (2 * _DIFFERENCE)
        # The drift is quadratic in the velocity: its difference is exact.
        faster, slower = (_drift(robot, motion, joint, sign) for sign in (1.0, -1.0))
        of_v[:, joint] += 0.5 * (pulls.a * (faster - slower)).sum(axis=1)
    return of_q, of_v, of_a


def _both_sides(robot: Robot, motion: Motion, pulls: TreePulls, joint: int) -> list[Float[Array, " N"]]:
    """What depends on the posture beside that of the tree itself, a step ahead and a step behind."""
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
    """Accelerations of the tree without those of the active joints, one of which is faster."""
    v = np.array(motion.v)
    v[:, joint] += more
    tree = tree_motion(robot, replace(motion, v=v))
    return tree.a - apply(tree.G, motion.a)
