"""Squared residuals after fits of many subsets of some effects, from products of columns that are computed once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.gap import ResidualSums, judged_blocks, sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.search.search import Search
from phantom_dyn.array_types import Array, Bool, Float, Int


@dataclass(frozen=True)
class _Row:
    """Products of the columns and the residual of one row (joint).

    A group consists of the judged blocks that the same fit predicts; products are summed over each group.

    Attributes:
        index: Indices of these columns among all columns, ``(k,)``.
        products: Products of the columns and, last, the residual with each other, ``(G, k + 1, k + 1)``.
        counts: Weighted number of samples, ``(G,)``.
    """

    index: Int[Array, " k"]
    products: Float[Array, "G n n"]
    counts: Float[Array, " G"]


def subset_residuals(plain: Search, terms: frozenset[Term]) -> Callable[[frozenset[Term]], ResidualSums]:
    """Function that gives, for a subset of some effects, the squared residuals on blocks held out of its fit.

    The columns are in the judged band already, so the squared residuals follow from products of columns, without the
    samples. Blocks that the same fit predicts are summed.

    Args:
        plain: Search with fits in the judged band.
        terms: The effects of which subsets are fitted.
    """
    problem = plain.problem
    fold = problem.grams.fold[judged_blocks(problem)]
    # Folds of the judged blocks. Held-out recordings have fold -1, and index -1 is the fit to all blocks.
    fits = np.unique(fold)
    coefficients = plain.fits.of_subsets(terms)

    @cache
    def rows_of(with_displacement: bool) -> tuple[_Row, ...]:
        """Products of all rows.

        Columns are computed at the displaced positions of the links if ``with_displacement``, else at the positions
        that the encoders read.
        """
        own = problem if with_displacement else problem.at_readings
        assert own is not None
        wanted = {column for term in terms for column in term.columns} | set(own.fitted_nuisances.tolist())
        groups = [fold == which for which in fits]
        return tuple(_row(own, j, wanted, groups) for j in range(len(own.white.rows)))

    counts = np.column_stack([row.counts for row in rows_of(True)])

    def residuals(chosen: frozenset[Term]) -> ResidualSums:
        scaled = [term.columns[0] for term in chosen if term.effect.scales_joint]
        theta = coefficients(chosen)[fits]
        rows = rows_of(problem.of(chosen) is problem)
        return ResidualSums(np.column_stack([_squares(row, theta, scaled) for row in rows]), counts)

    return residuals


def _row(problem: Problem, j: int, wanted: set[int], groups: list[Bool[Array, " B"]]) -> _Row:
    """Products of row ``j`` for the wanted columns, summed over each group of judged blocks."""
    columns = problem.white
    local = [k for k, column in enumerate(columns.rows[j]) if column in wanted]
    products, counts = [], []
    for block in (problem.blocks[k] for k in judged_blocks(problem)):
        part = slice(block.core, block.stop)
        weights = sample_weights(problem, block.log, part)[:, j]
        joined = np.column_stack([columns.values[block.log][j][part][:, local], columns.residual[block.log][part, j]])
        products.append(joined.T @ (joined * weights[:, None]))
        counts.append(weights.sum())
    summed = (np.stack([np.array(each)[group].sum(axis=0) for group in groups]) for each in (products, counts))
    return _Row(np.array(columns.rows[j])[local], *summed)


def _squares(row: _Row, theta: Float[Array, "G K"], scaled: list[int]) -> Float[Array, " G"]:
    """Sum of squares of one row's residual in each group of blocks, with the coefficients ``theta`` of that group.

    Args:
        row: Products of the row.
        theta: Coefficients of all columns, one row for each group.
        scaled: Columns of torque constants.
    """
    x = theta[:, row.index]
    own = [k for k, column in enumerate(row.index) if column in scaled]
    if own:
        # A torque constant scales the modelled torque, which is its own column, and all other columns of the row.
        gains = x[:, own]
        x = x * (1.0 + gains.sum(axis=1, keepdims=True))
        x[:, own] = gains
    # The residual is [columns, residual] @ [-x, 1], and its square a quadratic form of their products.
    signed = np.column_stack([-x, np.ones(len(x))])
    weighted = (signed[:, None, :] @ row.products)[:, 0]
    return np.maximum(np.einsum("bi,bi->b", weighted, signed), 0.0)
