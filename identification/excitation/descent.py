"""Descent to a good motion within its limits: an augmented Lagrangian, each round by L-BFGS with exact slopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.excitation.criteria import Criterion
from identification.excitation.design_problem import DesignProblem, Grid, joint_sizes
from identification.excitation.limited_quantities import Bounds
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Float
from phantom_dyn.errors import ChainError

Array = np.ndarray

MARGIN = 0.01
"""Share of a bound's size that is kept free: motions peak between samples, and a round ends a little outside."""
_FIRST, _GROWTH = 30.0, 3.0  # weight of the squared excess, and its growth from round to round
_OUT_OF_REACH = 1e8  # cost of a motion along which loops cannot be closed: above that of any other
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


def descend(
    problem: DesignProblem,
    grid: Grid,
    weights: Float[Array, "K nv"],
    *,
    rounds: int = 5,
    iterations: int = 40,
    criterion: Criterion | None = None,
    progress: Progress = lambda _: None,
) -> Float[Array, "K nv"]:
    """Weights of a motion that is better by the criterion, and about within the limits.

    Args:
        problem: What is designed.
        grid: Where the motion is looked at.
        weights: Start; of a chain one along which its loops can be closed.
        rounds: Of multipliers.
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
        penalty = Penalty(bounds, _FIRST * _GROWTH**number, multipliers)

        def cost(x: Array, penalty: Penalty = penalty) -> tuple[float, Array]:
            try:
                value, slope = problem.cost(grid, x.reshape(unit.shape) * unit, penalty, criterion)
            except ChainError:  # a step of the line search that is too long for the linkage
                return _OUT_OF_REACH, np.zeros_like(x)
            return value, (slope * unit).ravel()

        options = {"maxiter": iterations, "maxcor": _CORRECTIONS}
        found = minimize(cost, (weights / unit).ravel(), jac=True, method="L-BFGS-B", options=options)
        weights = found.x.reshape(unit.shape) * unit
        motion = grid.motion(weights)
        values = problem.limited(motion, problem.regressor(motion))
        multipliers = penalty.pushes(values)
        excess = max(0.0, float(penalty.bounds.excess(values).max()))
        progress(Announcement(Stage.DESCENT, number + 1, rounds, {"cost": float(found.fun), "excess": float(excess)}))
    return weights
