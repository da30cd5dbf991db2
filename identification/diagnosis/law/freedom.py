"""What else may move when a law is added: the model within its tolerances, and the sizes of the findings.

A law that nobody modelled bends the moves and the findings of a fit that lacks it. So every fit of a law sets them free
again: on the row of its joint by their columns, held by their priors and by what the other joints' torques say of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.gap import sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.findings.bench import Shown
from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class Freedom:
    """Columns that every fit of a law has beside it, with a quadratic prior on their coefficients.

    The coefficients count from those of the shown fit.

    Attributes:
        columns: For each log, on the law's joint, in the judged band, ``(n, F)``.
        precision: Of the prior, in squares of the joint's torque, ``(F, F)``.
        right: Precision times the mean of the prior, ``(F,)``.
        lower, upper: Bounds, ``(F,)``.
    """

    columns: tuple[Float[Array, "n F"], ...]
    precision: Float[Array, "F F"]
    right: Float[Array, " F"]
    lower: Float[Array, " F"]
    upper: Float[Array, " F"]


def freedom_of(shown: Shown, row: int, floors: Float[Array, " nv"], residual: Series) -> Freedom:
    """What may move on one joint's row.

    Args:
        shown: The effects that are shown.
        row: The joint.
        floors: Noise floor of each joint.
        residual: What the named effects leave of each log's torque in the judged band.
    """
    problem, found = shown.problem, shown.found
    active = found.active
    precision = np.diag(problem.precision[active])
    right = -precision @ found.theta[active]
    for other, index in enumerate(problem.columns.rows):
        if other == row:
            continue
        place, at = _places(active, index)
        for k in range(len(residual)):
            weight = _seen_weights(problem, k)[:, other] / floors[other] ** 2
            x = problem.white.values[k][other][:, at]
            precision[np.ix_(place, place)] += (x * weight[:, None]).T @ x
            right[place] += x.T @ (weight * residual[k][:, other])
    place, at = _places(active, problem.columns.rows[row])
    rest = [k for k in range(len(active)) if k not in set(place)]
    own, others = precision[np.ix_(place, place)], precision[np.ix_(rest, rest)]
    if rest:
        between = precision[np.ix_(place, rest)]
        through = solve(others, np.column_stack([between.T, right[rest]]))
        own, mean = own - between @ through[:, :-1], right[place] - between @ through[:, -1]
    else:
        mean = right[place]
    columns = tuple(values[row][:, at] for values in problem.white.values)
    scale = floors[row] ** 2
    mine = active[place]
    lower, upper = problem.lower[mine] - found.theta[mine], problem.upper[mine] - found.theta[mine]
    return Freedom(columns, scale * own, scale * mean, np.minimum(lower, 0.0), np.maximum(upper, 0.0))


def _places(active: Array, index: tuple[int, ...]) -> tuple[list[int], list[int]]:
    """Which of the active columns touch a row, and where they stand among its columns."""
    stands = {column: k for k, column in enumerate(index)}
    place = [k for k, column in enumerate(active.tolist()) if column in stands]
    return place, [stands[int(active[k])] for k in place]


def _seen_weights(problem: Problem, log: int) -> Float[Array, "n nv"]:
    """What each sample of a log counts, zero where no fit may see it."""
    count = len(problem.columns.residual[log])
    weight = sample_weights(problem, log, slice(0, count))
    for block, fold in zip(problem.blocks, problem.grams.fold, strict=True):
        if block.log == log and fold < 0:
            weight[block.start : block.stop] = 0.0
    return weight
