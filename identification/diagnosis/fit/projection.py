"""In-sample gain of every rival beside a fit, all rivals at once: their columns projected off those of the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.model.terms import Term
from identification.diagnosis.numerics.bounded import bounded_solve, solve

Array = np.ndarray


@dataclass(frozen=True)
class Beside:
    """Columns of each rival with their projection on the fit removed.

    Attributes:
        gains: How much the columns of each rival lower the loss in sample, to second order, bounds kept.
        b: Products of what is left of all columns with the residual of the fit, ``(K,)``.
        active: Columns of the fit.
    """

    gains: dict[tuple[int, ...], float]
    b: Float[Array, " K"]
    active: frozenset[int]


def beside(problem: Problem, fitted: Fitted) -> Beside:
    """Project all columns off those of a fit; coefficients of the fit at a bound stay there."""
    a = problem.total_a
    cross, made, gradient = taken_out(problem, fitted)
    inside = frozenset(int(k) for k in fitted.active)
    sets: dict[tuple[int, ...], tuple[int, ...]] = {}
    for term in problem.columns.terms:
        sets.setdefault(term.columns, tuple(k for k in term.columns if k not in inside))
    gains = dict.fromkeys(sets, 0.0)
    for size in {len(own) for own in sets.values()} - {0}:
        # Sets of one size at a time: of all products only those within a set are wanted.
        same = [columns for columns, own in sets.items() if len(own) == size]
        own = np.array([sets[columns] for columns in same])
        left = a[own[:, :, None], own[:, None, :]] - cross[:, own].transpose(1, 2, 0) @ made[:, own].transpose(1, 0, 2)
        left[:, np.arange(size), np.arange(size)] += problem.precision[own]
        found = _gains(left, gradient[own], problem.lower[own], problem.upper[own])
        gains.update(zip(same, found.tolist(), strict=True))
    return Beside(gains, gradient, inside)


def taken_out(problem: Problem, fitted: Fitted) -> tuple[Float[Array, "f K"], Float[Array, "f K"], Float[Array, " K"]]:
    """Project all columns off the free columns of a fit.

    Returns:
        Products of the fit's free columns with all columns, coefficients of the projection, and products of the
        projected columns with the residual.
    """
    active, theta = fitted.active, fitted.theta
    x = theta[active]
    free = active[(x > problem.lower[active] + 1e-12) & (x < problem.upper[active] - 1e-12)]
    a = problem.total_a
    cross = a[free]
    made = solve(a[np.ix_(free, free)] + np.diag(problem.precision[free]), cross)
    gradient = problem.total_b - a[:, active] @ x
    return cross, made, gradient - made.T @ (gradient[free] - problem.precision[free] * theta[free])


def _gains(
    a: Float[Array, "T k k"], b: Float[Array, "T k"], lower: Float[Array, "T k"], upper: Float[Array, "T k"]
) -> Float[Array, " T"]:
    """Depths of the minima of ``x a x - 2 b x`` within bounds."""
    x = _solve_each(a, b)
    outside = np.any((x < lower) | (x > upper), axis=1)
    if a.shape[1] == 1:
        x = np.clip(x, lower, upper)
    else:
        for k in np.flatnonzero(outside):
            x[k] = bounded_solve(a[k], b[k], lower[k], upper[k])
    return 2 * np.einsum("tk,tk->t", b, x) - np.einsum("tk,tkl,tl->t", x, a, x)


def _solve_each(a: Float[Array, "T k k"], b: Float[Array, "T k"]) -> Float[Array, "T k"]:
    """As `solve`, for many small matrices at once."""
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("tkk->tk", a), 1e-300))
    scaled = a * scale[:, :, None] * scale[:, None, :] + 1e-12 * np.eye(a.shape[1])
    return np.linalg.solve(scaled, (b * scale)[:, :, None])[:, :, 0] * scale


def gain_of(besides: Beside, term: Term) -> float:
    """How much a term lowers the loss in sample, to second order; its bounds are kept."""
    return besides.gains[term.columns]


@dataclass(frozen=True)
class FoldProjection:
    """Held-out loss of one fold as a quadratic in the coefficients of any rivals, the nuisances fitted beside them.

    Attributes:
        a: Training products, ``(K, K)``.
        precision: Priors of all columns, ``(K,)``.
        made: Nuisances that a unit of each column moves, ``(n, K)``.
        core_a: Products of the held-out cores, ``(K, K)``.
    """

    a: Float[Array, "K K"]
    precision: Float[Array, " K"]
    made: Float[Array, "n K"]
    core_a: Float[Array, "K K"]

    @property
    def inner(self) -> Float[Array, "n n"]:
        """Training products of the nuisances with priors."""
        n = len(self.made)
        return self.a[:n, :n] + np.diag(self.precision[:n])

    @property
    def core(self) -> tuple[Float[Array, "n n"], Float[Array, "n K"]]:
        """Products of the held-out cores among nuisances, and between them and all columns."""
        n = len(self.made)
        return self.core_a[:n, :n], self.core_a[:n]

    def training(self, columns: Int[Array, "g m"]) -> Float[Array, "g m m"]:
        """Training products among each group of columns with the nuisances taken out, priors included."""
        made, cross = _each(self.made, columns), _each(self.a[: len(self.made)], columns)
        return (
            _square(self.a, columns) - cross.mT @ made + self.precision[columns][:, :, None] * np.eye(columns.shape[1])
        )

    def held_out(self, columns: Int[Array, "g m"]) -> Float[Array, "g m m"]:
        """Products of the held-out cores among each group of columns with the moved nuisances counted."""
        inside, across = self.core
        made = _each(self.made, columns)
        turned = _each(across, columns).mT @ made
        return _square(self.core_a, columns) - turned - turned.mT + made.mT @ inside @ made


def fold_projection(problem: Problem, blocks: Int[Array, " m"]) -> FoldProjection:
    """The projection of the fold that holds ``blocks`` out."""
    grams, n = problem.grams, problem.nuisances
    a = problem.total_a - grams.a.over(blocks)
    made = solve(a[:n, :n] + np.diag(problem.precision[:n]), a[:n])
    return FoldProjection(a, problem.precision, made, grams.core_a.over(blocks))


def _each(rows: Float[Array, "n K"], columns: Int[Array, "g m"]) -> Float[Array, "g n m"]:
    """The columns of each group."""
    return rows[:, columns].transpose(1, 0, 2)


def _square(a: Float[Array, "K K"], columns: Int[Array, "g m"]) -> Float[Array, "g m m"]:
    """The part of a matrix that belongs to each group of columns."""
    return a[columns[:, :, None], columns[:, None, :]]
