"""What each rival would gain beside a fit, all rivals at once: the part of its columns that the fit cannot make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from identification.diagnosis.bounded import bounded_solve, solve
from identification.diagnosis.fitting import Fitted
from identification.diagnosis.problem import Problem
from identification.diagnosis.terms import Term

Array = np.ndarray


@dataclass(frozen=True)
class Beside:
    """All columns with what a fit can make of them taken out.

    Attributes:
        a: Products of what is left of the columns, priors counted, ``(K, K)``.
        b: Its products with the residual of the fit, ``(K,)``.
        active: Columns of the fit.
    """

    a: Float[Array, "K K"]
    b: Float[Array, " K"]
    active: frozenset[int]


def beside(problem: Problem, fitted: Fitted) -> Beside:
    """Take a fit out of all columns; coefficients of the fit that stand at a bound stay there."""
    active = fitted.active
    x = fitted.theta[active]
    free = active[(x > problem.lower[active] + 1e-12) & (x < problem.upper[active] - 1e-12)]
    a, b = problem.total_a, problem.total_b
    inner = a[np.ix_(free, free)] + np.diag(problem.precision[free])
    cross = a[free]
    made = solve(inner, cross)
    left = a - cross.T @ made
    left[np.diag_indices_from(left)] += problem.precision
    gradient = b - a[:, active] @ x
    gradient = gradient - made.T @ (gradient[free] - problem.precision[free] * fitted.theta[free])
    return Beside(left, gradient, frozenset(int(k) for k in active))


def gain_of(problem: Problem, besides: Beside, term: Term) -> float:
    """How much a term lowers the loss in sample, to second order; its bounds are kept."""
    own = np.array([k for k in term.columns if k not in besides.active], dtype=int)
    if len(own) == 0:
        return 0.0
    a, b = besides.a[np.ix_(own, own)], besides.b[own]
    x = bounded_solve(a, b, problem.lower[own], problem.upper[own])
    return float(2 * b @ x - x @ a @ x)


@dataclass(frozen=True)
class FoldProjection:
    """Held-out loss of one fold as a quadratic in the coefficients of any rivals, the nuisances fitted beside them.

    Attributes:
        a: Training products with the nuisances taken out, ``(K, K)``.
        made: Nuisances that a unit of each column moves, ``(n, K)``.
        core_a: Products of the held-out cores with the moved nuisances counted, ``(K, K)``.
        inner: Training products of the nuisances with priors, ``(n, n)``.
        core: Products of the held-out cores among nuisances, ``(n, n)``, and between them and all columns, ``(n, K)``.
    """

    a: Float[Array, "K K"]
    made: Float[Array, "n K"]
    core_a: Float[Array, "K K"]
    inner: Float[Array, "n n"]
    core: tuple[Float[Array, "n n"], Float[Array, "n K"]]


def fold_projection(problem: Problem, blocks: Int[Array, " m"]) -> FoldProjection:
    """The projection of the fold that holds ``blocks`` out."""
    grams, n = problem.grams, problem.nuisances
    a = problem.total_a - grams.a[blocks].sum(axis=0)
    core = grams.core_a[blocks].sum(axis=0)
    inner = a[:n, :n] + np.diag(problem.precision[:n])
    made = solve(inner, a[:n])
    left = a - a[:n].T @ made
    left[np.diag_indices_from(left)] += problem.precision
    turned = core[:n].T @ made
    return FoldProjection(
        left, made, core - turned - turned.T + made.T @ core[:n, :n] @ made, inner, (core[:n, :n], core[:n])
    )
