"""The full solution of one set of columns, with the arrays from which fits of similar sets are computed.

A column is held if its coefficient is at a bound. A column enters if it is in the similar set, but not in this one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from identification.engine.fits.problem import LinearProblem
from identification.engine.numerics.tableau import Entering, Tableau, tableau
from phantom_dyn.array_types import Bool, Float, Int

Array = np.ndarray


@dataclass(frozen=True)
class _EnteringParts:
    """Fields of `Entering` for one column that enters ``T`` tableaus; they do not depend on other entering columns."""

    cross: Float[Array, "T n"]
    response: Float[Array, "T n"]
    slope: Float[Array, " T"]
    scale: Float[Array, " T"]


@dataclass(frozen=True)
class PastFit:
    """Coefficients of an earlier fit of a set.

    Attributes:
        bits: The set as an integer with one bit for each column.
        index: Columns of ``x``, ``(v,)``.
        x: Coefficients, ``(G, v)``: rows of the fits without each fold, if these were made, and last a row of the fit
            to all blocks.
        known: True for each of all columns that ``x`` contains, ``(K,)``.
        held: True for each of all columns that is at a bound in the fit to all blocks, ``(K,)``.
    """

    bits: int
    index: Int[Array, " v"]
    x: Float[Array, "G v"]
    known: Bool[Array, " K"]
    held: Bool[Array, " K"]


@dataclass(frozen=True)
class SolvedSet:
    """One set of columns, solved on all blocks and once without each fold.

    Attributes:
        problem: The problem that is fitted.
        columns: Columns of the set, ``(n,)``.
        whole: The fit to all blocks.
    """

    problem: LinearProblem
    columns: Int[Array, " n"]
    whole: Tableau
    _entering: dict[int, _EnteringParts] = field(default_factory=dict)
    _fold_entering: dict[int, _EnteringParts] = field(default_factory=dict)
    _core_products: dict[int, Float[Array, "B n"]] = field(default_factory=dict)

    @cached_property
    def inside(self) -> Bool[Array, " K"]:
        """True for each of all columns that is in the set."""
        return marked(self.columns, len(self.problem.precision))

    @cached_property
    def folds(self) -> tuple[Tableau, ...]:
        """The fits without one fold each."""
        problem, columns = self.problem, self.columns
        a, b, lower, upper = quadratic(problem, columns)
        near = self.whole.x * self.whole.scale
        fold_a, fold_b = problem.grams.fold_a.among(columns), problem.grams.fold_b[:, columns]
        return tuple(
            tableau(a - own_a, b - own_b, lower, upper, near) for own_a, own_b in zip(fold_a, fold_b, strict=True)
        )

    @cached_property
    def core(self) -> Float[Array, "B n n"]:
        """Products over the core of each block."""
        return self.problem.grams.core_a.among(self.columns)

    @cached_property
    def fit_of_block(self) -> Int[Array, " B"]:
        """Index of the fit that predicts each block: that without its fold, or for fold -1 the last, to all blocks."""
        fold = self.problem.grams.fold
        return np.where(fold < 0, len(self.folds), fold)

    @cached_property
    def x_of_block(self) -> Float[Array, "B n"]:
        """Coefficients of the fit that predicts each block."""
        return np.stack([one.x * one.scale for one in (*self.folds, self.whole)])[self.fit_of_block]

    @cached_property
    def core_slope(self) -> Float[Array, "B n"]:
        """Half the slope of each block's loss at the coefficients `x_of_block`."""
        return (self.core @ self.x_of_block[:, :, None])[:, :, 0] - self.problem.grams.core_b[:, self.columns]

    @cached_property
    def core_diagonal(self) -> Float[Array, " n"]:
        """Products of each column with itself over all cores."""
        return np.einsum("bkk->k", self.core)

    @cached_property
    def losses(self) -> Float[Array, " B"]:
        """Loss of each block at the coefficients `x_of_block`."""
        grams = self.problem.grams
        return grams.core_c + np.einsum("bk,bk->b", self.core_slope - grams.core_b[:, self.columns], self.x_of_block)

    @cached_property
    def held(self) -> Bool[Array, " K"]:
        """True for each of all columns that is in the set and at a bound."""
        return marked(self.columns[self.whole.held], len(self.problem.precision))

    def differences(self, wanted: Bool[Array, " K"], similar: PastFit | None) -> int:
        """Number of columns that are in only one of this set and another, or at a bound in only one of their fits.

        Args:
            wanted: True for each of all columns that is in the other set.
            similar: An earlier fit of a set similar to the other one, whose active bounds are used; None if there is
                none.
        """
        differs = self.inside != wanted
        if similar is not None:
            differs = differs | (self.inside & wanted & similar.known & (self.held != similar.held))
        return int(np.count_nonzero(differs))

    def changes(self, active: Int[Array, " k"]) -> tuple[Int[Array, " m"], Int[Array, " l"], Int[Array, " v"]]:
        """Changes from this set to the set ``active``.

        Returns:
            new: Columns that enter, ``(m,)``.
            gone: Positions in `columns` of those that leave, ``(l,)``.
            index: `columns` followed by ``new``, ``(v,)``; those that leave are still included.
        """
        new = active[~self.inside[active]]
        gone = np.flatnonzero(~marked(active, len(self.inside))[self.columns])
        return new, gone, np.concatenate([self.columns, new])

    def entering(self, columns: Int[Array, " m"]) -> Entering:
        """The given columns as unknowns that enter the fit to all blocks; they are not in the set."""
        problem = self.problem
        square = problem.total_a[np.ix_(columns, columns)] + np.diag(problem.precision[columns])
        return self.whole.entering_of(*self.entering_parts(columns), square)

    def entering_parts(self, columns: Int[Array, " m"]) -> tuple[Array, Array, Array, Array]:
        """Cross, response, slope and scale of the given columns, as in `Entering`, for the fit to all blocks."""
        known = self._entering
        new = np.array([k for k in columns.tolist() if k not in known], dtype=int)
        if len(new):
            problem = self.problem
            diagonal = np.diag(problem.total_a)[new] + problem.precision[new]
            parts = self.whole.entering_parts(
                problem.total_a[np.ix_(new, self.columns)], diagonal, problem.total_b[new]
            )
            known.update(
                (column, _EnteringParts(*(part[k][None] for part in parts))) for k, column in enumerate(new.tolist())
            )
        return _stacked_parts(self.whole, [known[k] for k in columns.tolist()], 0)

    def fold_entering(self, columns: Int[Array, " m"]) -> list[Entering]:
        """The given columns as unknowns that enter the fit without each fold; they are not in the set."""
        problem, known = self.problem, self._fold_entering
        new = np.array([k for k in columns.tolist() if k not in known], dtype=int)
        whole = problem.total_a[np.ix_(columns, columns)] + np.diag(problem.precision[columns])
        squares = whole - problem.grams.fold_a.among(columns)
        if len(new):
            cross = problem.total_a[np.ix_(new, self.columns)] - problem.grams.fold_a.between(new, self.columns)
            b = problem.total_b[new] - problem.grams.fold_b[:, new]
            diagonal = np.diag(problem.total_a)[new] + problem.precision[new] - problem.grams.fold_a.diagonal(new)
            parts = [one.entering_parts(cross[fold], diagonal[fold], b[fold]) for fold, one in enumerate(self.folds)]
            for k, column in enumerate(new.tolist()):
                known[column] = _EnteringParts(*(np.array([part[i][k] for part in parts]) for i in range(4)))
        pieces = [known[k] for k in columns.tolist()]
        return [one.entering_of(*_stacked_parts(one, pieces, k), squares[k]) for k, one in enumerate(self.folds)]

    def core_products(self, columns: Int[Array, " m"]) -> Float[Array, "B m n"]:
        """Products of columns that are not in the set with those of the set, over the core of each block."""
        new = np.array([k for k in columns.tolist() if k not in self._core_products], dtype=int)
        if len(new):
            lines = self.problem.grams.core_a.between(new, self.columns)
            self._core_products.update((column, lines[:, k]) for k, column in enumerate(new.tolist()))
        shape = len(self.problem.grams.fold), 0, len(self.columns)
        return np.stack([self._core_products[k] for k in columns.tolist()], axis=1) if len(columns) else np.zeros(shape)


def marked(columns: Int[Array, " k"], count: int) -> Bool[Array, " K"]:
    """Mask of all ``count`` columns that is True for the given ones, ``(K,)``."""
    out = np.zeros(count, dtype=bool)
    out[columns] = True
    return out


def quadratic(problem: LinearProblem, columns: Int[Array, " n"]) -> tuple[Array, Array, Array, Array]:
    """Quadratic problem of some columns: products with priors, products with the residual, lower and upper bounds."""
    a = problem.total_a[np.ix_(columns, columns)]
    a.flat[:: len(a) + 1] += problem.precision[columns]
    return a, problem.total_b[columns], problem.lower[columns], problem.upper[columns]


def _stacked_parts(one: Tableau, pieces: list[_EnteringParts], which: int) -> tuple[Array, Array, Array, Array]:
    """Cross, response, slope and scale of several columns that enter tableau number ``which``."""
    n = len(one.x)
    cross, response = (
        np.array([getattr(piece, name)[which] for piece in pieces]).reshape(-1, n) for name in ("cross", "response")
    )
    slope, scale = (np.array([getattr(piece, name)[which] for piece in pieces]) for name in ("slope", "scale"))
    return cross, response, slope, scale
