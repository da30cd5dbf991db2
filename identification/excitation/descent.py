"""Descent to a good motion within its limits: an augmented Lagrangian, each round by L-BFGS with exact slopes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.excitation.criteria import Criterion
from identification.excitation.design_problem import DesignProblem, Grid, joint_sizes
from identification.excitation.limited_quantities import Bounds
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError

MARGIN = 0.01
"""Share of a bound's size that is kept free: motions peak between samples, and a round ends a little outside."""
_FIRST, _GROWTH = 30.0, 3.0  # weight of the squared excess, and its growth from round to round
_CORRECTIONS = 30  # pairs of steps and slopes that L-BFGS keeps


@dataclass(frozen=True)
class Penalty:
    """What excess over bounds costs: mean over samples of ``(max(0, multiplier + weight excess)^2) / (2 weight)``."""

    bounds: Bounds
    weight: float
    multipliers: Float[Array, "2 N m"]

    def __call__(self, values: Float[Array, "N m"]) -> tuple[float, Float[Array, "N m"]]:
        """Cost of values and its slope."""
        push = self.pushes(values)
        paid = 0.5 * float((push**2).sum() - (self.multipliers**2).sum()) / (self.weight * len(values))
        return paid, (push[1] - push[0]) / (self.bounds.size * len(values))

    def pushes(self, values: Float[Array, "N m"]) -> Float[Array, "2 N m"]:
        """What the multipliers become in the next round."""
        return np.maximum(0.0, self.multipliers + self.weight * self.bounds.excess(values))


class _Cost:
    """Cost of weights for a line search, which may step to where loops cannot be closed and no cost exists.

    There the cost is that of a parabola with the cost and slope at which the line begins, whose least value lies at a
    quarter of the step: the next trial is shorter by about that. A cost that is merely large would shorten the step to
    nothing, and end the descent.
    """

    def __init__(self, cost: Callable[[Array], tuple[float, Array]], x: Array):
        self._cost = cost
        self._begin = self._last = (x, *cost(x))

    def __call__(self, x: Array) -> tuple[float, Array]:
        """Cost and slope."""
        try:
            self._last = (x.copy(), *self._cost(x))
        except ChainError:
            begin, value, slope = self._begin
            step = x - begin
            fall = float(slope @ step)  # below zero: lines go downhill
            return value - fall, -3.0 * fall / float(step @ step) * step
        return self._last[1:]

    def accept(self, _: Array) -> None:
        """Begin the next line where the last cost was found."""
        self._begin = self._last

    @property
    def accepted(self) -> Array:
        """Where the last line ended; a minimiser that gives up within a line may return a worse place."""
        return self._begin[0]

    @property
    def value(self) -> float:
        """Cost there."""
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
    """Weights of a motion that is better by the criterion, and about within the limits.

    Args:
        problem: What is designed.
        grid: Samples at which criterion and limits are computed.
        weights: Start; of a chain one along which its loops can be closed.
        rounds: Of multipliers.
        first: Number of the first round: the weight of excess grows with it. A descent that only repairs a motion
            begins with a late one, and stays near.
        iterations: Of L-BFGS in each.
        criterion: In place of the problem's own.
        progress: Takes the stages.
    """
    from scipy.optimize import minimize

    sizes = joint_sizes(problem)
    # In units of what each joint may do, every weight is of about one size.
    unit = np.repeat(sizes.speed[None], len(weights), axis=0)
    unit[0] = sizes.half
    bounds = problem.bounds.inside(MARGIN)
    multipliers = np.zeros((2, len(grid.t), len(bounds.labels)))
    for number in range(rounds):
        penalty = Penalty(bounds, _FIRST * _GROWTH ** (first + number), multipliers)

        def of(x: Array, penalty: Penalty = penalty) -> tuple[float, Array]:
            value, slope = problem.cost(grid, x.reshape(unit.shape) * unit, penalty, criterion)
            return value, (slope * unit).ravel()

        x = (weights / unit).ravel()
        cost = _Cost(of, x)
        options = {"maxiter": iterations, "maxcor": _CORRECTIONS}
        minimize(cost, x, jac=True, method="L-BFGS-B", options=options, callback=cost.accept)
        weights = cost.accepted.reshape(unit.shape) * unit
        motion = grid.motion(weights)
        values = problem.limited(motion, problem.regressor(motion))
        multipliers = penalty.pushes(values)
        excess = max(0.0, float(penalty.bounds.excess(values).max()))
        progress(Announcement(Stage.DESCENT, number + 1, rounds, {"cost": cost.value, "excess": float(excess)}))
    return weights
