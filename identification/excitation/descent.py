"""Searches for a good motion within its limits: random motions, and descent from them.

The random motions are about postures that keep all limits. The descent is an augmented Lagrangian method; each of its
rounds is L-BFGS with exact derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.excitation.closable import closable, ordinary_postures, solved_numerically, with_start_between
from identification.excitation.criteria import Criterion
from identification.excitation.design_problem import DesignProblem, Grid, joint_sizes
from identification.excitation.limits import Bounds
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError, ParameterError
from phantom_dyn.motion import Motion

MARGIN = 0.01
"""Margin inside a bound as a share of its size, as motions peak between samples, and rounds end slightly outside."""
_FIRST_WEIGHT, _GROWTH = 30.0, 3.0  # weight of the squared excess in the first round, and its growth per round
_CORRECTIONS = 30  # corrections that L-BFGS stores


@dataclass(frozen=True)
class Penalty:
    """Cost of excess over bounds: mean over samples of ``max(0, multiplier + weight excess)^2 / (2 weight)``."""

    bounds: Bounds
    weight: float
    multipliers: Float[Array, "2 N m"]

    def __call__(self, values: Float[Array, "N m"]) -> tuple[float, Float[Array, "N m"]]:
        """Cost of values, and its derivative."""
        updated = self.updated(values)
        cost = 0.5 * float((updated**2).sum() - (self.multipliers**2).sum()) / (self.weight * len(values))
        return cost, (updated[1] - updated[0]) / (self.bounds.size * len(values))

    def updated(self, values: Float[Array, "N m"]) -> Float[Array, "2 N m"]:
        """Multipliers of the next round."""
        return np.maximum(0.0, self.multipliers + self.weight * self.bounds.excess(values))


class _Cost:
    """Cost of weights for a line search, which may step to weights with which a chain cannot be closed.

    There the cost is replaced by a parabola. It has the cost and derivative of the start of the line, and its minimum
    at a quarter of the step, so that the next trial is there. A very large cost instead would shorten the step to
    almost nothing and end the descent.
    """

    def __init__(self, cost: Callable[[Array], tuple[float, Array]], x: Array):
        self._cost = cost
        self._begin = self._last = (x, *cost(x))

    def __call__(self, x: Array) -> tuple[float, Array]:
        """Cost and derivative."""
        try:
            self._last = (x.copy(), *self._cost(x))
        except ChainError:
            begin, value, slope = self._begin
            step = x - begin
            fall = float(slope @ step)  # negative, as the cost decreases along a line
            return value - fall, -3.0 * fall / float(step @ step) * step
        return self._last[1:]

    def accept(self, _: Array) -> None:
        """Begin the next line at the last weights whose cost was computed."""
        self._begin = self._last

    @property
    def accepted(self) -> Array:
        """Weights at the end of the last line; a minimiser that stops within a line may return worse ones."""
        return self._begin[0]

    @property
    def value(self) -> float:
        """Cost of the accepted weights."""
        return self._begin[1]


def descend(
    problem: DesignProblem,
    grid: Grid,
    weights: Float[Array, "K nv"],
    *,
    rounds: int = 5,
    first: int = 0,
    iterations: int = 40,
    criterion: Criterion | None = None,
    progress: Progress = lambda _: None,
) -> Float[Array, "K nv"]:
    """Weights of a motion with a better criterion, which is nearly within the limits.

    Args:
        problem: The design problem.
        grid: Samples at which criterion and limits are computed.
        weights: Start, shape ``(K, nv)``; a chain must close along it.
        rounds: Number of rounds of multipliers.
        first: Number of the first round, with which the weight of excess grows. A descent that begins with a late round
            stays near the start.
        iterations: L-BFGS iterations per round.
        criterion: Replaces the problem's own criterion.
        progress: Called after each round.
    """
    from scipy.optimize import minimize

    sizes = joint_sizes(problem)
    # In units of each joint's range, all weights are of similar size.
    unit = np.repeat(sizes.speed[None], len(weights), axis=0)
    unit[0] = sizes.half
    bounds = problem.bounds.inside(MARGIN)
    multipliers = np.zeros((2, len(grid.t), len(bounds.labels)))
    for number in range(rounds):
        penalty = Penalty(bounds, _FIRST_WEIGHT * _GROWTH ** (first + number), multipliers)

        def cost_of(x: Array, penalty: Penalty = penalty) -> tuple[float, Array]:
            value, slope = problem.cost(grid, x.reshape(unit.shape) * unit, penalty, criterion)
            return value, (slope * unit).ravel()

        x = (weights / unit).ravel()
        cost = _Cost(cost_of, x)
        options = {"maxiter": iterations, "maxcor": _CORRECTIONS}
        minimize(cost, x, jac=True, method="L-BFGS-B", options=options, callback=cost.accept)
        weights = cost.accepted.reshape(unit.shape) * unit
        motion = grid.motion(weights)
        values = problem.limited(motion, problem.regressor(motion))
        multipliers = penalty.updated(values)
        excess = max(0.0, float(penalty.bounds.excess(values).max()))
        progress(Announcement(Stage.DESCENT, number + 1, rounds, {"cost": cost.value, "excess": float(excess)}))
    return weights


POSTURES = 300
"""Number of random postures that are tried."""
SHARES = tuple(np.geomspace(1.0, 1e-3, 41).tolist())
"""Relative sizes of a motion about its posture that are tried, from the largest on, in steps of 16 %."""

_DESCENTS = 6  # number of postures from which a descent starts if none keeps the limits
# Two samples of a standstill, whose only shape is the constant one.
_STILL = Grid(np.array([0.0, 1.0]), np.stack([np.ones((2, 1)), np.zeros((2, 1)), np.zeros((2, 1))]))


def standstill(q: Float[Array, "N nv"]) -> Motion:
    """Postures as samples of a motion at standstill."""
    return Motion(np.arange(float(len(q))), q, np.zeros_like(q), np.zeros_like(q))


def worst_excess(problem: DesignProblem, motion: Motion, margin: float = 0.0) -> Float[Array, " N"]:
    """Largest excess of each sample over the bounds, in units of their sizes, shape ``(N,)``; at most 0 inside.

    The bounds are narrowed by the margin. The excess is infinite if a chain cannot be closed along the motion.
    """
    try:
        values = problem.limited(motion, problem.regressor(motion))
    except ChainError:
        return np.full(len(motion.t), np.inf)
    return problem.bounds.inside(margin).excess(values).max(axis=(0, 2))


def posture_excess(problem: DesignProblem, q: Float[Array, "n nv"], margin: float) -> Float[Array, " n"]:
    """As `worst_excess`, for independent postures [rad or m], which a chain reaches from its start."""
    if not solved_numerically(problem.robot):
        return worst_excess(problem, standstill(q), margin)
    return worst_excess(problem, standstill(with_start_between(problem.robot, q)), margin)[1::2]


def random_postures(problem: DesignProblem, rng: np.random.Generator) -> Float[Array, "n nv"]:
    """The middle of the joints' ranges, then random postures; for a chain only postures in which it closes."""
    sizes, robot = joint_sizes(problem), problem.robot
    spread = rng.uniform(-1.0, 1.0, (POSTURES, robot.nv))
    if solved_numerically(robot):
        # Half of the postures are less than half as far from the middle, as the workspace of a linkage may be small.
        spread = spread * rng.uniform(size=(POSTURES, 1))
        tried = np.concatenate([ordinary_postures(robot, 1), sizes.middle + spread * sizes.half])
        return tried[closable(robot, tried)]
    return sizes.middle + np.concatenate([np.zeros((1, robot.nv)), spread]) * sizes.half


def constant_weights(posture: Float[Array, " nv"], shapes: int) -> Float[Array, "K nv"]:
    """Weights of a motion that stays in a posture, shape ``(K, nv)``."""
    weights = np.zeros((shapes, len(posture)))
    weights[0] = posture
    return weights


def random_motion(
    problem: DesignProblem, grid: Grid, posture: Float[Array, " nv"], rng: np.random.Generator
) -> Float[Array, "K nv"]:
    """Weights of a random motion about a posture, as large as the limits allow, shape ``(K, nv)``.

    Args:
        problem: Gives the limits.
        grid: Samples at which limits are checked.
        posture: A posture that keeps the limits at rest [rad or m], shape ``(nv,)``.
        rng: Random numbers for the weights of the shapes and the relative speeds of the joints.
    """
    moving = random_weights(problem, grid, rng)
    return largest_within_limits(problem, grid, constant_weights(posture, len(moving)) + moving, posture)


def random_weights(problem: DesignProblem, grid: Grid, rng: np.random.Generator) -> Float[Array, "K nv"]:
    """Random weights with which each joint reaches a random share of its largest speed or acceleration.

    Args:
        problem: Gives the limits of each joint; other limits are not checked.
        grid: Samples at which limits are checked.
        rng: Random numbers for the weights and the shares.
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
    """The largest motion between a posture and the given motion that keeps all limits; else the posture."""
    return farthest_within_limits(problem, grid, weights, constant_weights(posture, len(weights)), shares)


def farthest_within_limits(
    problem: DesignProblem,
    grid: Grid,
    weights: Float[Array, "K nv"],
    kept: Float[Array, "K nv"],
    shares: tuple[float, ...] = SHARES,
) -> Float[Array, "K nv"]:
    """The motion nearest to the given one, on the line from ``kept`` to it, that keeps all limits; else ``kept``."""
    for share in shares:
        between = kept + share * (weights - kept)
        if worst_excess(problem, grid.motion(between)).max() <= 0:
            return between
    return kept


@dataclass(frozen=True)
class AnyMotion:
    """A criterion that is constant, so that a descent only reduces the excess over the limits."""

    def cost(self, G: Float[Array, "r r"]) -> tuple[float, Float[Array, "r r"]]:
        """Zero, with zero derivative."""
        return 0.0, np.zeros_like(G)


def feasible_postures(problem: DesignProblem, rng: np.random.Generator) -> Float[Array, "n nv"]:
    """Postures in which the robot can stand still, with a margin to every limit.

    Raises:
        ParameterError: If there are none. The message names the limit with the largest excess.
    """
    tried = random_postures(problem, rng)
    excess = posture_excess(problem, tried, MARGIN)
    if (excess <= 0).any():
        return tried[excess <= 0]
    candidates = [
        descend(problem, _STILL, posture[None], rounds=4, iterations=40, criterion=AnyMotion())
        for posture in tried[np.argsort(excess)[:_DESCENTS]]
    ]
    found = np.concatenate(candidates)
    # A descent ends slightly outside the margin.
    excess = posture_excess(problem, found, 0.5 * MARGIN)
    if (excess <= 0).any():
        return found[excess <= 0]
    best = standstill(found[[int(np.argmin(excess))]])
    values = problem.limited(best, problem.regressor(best))
    raise ParameterError(
        f"No posture was found in which {problem.robot.name} can rest: in the best one {problem.bounds.worst(values)}; "
        "widen that limit, or another that prevents it."
    )
