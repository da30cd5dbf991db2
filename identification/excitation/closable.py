"""Finds postures in which a closed chain can be closed, and their distance from a singularity.

A chain is closed along a trajectory, and it may be unable to move directly from one independent posture to the next. So
the start of the chain is inserted between them, and each posture is reached from there.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.loops.solver import closed_each, distance_from_singularity
from phantom_dyn.model.robot import Robot, tree_position_limits
from phantom_dyn.random_streams import random_stream

CLEAR = 0.25
"""Smallest distance from a singularity in a designed motion: that of a four-bar at a transmission angle of 20 degrees,
below which linkages may jam."""
_POSTURES = 100
"""Number of postures that represent the workspace of a chain."""
_DRAWS_PER_POSTURE = 20
"""Number of random postures per posture, as most of them cannot be used."""
_LARGEST_DRAW = (np.pi, 0.5)
"""Largest distance of a random posture from the start, per joint [rad; m for linear joints]."""


def solved_numerically(robot: Robot) -> bool:
    """True if the robot is a chain that is closed numerically."""
    return robot.chain is not None and bool(robot.chain.anchors)


def closable(robot: Robot, q: Float[Array, "N nv"]) -> Bool[Array, " N"]:
    """True for postures [rad or m] in which the robot's chain closes; all of them if it is not closed numerically."""
    if not solved_numerically(robot):
        return np.ones(len(q), dtype=bool)
    return np.isfinite(_distances(robot, q))


def with_start_between(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "M nv"]:
    """A trajectory through postures [rad or m] that returns to the start of the chain before each of them."""
    out = np.empty((2 * len(q), robot.nv))
    out[0::2], out[1::2] = _start(robot), q
    return out


def ordinary_postures(robot: Robot, count: int = _POSTURES) -> Float[Array, "_ nv"]:
    """The start of a chain, then random postures [rad or m] from its whole workspace, shape ``(n, nv)``.

    They keep the limits of all joints, and the distance `CLEAR` from a singularity.

    Args:
        robot: A chain that is closed numerically.
        count: Largest number of postures.
    """
    start, rng = _start(robot), random_stream("ordinary postures of a chain")
    reach = np.where(robot.prismatic, _LARGEST_DRAW[1], _LARGEST_DRAW[0])
    lower, upper = tree_position_limits(robot.model)
    rows, size = list(robot.tree_rows), (_DRAWS_PER_POSTURE * count, robot.nv)
    # Half of the draws are less than half as far from the start, as the workspace of a linkage may be small.
    drawn = start + rng.uniform(size=(size[0], 1)) * rng.uniform(-reach, reach, size)
    drawn = np.clip(drawn, lower[rows], upper[rows])
    clear = drawn[_distances(robot, drawn) >= CLEAR][: 2 * count]
    tree = robot.solutions.at(with_start_between(robot, clear)).x[1::2]
    kept = clear[((lower <= tree) & (tree <= upper)).all(axis=1)]
    return np.concatenate([start[None], kept])[:count]


def configurations_in(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nq"]:
    """Pinocchio's configurations in independent postures [rad or m], shape ``(N, nq)``."""
    return robot.configuration(with_start_between(robot, q))[1::2]


def largest_slope(robot: Robot) -> Float[Array, "np nv"]:
    """Largest speed of each passive joint per speed of each active joint, in postures away from a singularity."""
    chain = robot.chain
    if chain is None:
        return np.zeros((0, robot.nv))
    rows = list(chain.passive)
    if not chain.anchors:
        return np.abs(chain.linear_map[rows])
    slopes = robot.solutions.at(with_start_between(robot, ordinary_postures(robot))).G[:, rows]
    return np.abs(slopes).max(axis=0)


def _start(robot: Robot) -> Float[Array, " nv"]:
    return np.zeros(robot.nv) if robot.chain is None else robot.chain.start[list(robot.chain.active)]


def _distances(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, " N"]:
    """Distance of postures from a singularity, shape ``(N,)``; NaN if the chain does not close."""
    if robot.chain is None:
        return np.full(len(q), np.inf)
    return distance_from_singularity(closed_each(robot.model, robot.chain, q, robot.arrays))
