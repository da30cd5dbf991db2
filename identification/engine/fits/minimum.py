"""Fits some columns by least squares with priors and bounds, to all blocks and once without each fold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.engine.numerics.bounded import bounded_solve, bounded_solve_without
from phantom_dyn.array_types import Float

Array = np.ndarray


class Minimum(NamedTuple):
    """Coefficients of a fit.

    Attributes:
        x: Coefficients of the fit to all training blocks, ``(k,)``.
        objective: Sum of squares of that fit, plus the penalties of the priors.
        without: Coefficients of the fit without each fold, ``(F, k)``; ``(0, k)`` if nothing is held out.
    """

    x: Float[Array, " k"]
    objective: float
    without: Float[Array, "F k"]


def minimum_of(
    square: Float[Array, "k k"],
    line: Float[Array, " k"],
    total: float,
    precision: Float[Array, " k"],
    bounds: tuple[Float[Array, " k"], Float[Array, " k"]],
    near: Float[Array, " k"],
    folds: tuple[Float[Array, "F k k"], Float[Array, "F k"]] | None = None,
) -> Minimum:
    """The least-squares fit of some columns with priors about zero, within bounds.

    Args:
        square: Columns times columns over the training blocks.
        line: Columns times residual.
        total: Residual times residual.
        precision: Prior precision of each coefficient about zero.
        bounds: Least and largest value of each coefficient.
        near: Coefficients of a similar fit, whose active bounds are tried first; NaN where there is no such value.
        folds: ``square`` and ``line`` of each fold, which are held out in turn; None to hold out nothing.
    """
    with_prior = square.copy()
    with_prior.flat[:: len(with_prior) + 1] += precision
    x = bounded_solve(with_prior, line, *bounds, near=near)
    objective = float(total - 2 * line @ x + x @ square @ x + precision @ x**2)
    without = np.zeros((0, len(x))) if folds is None else bounded_solve_without(with_prior, line, *folds, *bounds, x)
    return Minimum(x, objective, without)
