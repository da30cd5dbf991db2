"""Gains of many sets of columns, each added to one fit: the added columns are projected off those of the fit.

The gain of a set is the decrease of the loss when the set is added. To project a column off others means to subtract
the combination of the others that fits it best, so that the rest is orthogonal to them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from identification.engine.fits.problem import LinearProblem, Solution
from identification.engine.numerics.bounded import bounded_solve, solve, solve_each
from phantom_dyn.array_types import Float, Int

Array = np.ndarray


def gains_if_added(
    problem: LinearProblem, fitted: Solution, sets: Iterable[tuple[int, ...]]
) -> dict[tuple[int, ...], float]:
    """In-sample gain of each set of columns when it is added to a fit, to second order and within the set's bounds.

    Args:
        problem: The linear problem of the fit.
        fitted: The fit to which the sets are added.
        sets: Indices of the columns of each set.
    """
    inside = frozenset(fitted.active.tolist())
    added = {columns: tuple(k for k in columns if k not in inside) for columns in sets}
    wanted = np.array(sorted({k for own in added.values() for k in own}), dtype=int)
    cross, coefficients, gradient = project_off_fit(problem, fitted, wanted)
    a = problem.total_a
    gains = dict.fromkeys(added, 0.0)
    for size in {len(own) for own in added.values()} - {0}:
        # Sets of one size are stacked, so that only products within each set are computed.
        same_size = [columns for columns, own in added.items() if len(own) == size]
        own = np.array([added[columns] for columns in same_size])
        at = np.searchsorted(wanted, own)
        projection = cross[:, at].transpose(1, 2, 0) @ coefficients[:, at].transpose(1, 0, 2)
        projected = a[own[:, :, None], own[:, None, :]] - projection
        projected[:, np.arange(size), np.arange(size)] += problem.precision[own]
        found = gains_within(projected, gradient[at], problem.lower[own], problem.upper[own])
        gains.update(zip(same_size, found.tolist(), strict=True))
    return gains


def project_off_fit(
    problem: LinearProblem, fitted: Solution, columns: Int[Array, " m"]
) -> tuple[Float[Array, "f m"], Float[Array, "f m"], Float[Array, " m"]]:
    """Project columns off the free columns of a fit.

    Args:
        problem: The linear problem of the fit.
        fitted: The fit whose free columns are projected off.
        columns: Indices of the columns to project.

    Returns:
        cross: Products of the fit's free columns with the given columns. A column is free if its coefficient is not at
            a bound.
        coefficients: Coefficients of the projection: those of the free columns for each given column.
        gradient: Products of the projected columns with the residual of the fit.
    """
    active, theta = fitted.active, fitted.theta
    x = theta[active]
    free = active[(x > problem.lower[active] + 1e-12) & (x < problem.upper[active] - 1e-12)]
    a = problem.total_a
    cross = a[np.ix_(free, columns)]
    coefficients = solve(a[np.ix_(free, free)] + np.diag(problem.precision[free]), cross)
    gradient = problem.total_b - a[:, active] @ x
    free_gradient = gradient[free] - problem.precision[free] * theta[free]
    return cross, coefficients, gradient[columns] - coefficients.T @ free_gradient


def gains_within(
    a: Float[Array, "T k k"], b: Float[Array, "T k"], lower: Float[Array, "T k"], upper: Float[Array, "T k"]
) -> Float[Array, " T"]:
    """Gain of each set of columns: minus the minimum of ``x a x - 2 b x`` within bounds."""
    x = solve_each(a, b[:, :, None])[:, :, 0]
    outside = np.any((x < lower) | (x > upper), axis=1)
    if a.shape[1] == 1:
        x = np.clip(x, lower, upper)
    else:
        for k in np.flatnonzero(outside):
            x[k] = bounded_solve(a[k], b[k], lower[k], upper[k])
    return 2 * np.einsum("tk,tk->t", b, x) - np.einsum("tk,tkl,tl->t", x, a, x)


@dataclass(frozen=True)
class FoldProjection:
    """Projection of all columns off the nuisances, fitted without one fold.

    Attributes:
        problem: The linear problem.
        nuisance_products: Training products of the nuisances with all columns, ``(n, K)``.
        core: Products over the held-out samples, the cores of the fold's blocks: among the nuisances, and of the
            nuisances with all columns.
        coefficients: Coefficients of the projection: those of the nuisances for each column, ``(n, K)``.
    """

    problem: LinearProblem
    nuisance_products: Float[Array, "n K"]
    core: tuple[Float[Array, "n n"], Float[Array, "n K"]]
    coefficients: Float[Array, "n K"]

    @property
    def inner(self) -> Float[Array, "n n"]:
        """Training products of the nuisances with priors."""
        nuisances = self.problem.fitted_nuisances
        return self.nuisance_products[:, nuisances] + np.diag(self.problem.precision[nuisances])

    def training(self, columns: Int[Array, "g m"], square: Float[Array, "g m m"]) -> Float[Array, "g m m"]:
        """Training products among each group of columns projected off the nuisances, priors included.

        Args:
            columns: Indices of the columns of each group.
            square: Training products among the columns of each group, not projected.
        """
        coefficients, cross = _each(self.coefficients, columns), _each(self.nuisance_products, columns)
        return square - cross.mT @ coefficients + self.problem.precision[columns][:, :, None] * np.eye(columns.shape[1])

    def held_out(self, columns: Int[Array, "g m"], square: Float[Array, "g m m"]) -> Float[Array, "g m m"]:
        """Products over the held-out cores among each group of columns; the training fit gives the projection.

        Args:
            columns: Indices of the columns of each group.
            square: Products over the held-out cores among the columns of each group, not projected.
        """
        inside, across = self.core
        coefficients = _each(self.coefficients, columns)
        mixed = _each(across, columns).mT @ coefficients
        return square - mixed - mixed.mT + coefficients.mT @ inside @ coefficients


def fold_projections(problem: LinearProblem) -> tuple[FoldProjection, ...]:
    """The projections off the nuisances fitted without each fold, and last that of the fit to all training blocks."""
    grams, nuisances = problem.grams, problem.fitted_nuisances
    every = np.arange(len(problem.precision))
    of_folds, cores = (products.between(nuisances, every) for products in (grams.fold_a, grams.fold_core_a))
    nothing = np.zeros_like(of_folds[0])
    out = []
    for held_out, core in zip((*of_folds, nothing), (*cores, nothing), strict=True):
        nuisance_products = problem.total_a[nuisances] - held_out
        coefficients = solve(nuisance_products[:, nuisances] + np.diag(problem.precision[nuisances]), nuisance_products)
        out.append(FoldProjection(problem, nuisance_products, (core[:, nuisances], core), coefficients))
    return tuple(out)


def _each(rows: Float[Array, "n K"], columns: Int[Array, "g m"]) -> Float[Array, "g n m"]:
    """The columns of each group, stacked by group."""
    return rows[:, columns].transpose(1, 0, 2)
