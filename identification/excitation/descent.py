"""Searches for a good motion within its limits: random motions, and a descent from the best one.

The random motions are about postures that keep all limits. The descent is an augmented Lagrangian method; each round is
an L-BFGS minimisation with exact derivatives.
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
"""Margin inside a bound, as a share of the bound's size. It is needed because motions peak between samples, and a round
ends slightly outside of the bounds."""
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
    """Cost of weights for a line search, defined even for weights with which a closed chain cannot be closed.

    Where the chain cannot be closed, the cost is that of a parabola along the line. The parabola has the cost and
    derivative of the start of the line, and its minimum at a quarter of the step, so that the line search tries this
    point next. With a very large cost instead, the line search would take a tiny step, and the descent would end.
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
            change = float(slope @ step)  # negative, because the cost decreases along the line at first
            return value - change, -3.0 * change / float(step @ step) * step
        return self._last[1:]

    def accept(self, _: Array) -> None:
        """Begin the next line at the last weights whose cost was computed."""
        self._begin = self._last

    @property
    def accepted(self) -> Array:
        """Weights at the end of the last complete line; the result of a minimiser that stops within a line is worse."""
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
    """Weights of a motion with a lower criterion, nearly within the limits.

    Args:
        problem: The design problem.
        grid: Samples at which criterion and limits are computed.
        weights: Start, shape ``(K, nv)``; a closed chain has to close along this motion.
        rounds: Number of rounds of multipliers.
        first: Number of the first round. The weight of excess grows with the number of the round: a descent with a high
            first number stays near the start.
        iterations: L-BFGS iterations per round.
        criterion: Criterion instead of the problem's; None for the problem's.
        progress: Called after each round.
    """
    from scipy.optimize import minimize

    sizes = joint_sizes(problem)
    # In these units, weights of all joints and shapes are of similar size.
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
        progress(Announcement(Stage.DESCENT, number + 1, rounds, {"cost": cost.value, "excess": excess}))
    return weights


POSTURES = 300
"""Number of random postures that are tried."""
SHARES = tuple(np.geomspace(1.0, 1e-3, 41).tolist())
"""Relative sizes of a motion about its posture that are tried in turn, in steps of 16 %."""
_DESCENTS = 6  # number of postures from which a descent starts if no random posture keeps the limits
# A grid with two samples and only the constant shape, for postures at rest.
_STILL = Grid(np.array([0.0, 1.0]), np.stack([np.ones((2, 1)), np.zeros((2, 1)), np.zeros((2, 1))]))


def standstill(q: Float[Array, "N nv"]) -> Motion:
    """Motion whose samples are independent postures, with zero velocity and acceleration."""
    return Motion(np.arange(float(len(q))), q, np.zeros_like(q), np.zeros_like(q))


def worst_excess(problem: DesignProblem, motion: Motion, margin: float = 0.0) -> Float[Array, " N"]:
    """Largest excess of each sample over the bounds, in units of the bounds' sizes, shape ``(N,)``; at most 0 inside.

    The bounds are narrowed by ``margin``. The excess is infinite if a closed chain cannot be closed along the motion.
    """
    try:
        values = problem.limited(motion, problem.regressor(motion))
    except ChainError:
        return np.full(len(motion.t), np.inf)
    return problem.bounds.inside(margin).excess(values).max(axis=(0, 2))


def posture_excess(problem: DesignProblem, q: Float[Array, "n nv"], margin: float) -> Float[Array, " n"]:
    """Largest excess over the bounds, as of `worst_excess`, of independent postures [rad or m] at rest."""
    if not solved_numerically(problem.robot):
        return worst_excess(problem, standstill(q), margin)
    return worst_excess(problem, standstill(with_start_between(problem.robot, q)), margin)[1::2]


def random_postures(problem: DesignProblem, rng: np.random.Generator) -> Float[Array, "n nv"]:
    """The middle of the joints' ranges, then random postures; for a closed chain only postures in which it closes."""
    sizes, robot = joint_sizes(problem), problem.robot
    spread = rng.uniform(-1.0, 1.0, (POSTURES, robot.nv))
    if solved_numerically(robot):
        # The random factor makes postures near the middle more frequent: the workspace of a linkage may be small.
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
        problem: The problem with the limits.
        grid: Samples at which limits are checked.
        posture: A posture that keeps the limits at rest [rad or m], shape ``(nv,)``.
        rng: Random numbers for the weights of the shapes and the relative speeds of the joints.
    """
    moving = random_weights(problem, grid, rng)
    still = constant_weights(posture, len(moving))
    return nearest_within_limits(problem, grid, still + moving, still)


def random_weights(problem: DesignProblem, grid: Grid, rng: np.random.Generator) -> Float[Array, "K nv"]:
    """Random weights with which each joint reaches a random share of its largest speed or acceleration.

    Args:
        problem: The problem with the limits; only those of single joints are used.
        grid: Samples at which limits are checked.
        rng: Random numbers for the weights and the shares.
    """
    moving = rng.normal(size=(grid.values.shape[2], problem.robot.nv))
    # The constant shape makes the mean position zero, so that the motion is about its posture.
    moving[0] = 0.0
    moving[0] = -(grid.values[0] @ moving).mean(axis=0)
    speed, acceleration = (np.abs(grid.values[k] @ moving).max(axis=0) for k in (1, 2))
    most = np.minimum(joint_sizes(problem).speed / speed, problem.limits.acceleration / acceleration)
    return moving * most * rng.uniform(0.3, 1.0, problem.robot.nv)


def nearest_within_limits(
    problem: DesignProblem,
    grid: Grid,
    weights: Float[Array, "K nv"],
    kept: Float[Array, "K nv"],
    shares: tuple[float, ...] = SHARES,
) -> Float[Array, "K nv"]:
    """The motion on the line from ``kept`` to ``weights`` that is nearest to ``weights`` and keeps all limits.

    If ``kept`` is a posture at rest, the result is the given motion, made smaller about this posture.

    Args:
        problem: The problem with the limits.
        grid: Samples at which limits are checked.
        weights: Weights of the given motion.
        kept: Weights of a motion that keeps the limits.
        shares: Places on the line that are tried in turn, from 1 at ``weights`` towards 0 at ``kept``.
    """
    for share in shares:
        between = kept + share * (weights - kept)
        if worst_excess(problem, grid.motion(between)).max() <= 0:
            return between
    return kept


@dataclass(frozen=True)
class AnyMotion:
    """A constant criterion, with which a descent only reduces the excess over the limits."""

    def cost(self, G: Float[Array, "r r"]) -> tuple[float, Float[Array, "r r"]]:
        """Zero, with zero derivative."""
        return 0.0, np.zeros_like(G)


def feasible_postures(problem: DesignProblem, rng: np.random.Generator) -> Float[Array, "n nv"]:
    """Postures in which the robot can stand still, with a margin to every limit.

    Raises:
        ParameterError: If there are no such postures. The message names the limit with the largest excess.
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
    # Only half of the margin is required, because a descent ends slightly outside of the narrowed bounds.
    excess = posture_excess(problem, found, 0.5 * MARGIN)
    if (excess <= 0).any():
        return found[excess <= 0]
    best = standstill(found[[int(np.argmin(excess))]])
    values = problem.limited(best, problem.regressor(best))
    raise ParameterError(
        f"No posture was found in which {problem.robot.name} can rest: in the best one {problem.bounds.worst(values)}; "
        "widen that limit, or another that prevents it."
    )
