"""Products of columns and residual by block, and the fits and held-out losses that are computed from them.

The fit of a fold, or of a bootstrap replicate, needs only the sum of the products over its blocks (each counted as
often as it was drawn), not the samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float, Int

RIDGE = 1e-9
"""Share of each diagonal entry of a Gram matrix that is added to it, so that fits with equal columns can be solved."""
_AT_ONCE = 64  # number of draws whose normal equations are solved in one call
# Singular values below this share of the largest one count as rounding errors, for columns scaled to unit size.
_RANK = 1e-12


@dataclass(frozen=True)
class SummedProducts:
    """Products of columns and residual, summed over some blocks.

    Attributes:
        gram: Products of the columns with each other, ``(C, C)``.
        right: Products of the columns with the residual, ``(C,)``.
        total: Sum of squares of the residual.
    """

    gram: Float[Array, "C C"]
    right: Float[Array, " C"]
    total: float

    def fitted(self, columns: list[int]) -> Float[Array, " k"]:
        """Least squares coefficients of some columns; zero for a column that is zero in all blocks."""
        part = self.gram[np.ix_(columns, columns)]
        return solve(part + RIDGE * np.diag(np.diag(part)), self.right[columns])

    def left(self, columns: list[int], coefficients: Float[Array, " k"]) -> float:
        """Sum of squares of the residual after the columns times the given coefficients are subtracted."""
        part = self.gram[np.ix_(columns, columns)]
        return float(self.total - 2 * self.right[columns] @ coefficients + coefficients @ part @ coefficients)


@dataclass(frozen=True)
class NuisancePrior:
    """Gaussian prior on the coefficients of the nuisance columns. These are the last columns, and part of every fit.

    Attributes:
        precision: Precision of the prior, ``(F, F)``.
        right: Precision times the mean of the prior, ``(F,)``.
    """

    precision: Float[Array, "F F"]
    right: Float[Array, " F"]

    @property
    def count(self) -> int:
        """Number of nuisance columns."""
        return len(self.right)

    def eliminate_from(self, products: SummedProducts) -> SummedProducts:
        """Products of the other columns with the nuisance columns eliminated (Schur complement)."""
        n = len(products.right) - self.count
        if self.count == 0:
            return products
        between, normal = products.gram[:n, n:], self._normal(products)
        right = products.right[n:] + self.right
        solution = solve(normal, np.column_stack([between.T, right]))
        return SummedProducts(
            products.gram[:n, :n] - between @ solution[:, :-1],
            products.right[:n] - between @ solution[:, -1],
            float(products.total - right @ solution[:, -1]),
        )

    def fitted_with(
        self, products: SummedProducts, columns: list[int], theta: Float[Array, " k"]
    ) -> Float[Array, " F"]:
        """Coefficients of the nuisance columns in a fit with the coefficients ``theta`` of the other ``columns``."""
        n = len(products.right) - self.count
        if self.count == 0:
            return np.zeros(0)
        right = products.right[n:] + self.right - products.gram[n:, columns] @ theta
        return solve(self._normal(products), right)

    def _normal(self, products: SummedProducts) -> Float[Array, "F F"]:
        """Normal matrix of the nuisance columns with their prior."""
        n = len(products.right) - self.count
        return products.gram[n:, n:] + self.precision


@dataclass(frozen=True)
class BlockProducts:
    """Products of columns and residual for each block.

    Attributes:
        gram: Products of the columns with each other, ``(B, C, C)``.
        right: Products of the columns with the residual, ``(B, C)``.
        total: Sum of squares of the residual, ``(B,)``.
    """

    gram: Float[Array, "B C C"]
    right: Float[Array, "B C"]
    total: Float[Array, " B"]

    def summed(self, counts: Float[Array, " B"]) -> SummedProducts:
        """Sum over all blocks, each multiplied by its entry of ``counts``."""
        gram = np.tensordot(counts, self.gram, axes=1)
        return SummedProducts(gram, counts @ self.right, float(counts @ self.total))

    def of(self, columns: list[int]) -> BlockProducts:
        """Products of the given columns only."""
        at = np.array(columns, dtype=int)
        return BlockProducts(self.gram[:, at[:, None], at], self.right[:, at], self.total)

    def summed_without(self, counts: Float[Array, " B"], prior: NuisancePrior) -> SummedProducts:
        """Sum over all blocks, each multiplied by its entry of ``counts``, with the nuisance columns eliminated."""
        return prior.eliminate_from(self.summed(counts))

    def by_fold(self, folds: Int[Array, " B"]) -> Iterator[tuple[SummedProducts, list[int]]]:
        """For each fold, the products of its training blocks and the indices of its held-out blocks.

        Args:
            folds: Fold of each block. Blocks of fold -1 are in no fit: the fit to all other blocks predicts them.
        """
        for fold in np.unique(folds):
            train = (folds >= 0) & (folds != fold)
            yield self.summed(train.astype(float)), np.flatnonzero(folds == fold).tolist()

    def block(self, k: int) -> SummedProducts:
        """Products of one block."""
        return SummedProducts(self.gram[k], self.right[k], float(self.total[k]))

    def of_draws(
        self, counts: Float[Array, "D B"], precision: Float[Array, "C C"], right: Float[Array, " C"]
    ) -> Float[Array, "D C"]:
        """Coefficients of all columns on each draw of blocks, with a quadratic prior.

        Args:
            counts: How often each draw contains each block.
            precision: Precision of the prior.
            right: Precision times the mean of the prior.
        """
        grams, size = self.gram.reshape(len(self.gram), -1), len(right)
        out = np.empty((len(counts), size))
        for first in range(0, len(counts), _AT_ONCE):
            some = counts[first : first + _AT_ONCE]
            normal = (some @ grams).reshape(len(some), size, size) + precision
            out[first : first + _AT_ONCE] = np.linalg.solve(normal, (some @ self.right + right)[:, :, None])[:, :, 0]
        return out

    def fits_without_each(self, columns: list[int]) -> Float[Array, "B k"]:
        """Least-squares coefficients of some columns, one row for each block: the fit to all other blocks.

        If columns are linearly dependent, each fit returns the solution of least norm.
        """
        at = np.array(columns, dtype=int)
        gram, right = self.gram[:, at[:, None], at], self.right[:, at]
        grams, rights = gram.sum(axis=0) - gram, right.sum(axis=0) - right
        out = np.empty_like(right)
        for b, (a, y) in enumerate(zip(grams, rights, strict=True)):
            size = np.sqrt(np.maximum(np.diag(a), 1e-300))
            out[b] = np.linalg.lstsq(a / np.outer(size, size), y / size, rcond=_RANK)[0] / size
        return out

    def losses(self, columns: list[int]) -> Float[Array, " B"]:
        """Sum of squares of each block's residual, predicted by the fit to all other blocks."""
        at, x = np.array(columns, dtype=int), self.fits_without_each(columns)
        predicted = np.einsum("bk,bkl,bl->b", x, self.gram[:, at[:, None], at], x)
        return np.maximum(self.total - 2 * np.einsum("bk,bk->b", x, self.right[:, at]) + predicted, 0.0)


def block_products(
    x: Float[Array, "n C"], y: Float[Array, " n"], weight: Float[Array, " n"], blocks: Int[Array, " n"], count: int
) -> BlockProducts:
    """Weighted products of columns and residual for each block.

    Args:
        x: Columns.
        y: Residual.
        weight: Weight of each sample.
        blocks: Block of each sample, -1 for a sample in no block.
        count: Number of blocks.
    """
    gram, right, total = np.zeros((count, x.shape[1], x.shape[1])), np.zeros((count, x.shape[1])), np.zeros(count)
    root = np.sqrt(weight)
    for k in range(count):
        use = (blocks == k) & (weight > 0)
        xb, yb = x[use] * root[use, None], y[use] * root[use]
        gram[k], right[k], total[k] = xb.T @ xb, xb.T @ yb, yb @ yb
    return BlockProducts(gram, right, total)


def held_out_residual(
    x: Float[Array, "n k"], y: Float[Array, " n"], blocks: Int[Array, " n"], coefficients: Float[Array, "B k"]
) -> Float[Array, " n"]:
    """Held-out residual of each sample: the fit leaves out the block of the sample.

    Args:
        x: Columns of the fit.
        y: Residual.
        blocks: Block of each sample.
        coefficients: Coefficients of the fit without each block, as `BlockProducts.fits_without_each` returns them.
    """
    return y - np.einsum("nk,nk->n", x, coefficients[blocks])
