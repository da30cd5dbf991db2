"""Products of columns and residual by block: fits and held-out losses of any set of columns without the samples.

Summed over blocks, each as often as it was drawn, the products give the fit of every bootstrap replicate and of every
fold at no cost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float, Int

RIDGE = 1e-9
"""Of a column's squares, added to them: keeps twins solvable."""
_AT_ONCE = 64  # draws whose systems are written out together
_RANK = 1e-12  # of products of columns of size one: what exact combinations leave is rounding


@dataclass(frozen=True)
class Products:
    """Products of columns and residual over some blocks.

    Attributes:
        gram: Of the columns, ``(C, C)``.
        right: Of the columns with the residual, ``(C,)``.
        total: Of the residual with itself.
    """

    gram: Float[Array, "C C"]
    right: Float[Array, " C"]
    total: float

    def fitted(self, columns: list[int]) -> Float[Array, " k"]:
        """Least squares coefficients of some columns; zero for one that is zero in all blocks."""
        part = self.gram[np.ix_(columns, columns)]
        return solve(part + RIDGE * np.diag(np.diag(part)), self.right[columns])

    def left(self, columns: list[int], coefficients: Float[Array, " k"]) -> float:
        """Sum of squares that given coefficients leave."""
        part = self.gram[np.ix_(columns, columns)]
        return float(self.total - 2 * self.right[columns] @ coefficients + coefficients @ part @ coefficients)


@dataclass(frozen=True)
class Free:
    """The last columns, which are in every fit, with a quadratic prior on their coefficients.

    Attributes:
        precision: Of the prior, ``(F, F)``.
        right: Precision times its mean, ``(F,)``.
    """

    precision: Float[Array, "F F"]
    right: Float[Array, " F"]

    @property
    def count(self) -> int:
        """How many columns."""
        return len(self.right)

    def taken_out(self, products: Products) -> Products:
        """Products of the other columns where the free ones are fitted beside any choice of them (Schur complement)."""
        n = len(products.right) - self.count
        if self.count == 0:
            return products
        between, mine = products.gram[:n, n:], self._normal(products)
        right = products.right[n:] + self.right
        through = solve(mine, np.column_stack([between.T, right]))
        return Products(
            products.gram[:n, :n] - between @ through[:, :-1],
            products.right[:n] - between @ through[:, -1],
            float(products.total - right @ through[:, -1]),
        )

    def beside(self, products: Products, columns: list[int], theta: Float[Array, " k"]) -> Float[Array, " F"]:
        """Coefficients of the free columns where those of other columns are given."""
        n = len(products.right) - self.count
        if self.count == 0:
            return np.zeros(0)
        right = products.right[n:] + self.right - products.gram[n:, columns] @ theta
        return solve(self._normal(products), right)

    def _normal(self, products: Products) -> Float[Array, "F F"]:
        n = len(products.right) - self.count
        return products.gram[n:, n:] + self.precision


@dataclass(frozen=True)
class BlockProducts:
    """`Products` of each block.

    Attributes:
        gram: Of the columns, ``(B, C, C)``.
        right: Of the columns with the residual, ``(B, C)``.
        total: Of the residual with itself, ``(B,)``.
    """

    gram: Float[Array, "B C C"]
    right: Float[Array, "B C"]
    total: Float[Array, " B"]

    def summed(self, counts: Float[Array, " B"]) -> Products:
        """Sum over all blocks, each as often as ``counts`` says."""
        gram = np.tensordot(counts, self.gram, axes=1)
        return Products(gram, counts @ self.right, float(counts @ self.total))

    def of(self, columns: list[int]) -> BlockProducts:
        """The same of some columns."""
        at = np.array(columns, dtype=int)
        return BlockProducts(self.gram[:, at[:, None], at], self.right[:, at], self.total)

    def freed(self, counts: Float[Array, " B"], free: Free) -> Products:
        """Products of all columns but the free ones, which are fitted beside every choice."""
        return free.taken_out(self.summed(counts))

    def by_fold(self, folds: Int[Array, " B"]) -> Iterator[tuple[Products, list[int]]]:
        """For each fold the products of all other blocks that fits may see, and the blocks that these judge.

        Args:
            folds: Of each block; blocks of fold -1 are seen by no fit, and judged by that of all others.
        """
        for fold in np.unique(folds):
            train = (folds >= 0) & (folds != fold)
            yield self.summed(train.astype(float)), np.flatnonzero(folds == fold).tolist()

    def block(self, k: int) -> Products:
        """Of one block."""
        return Products(self.gram[k], self.right[k], float(self.total[k]))

    def of_draws(
        self, counts: Float[Array, "D B"], precision: Float[Array, "C C"], pull: Float[Array, " C"]
    ) -> Float[Array, "D C"]:
        """Coefficients of all columns on each draw of blocks, with a quadratic prior.

        Args:
            counts: How often each draw has each block.
            precision: Of the prior.
            pull: Precision times its mean.
        """
        lines, size = self.gram.reshape(len(self.gram), -1), len(pull)
        out = np.empty((len(counts), size))
        for first in range(0, len(counts), _AT_ONCE):
            some = counts[first : first + _AT_ONCE]
            normal = (some @ lines).reshape(len(some), size, size) + precision
            out[first : first + _AT_ONCE] = np.linalg.solve(normal, (some @ self.right + pull)[:, :, None])[:, :, 0]
        return out

    def without_each(self, columns: list[int]) -> Float[Array, "B k"]:
        """Least squares coefficients of some columns by fits that have not seen one block each.

        Columns may be combinations of others, as two poses of one body are: of all solutions that of the least size.
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
        """Squares of each block that a fit of the others leaves."""
        at, x = np.array(columns, dtype=int), self.without_each(columns)
        made = np.einsum("bk,bkl,bl->b", x, self.gram[:, at[:, None], at], x)
        return np.maximum(self.total - 2 * np.einsum("bk,bk->b", x, self.right[:, at]) + made, 0.0)


def block_products(
    x: Float[Array, "n C"], y: Float[Array, " n"], weight: Float[Array, " n"], blocks: Int[Array, " n"], count: int
) -> BlockProducts:
    """Products of each block.

    Args:
        x: Columns.
        y: Residual.
        weight: What each sample counts.
        blocks: Of each sample, -1 for none.
        count: Number of blocks.
    """
    gram, right, total = np.zeros((count, x.shape[1], x.shape[1])), np.zeros((count, x.shape[1])), np.zeros(count)
    root = np.sqrt(weight)
    for k in range(count):
        use = (blocks == k) & (weight > 0)
        xb, yb = x[use] * root[use, None], y[use] * root[use]
        gram[k], right[k], total[k] = xb.T @ xb, xb.T @ yb, yb @ yb
    return BlockProducts(gram, right, total)


def left_of_each(
    x: Float[Array, "n k"], y: Float[Array, " n"], blocks: Int[Array, " n"], coefficients: Float[Array, "B k"]
) -> Float[Array, " n"]:
    """What is left of each sample by the fit that has not seen its block.

    Args:
        x: Columns of the fit.
        y: Residual.
        blocks: Of each sample.
        coefficients: Of the fit without each block, see `BlockProducts.without_each`.
    """
    return y - np.einsum("nk,nk->n", x, coefficients[blocks])
