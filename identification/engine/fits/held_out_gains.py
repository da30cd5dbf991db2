"""Computes the held-out gain of many sets of columns on many residuals at once.

The gain of a set is the decrease of the held-out loss when the set is added to a fit of the nuisances. The residuals
are, for example, simulated noise: then the gains are those that columns reach by chance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.engine.fits.problem import LinearProblem
from identification.engine.fits.projection import fold_projections
from identification.engine.numerics.bounded import solve, solve_each
from phantom_dyn.array_types import Float, Int

Array = np.ndarray


def gains_on_residuals(
    problem: LinearProblem, sets: Sequence[tuple[int, ...]], b: Float[Array, "F K R"], core_b: Float[Array, "F K R"]
) -> Float[Array, "T R"]:
    """Held-out gain of each set of columns on each residual, ``(T, R)``, fitted with the nuisances; bounds are ignored.

    Args:
        problem: Products of the columns.
        sets: ``T`` sets of columns.
        b: Products of all columns with the ``R`` residuals over the whole blocks of each fold.
        core_b: Products of all columns with the residuals over the cores of the blocks of each fold.
    """
    nuisances = problem.fitted_nuisances
    right = b.sum(axis=0)
    by_size = [(which, columns, _squares(problem, columns)) for which, columns in _by_size(sets)]
    gains = np.zeros((len(sets), b.shape[2]))
    *folds, whole = fold_projections(problem)
    for fold, projection in enumerate(folds):
        training_b, held_out_b = right - b[fold], core_b[fold]
        nuisance_x = solve(projection.inner, training_b[nuisances])
        # Both become products of the columns projected off the nuisances; those of the cores with the residual of this
        # fit of the nuisances.
        coefficients, (inside, across) = projection.coefficients, projection.core
        training_b = training_b - coefficients.T @ training_b[nuisances]
        held_out_b = held_out_b - coefficients.T @ held_out_b[nuisances]
        held_out_b = held_out_b - (across.T - coefficients.T @ inside) @ nuisance_x
        for which, columns, (total, less, core) in by_size:
            x = solve_each(projection.training(columns, total - less[fold]), training_b[columns])
            gains[which] += (x * (2 * held_out_b[columns] - projection.held_out(columns, core[fold]) @ x)).sum(axis=1)
    # A set of columns also changes the prior penalty of the nuisances: the decrease is part of the gain.
    nuisance_x = solve(whole.inner, right[nuisances])
    whole_b = right - whole.coefficients.T @ right[nuisances]
    weighted = problem.precision[nuisances, None] * whole.coefficients
    penalty_slope = weighted.T @ nuisance_x
    for which, columns, (total, _, _) in by_size:
        own, own_weighted = (rows[:, columns].transpose(1, 0, 2) for rows in (whole.coefficients, weighted))
        x = solve_each(whole.training(columns, total), whole_b[columns])
        gains[which] += (x * (2 * penalty_slope[columns] - (own_weighted.mT @ own) @ x)).sum(axis=1)
    return gains


def _squares(problem: LinearProblem, columns: Int[Array, "g m"]) -> tuple[Array, Array, Array]:
    """Products among the columns of each group: over all training blocks, by fold, and by fold over the cores only."""
    grams = problem.grams
    total = problem.total_a[columns[:, :, None], columns[:, None, :]]
    return total, grams.fold_a.within(columns), grams.fold_core_a.within(columns)


def _by_size(sets: Sequence[tuple[int, ...]]) -> list[tuple[Int[Array, " g"], Int[Array, "g m"]]]:
    """Sets grouped by their number of columns: for each size, the indices of the sets and their columns."""
    sizes = np.array([len(columns) for columns in sets])
    groups = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    return [(which, np.array([sets[k] for k in which.tolist()])) for which in groups]
