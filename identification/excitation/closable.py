"""Postures in which the loops of a closed chain can be closed, and their distance from a singularity.

Loops are closed along trajectories, and a linkage may be unable to move directly from one independent posture to the
next. So the start of the chain is inserted between them, and each posture is reached from there.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.loops.solver import closed_each, distance_from_singularity
from phantom_dyn.model.robot import Robot, tree_position_limits
from phantom_dyn.random_streams import random_stream

CLEAR = 0.25
"""Distance from a singularity that a designed motion keeps: that of a four-bar at a transmission angle of 20 degrees,
below which linkages are known to jam."""
_POSTURES = 100
"""Number of postures that represent the workspace of a chain."""
_DRAWN = 20
"""Draws per posture, as many of them cannot be used."""
_REACH = (np.pi, 0.5)
"""Largest distance of a drawn posture from the start, per joint [rad; m for linear joints]."""


def solved_numerically(robot: Robot) -> bool:
    """True if loops of the robot are closed numerically."""
    return robot.chain is not None and bool(robot.chain.anchors)


def closable(robot: Robot, q: Float[Array, "N nv"]) -> Bool[Array, " N"]:
    """True for postures [rad or m] in which the robot's loops close; all of them if none is closed numerically."""
    if not solved_numerically(robot):
        return np.ones(len(q), dtype=bool)
    return np.isfinite(_distances(robot, q))


def with_start_between(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "M nv"]:
    """A trajectory through postures [rad or m] that returns to the start of the chain before each of them."""
    out = np.empty((2 * len(q), robot.nv))
    out[0::2], out[1::2] = _start(robot), q
    return out


def ordinary_postures(robot: Robot, count: int = _POSTURES) -> Float[Array, "_ nv"]:
    """The start of a chain, then postures [rad or m] from its whole workspace, at most ``count``, shape ``(n, nv)``.

    They keep the limits of all joints and are clear of a singularity.

    Args:
        robot: A chain whose loops are closed numerically.
        count: Largest number of postures.
    """
    start, rng = _start(robot), random_stream("ordinary postures of a chain")
    reach = np.where(robot.prismatic, _REACH[1], _REACH[0])
    lower, upper = tree_position_limits(robot.model)
    rows, size = list(robot.tree_rows), (_DRAWN * count, robot.nv)
    # Half of the draws are less than half as far from the start, as the workspace of a linkage may be small.
    drawn = start + rng.uniform(size=(size[0], 1)) * rng.uniform(-reach, reach, size)
    drawn = np.clip(drawn, lower[rows], upper[rows])
    clear = drawn[_distances(robot, drawn) >= CLEAR][: 2 * count]
    tree = robot.solutions.at(with_start_between(robot, clear)).x[1::2]
    kept = clear[((lower <= tree) & (tree <= upper)).all(axis=1)]
    return np.concatenate([start[None], kept])[:count]


def configurations_in(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nq"]:
    """Pinocchio's configurations in postures [rad or m] that form no trajectory, shape ``(N, nq)``."""
    return robot.configuration(with_start_between(robot, q))[1::2]


def largest_slope(robot: Robot) -> Float[Array, "np nv"]:
    """Largest speed of each passive joint per speed of each active one, clear of a singularity."""
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
    """Distance of postures from a singularity, shape ``(N,)``; NaN where the loops do not close."""
    if robot.chain is None:
        return np.full(len(q), np.inf)
    return distance_from_singularity(closed_each(robot.model, robot.chain, q, robot.arrays))
