"""Where the design of an excitation begins: postures in which all limits are kept, and random motions about them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.excitation.closable import closable, ordinary_postures, solved_numerically, with_start_between
from identification.excitation.descent import MARGIN, descend
from identification.excitation.design_problem import DesignProblem, Grid, joint_sizes
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError, ParameterError
from phantom_dyn.motion import Motion

POSTURES = 300
"""Random postures that are tried."""
SHARES = tuple(np.geomspace(1.0, 1e-3, 41).tolist())
"""Sizes of a motion about its posture that are tried, the largest first, 16 per cent apart."""

_TRIED = 6  # postures from which a descent starts where none keeps the limits
# Two samples of a motion that is one posture: its only shape is the constant one.
_STILL = Grid(np.array([0.0, 1.0]), np.stack([np.ones((2, 1)), np.zeros((2, 1)), np.zeros((2, 1))]))


def standstill(q: Float[Array, "N nv"]) -> Motion:
    """Postures as samples of a motion at standstill."""
    return Motion(np.arange(float(len(q))), q, np.zeros_like(q), np.zeros_like(q))


def worst_excess(problem: DesignProblem, motion: Motion, margin: float = 0.0) -> Float[Array, " N"]:
    """How far each sample lies outside the bounds, narrowed by a margin, in units of their sizes; 0 or less: inside.

    Infinite for all samples where loops cannot be closed along the motion.
    """
    try:
        values = problem.limited(motion, problem.regressor(motion))
    except ChainError:
        return np.full(len(motion.t), np.inf)
    return problem.bounds.inside(margin).excess(values).max(axis=(0, 2))


def posture_excess(problem: DesignProblem, q: Float[Array, "n nv"], margin: float) -> Float[Array, " n"]:
    """As `worst_excess`, of postures [rad or m] that are no motion: each is reached from where a chain starts."""
    if not solved_numerically(problem.robot):
        return worst_excess(problem, standstill(q), margin)
    return worst_excess(problem, standstill(with_start_between(problem.robot, q)), margin)[1::2]


def random_postures(problem: DesignProblem, rng: np.random.Generator) -> Float[Array, "n nv"]:
    """The middle of the joints' ranges, then random postures; of a chain those in which its loops can be closed."""
    sizes, robot = joint_sizes(problem), problem.robot
    spread = rng.uniform(-1.0, 1.0, (POSTURES, robot.nv))
    if solved_numerically(robot):
        # Half of the postures are less than half as far from the middle: what a linkage reaches may be small.
        spread = spread * rng.uniform(size=(POSTURES, 1))
        tried = np.concatenate([ordinary_postures(robot, 1), sizes.middle + spread * sizes.half])
        return tried[closable(robot, tried)]
    return sizes.middle + np.concatenate([np.zeros((1, robot.nv)), spread]) * sizes.half


def constant_weights(posture: Float[Array, " nv"], shapes: int) -> Float[Array, "K nv"]:
    """Weights of a motion that stays in a posture."""
    weights = np.zeros((shapes, len(posture)))
    weights[0] = posture
    return weights


def random_motion(
    problem: DesignProblem, grid: Grid, posture: Float[Array, " nv"], rng: np.random.Generator
) -> Float[Array, "K nv"]:
    """Weights of a motion about a posture, random and as large as the limits let it be.

    Args:
        problem: Gives the limits.
        grid: Samples at which limits are checked.
        posture: One that keeps them at rest.
        rng: Draws normal weights of the shapes, and the speed of each joint relative to the others.
    """
    moving = random_weights(problem, grid, rng)
    return largest_within_limits(problem, grid, constant_weights(posture, len(moving)) + moving, posture)


def random_weights(problem: DesignProblem, grid: Grid, rng: np.random.Generator) -> Float[Array, "K nv"]:
    """Random weights about zero whose joints reach a random part of their largest speed, or of their acceleration.

    Args:
        problem: Gives the limits of each joint; no others are kept.
        grid: Samples at which limits are checked.
        rng: Draws the weights and the parts.
    """
    moving = rng.normal(size=(grid.values.shape[2], problem.robot.nv))
    moving[0] = 0.0
    moving[0] = -(grid.values[0] @ moving).mean(axis=0)
    speed, acceleration = (np.abs(grid.values[k] @ moving).max(axis=0) for k in (1, 2))
    most = np.minimum(joint_sizes(problem).speed / speed, problem.limits.acceleration / acceleration)
    return moving * most * rng.uniform(0.3, 1.0, problem.robot.nv)


def largest_within_limits(
    problem: DesignProblem,
    grid: Grid,
    weights: Float[Array, "K nv"],
    posture: Float[Array, " nv"],
    shares: tuple[float, ...] = SHARES,
) -> Float[Array, "K nv"]:
    """The largest motion between a posture and the given one that keeps all limits; the posture if none does."""
    return farthest_within_limits(problem, grid, weights, constant_weights(posture, len(weights)), shares)


def farthest_within_limits(
    problem: DesignProblem,
    grid: Grid,
    weights: Float[Array, "K nv"],
    kept: Float[Array, "K nv"],
    shares: tuple[float, ...] = SHARES,
) -> Float[Array, "K nv"]:
    """The motion nearest to the given one, on the way from ``kept`` to it, that keeps all limits; else ``kept``."""
    for share in shares:
        between = kept + share * (weights - kept)
        if worst_excess(problem, grid.motion(between)).max() <= 0:
            return between
    return kept


@dataclass(frozen=True)
class AnyMotion:
    """A criterion that is the same for every motion: a descent then only looks for the limits."""

    def cost(self, G: Float[Array, "r r"]) -> tuple[float, Float[Array, "r r"]]:
        """Zero, and no slope."""
        return 0.0, np.zeros_like(G)


def feasible_postures(problem: DesignProblem, rng: np.random.Generator) -> Float[Array, "n nv"]:
    """Postures in which the robot can stand still, at least one, with a margin to every limit.

    Raises:
        ParameterError: If none is found: the sentence names the limit that is broken most, and the excess over it.
    """
    tried = random_postures(problem, rng)
    excess = posture_excess(problem, tried, MARGIN)
    if (excess <= 0).any():
        return tried[excess <= 0]
    led = [
        descend(problem, _STILL, posture[None], rounds=4, iterations=40, criterion=AnyMotion())
        for posture in tried[np.argsort(excess)[:_TRIED]]
    ]
    found = np.concatenate(led)
    # A descent ends at the edge of the margin, from outside.
    excess = posture_excess(problem, found, 0.5 * MARGIN)
    if (excess <= 0).any():
        return found[excess <= 0]
    best = standstill(found[[int(np.argmin(excess))]])
    values = problem.limited(best, problem.regressor(best))
    raise ParameterError(
        f"{problem.robot.name} can rest in no posture that was found: in the best one {problem.bounds.worst(values)}; "
        "widen that limit, or another that prevents it."
    )
