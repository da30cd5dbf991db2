"""Finds postures in which the loops of a closed chain can be closed, and their distance from a singularity.

The loops are closed along a trajectory: each solution starts at the previous posture. Between two independent postures
this may fail. Therefore the start posture of the chain is inserted between them, and each posture is reached from it.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.loops.solver import closed_each, distance_from_singularity
from phantom_dyn.model.robot import Robot, tree_position_limits
from phantom_dyn.random_streams import random_stream

CLEAR = 0.25
"""Smallest distance from a singularity in a designed motion: that of a four-bar linkage at a transmission angle of 20
degrees. At smaller angles linkages may jam."""
_POSTURES = 100
"""Number of postures that represent the workspace of a chain."""
_DRAWS_PER_POSTURE = 20
"""Number of random draws for each wanted posture; most draws cannot be used."""
_LARGEST_DRAW = (np.pi, 0.5)
"""Largest distance of a random posture from the start, per joint [rad; m for linear joints]."""


def solved_numerically(robot: Robot) -> bool:
    """True if the robot is a closed chain whose loops are solved numerically, not by formulas."""
    return robot.chain is not None and bool(robot.chain.anchors)


def closable(robot: Robot, q: Float[Array, "N nv"]) -> Bool[Array, " N"]:
    """True for postures [rad or m] in which the robot's loops close; without numerically solved loops always True."""
    if not solved_numerically(robot):
        return np.ones(len(q), dtype=bool)
    return np.isfinite(_distances(robot, q))


def with_start_between(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "M nv"]:
    """A trajectory through postures [rad or m] that returns to the start of the chain before each of them."""
    out = np.empty((2 * len(q), robot.nv))
    out[0::2], out[1::2] = _start(robot), q
    return out


def ordinary_postures(robot: Robot, count: int = _POSTURES) -> Float[Array, "_ nv"]:
    """The start posture of a chain, then random postures [rad or m] from its whole workspace, shape ``(n, nv)``.

    The postures keep the limits of all joints, and the distance `CLEAR` from a singularity.

    Args:
        robot: A closed chain whose loops are solved numerically.
        count: Largest number of postures.
    """
    start, rng = _start(robot), random_stream("ordinary postures of a chain")
    reach = np.where(robot.prismatic, _LARGEST_DRAW[1], _LARGEST_DRAW[0])
    lower, upper = tree_position_limits(robot.model)
    rows, size = list(robot.tree_rows), (_DRAWS_PER_POSTURE * count, robot.nv)
    # The random factor makes draws near the start more frequent, because the workspace of a linkage may be small.
    drawn = start + rng.uniform(size=(size[0], 1)) * rng.uniform(-reach, reach, size)
    drawn = np.clip(drawn, lower[rows], upper[rows])
    clear = drawn[_distances(robot, drawn) >= CLEAR][: 2 * count]
    tree = robot.solutions.at(with_start_between(robot, clear)).x[1::2]
    kept = clear[((lower <= tree) & (tree <= upper)).all(axis=1)]
    return np.concatenate([start[None], kept])[:count]


def configurations_in(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nq"]:
    """Pinocchio's configurations of independent postures [rad or m], shape ``(N, nq)``."""
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
    """Start posture of a chain [rad or m]; zeros for a robot without loops."""
    return np.zeros(robot.nv) if robot.chain is None else robot.chain.start[list(robot.chain.active)]


def _distances(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, " N"]:
    """Distance of postures from a singularity, shape ``(N,)``; NaN if the chain does not close."""
    if robot.chain is None:
        return np.full(len(q), np.inf)
    return distance_from_singularity(closed_each(robot.model, robot.chain, q, robot.arrays))
