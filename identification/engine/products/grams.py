"""Gram matrices of columns and residual by block and by fold; all fits use these instead of samples.

A row holds the samples of one joint (or coordinate). A column touches a row if it is not zero there. A fold is a set of
blocks that are held out together. The core of a block leaves out its first samples, which share noise with the previous
block; held-out losses are computed on cores.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from identification.engine.numerics.two_threads import in_two_threads
from identification.engine.products.blocks import Block
from identification.engine.products.row_products import RowProducts
from identification.engine.products.triangles import places_in, square, triangle
from phantom_dyn.array_types import Array, Bool, Float, Int


@dataclass(frozen=True)
class Weights:
    """Weights of squared residuals: ``trust^2 / (floor^2 * spread)``.

    Attributes:
        floor: Noise floor of each row, in the unit of the row, ``(nv,)``.
        spread: Number of samples of coloured noise with the information of one sample of white noise, ``(nv,)``.
        trust: Factor of each sample's residual, below one for samples that count less, for each log ``(n, nv)``; None
            if all factors are one.
    """

    floor: Float[Array, " nv"]
    spread: Float[Array, " nv"]
    trust: tuple[Float[Array, "n nv"], ...] | None = None

    @property
    def per_sample(self) -> Float[Array, " nv"]:
        """Weight of a squared residual on each row, for a trust of one."""
        return 1.0 / (self.floor**2 * self.spread)

    def scale(self, log: int, part: slice) -> Float[Array, "n nv"]:
        """Square roots of the weights of some samples of a log, by which residuals are multiplied."""
        trust = 1.0 if self.trust is None else self.trust[log][part]
        return np.sqrt(self.per_sample) * trust * np.ones((part.stop - part.start, 1))


@dataclass(frozen=True)
class RowGrams:
    """Weighted products of one row's columns and residual.

    Products of columns with columns are stored as lower triangles, see `products.triangles`.

    Attributes:
        index: Indices of the row's columns among all columns, ``(k,)``.
        a: Columns times columns over the whole blocks of each fold, and last of the blocks in no fit,
            ``(F + 1, k (k + 1) / 2)``. They are not stored by block, to save memory.
        b: Columns times residual over each whole block, ``(B, k)``.
        c: Residual times residual over each whole block, ``(B,)``.
        core_a: Columns times columns over the core of each block, ``(B, k (k + 1) / 2)``.
        core_b: Columns times residual over the core of each block, ``(B, k)``.
        core_c: Residual times residual over the core of each block, ``(B,)``.
        count: Effective number of samples in each core, ``(B,)``.
    """

    index: Int[Array, " k"]
    a: Float[Array, "G n"]
    b: Float[Array, "B k"]
    c: Float[Array, " B"]
    core_a: Float[Array, "B n"]
    core_b: Float[Array, "B k"]
    core_c: Float[Array, " B"]
    count: Float[Array, " B"]

    @cached_property
    def core_total(self) -> tuple[Float[Array, "k k"], Float[Array, " k"], float]:
        """The products ``a`` (as a full matrix), ``b`` and ``c``, summed over all cores."""
        return square(self.core_a.sum(axis=0)), self.core_b.sum(axis=0), float(self.core_c.sum())


@dataclass(frozen=True)
class Grams:
    """Weighted products of all columns and the residual, summed over the rows.

    Attributes:
        rows: The products of each row.
        fold_a: Columns times columns over the whole blocks of each fold, ``(F, K, K)`` as full matrices.
        unseen_a: Columns times columns over the blocks in no fit, ``(1, K, K)`` as full matrices.
        b: Columns times residual over each whole block, ``(B, K)``.
        c: Residual times residual over each whole block, ``(B,)``.
        core_a: Columns times columns over the core of each block, ``(B, K, K)`` as full matrices.
        core_b: Columns times residual over the core of each block, ``(B, K)``.
        core_c: Residual times residual over the core of each block, ``(B,)``.
        fold: Fold of each block, ``(B,)``; blocks of one fold are held out together, those with -1 are in no fit.
        count: Effective number of samples in each core, ``(B,)``.
    """

    rows: tuple[RowGrams, ...]
    fold_a: RowProducts
    unseen_a: RowProducts
    b: Float[Array, "B K"]
    c: Float[Array, " B"]
    core_a: RowProducts
    core_b: Float[Array, "B K"]
    core_c: Float[Array, " B"]
    fold: Int[Array, " B"]
    count: Float[Array, " B"]

    @cached_property
    def total_a(self) -> Float[Array, "K K"]:
        """Columns times columns over all training blocks, as a full matrix."""
        return self.fold_a.total()

    @cached_property
    def train_a(self) -> RowProducts:
        """Columns times columns over all training blocks, stored row by row, ``(1, K, K)`` as a full matrix."""
        return self.fold_a.grouped(np.zeros(self.fold_a.shape[0], dtype=int))

    @cached_property
    def everything(self) -> Float[Array, "K K"]:
        """Columns times columns over all blocks, as a full matrix."""
        return self.total_a if (self.fold >= 0).all() else self.total_a + self.unseen_a.total()

    @cached_property
    def fold_core_a(self) -> RowProducts:
        """Columns times columns over the cores of the blocks of each fold."""
        return self.core_a.grouped(self.fold)

    @cached_property
    def fold_b(self) -> Float[Array, "F K"]:
        """Columns times residual over the whole blocks of each fold."""
        return self.by_fold(self.b)

    def by_fold(self, series: Float[Array, "B ..."]) -> Float[Array, "F ..."]:
        """A series over blocks, summed over the blocks of each fold."""
        return np.tensordot(self._is_in_fold, series, axes=1)

    @cached_property
    def _is_in_fold(self) -> Float[Array, "F B"]:
        """One where a block is in a fold, else zero."""
        return (self.fold == np.arange(int(self.fold.max()) + 1)[:, None]).astype(float)


class TouchedColumns(Protocol):
    """Columns and residual of some series, stored row by row. A column touches a row if it is not zero there."""

    @property
    def rows(self) -> Sequence[Sequence[int]]:
        """For each row, the indices of the columns that touch it."""
        ...

    @property
    def values(self) -> Sequence[Sequence[Float[Array, "n k"]]]:
        """For each series and row, samples of the columns that touch the row, ``(n, len(rows[row]))``."""
        ...

    @property
    def residual(self) -> Sequence[Float[Array, "n rows"]]:
        """For each series, the residual that columns are to explain."""
        ...

    @property
    def usable(self) -> Sequence[Bool[Array, "n rows"]]:
        """For each series, True for the samples of each row that may be used."""
        ...


def row_grams(
    columns: TouchedColumns, blocks: tuple[Block, ...], folds: Int[Array, " B"], weights: Weights, row: int
) -> RowGrams:
    """Weighted products of one row's columns and residual.

    Args:
        columns: Columns and residual of all rows.
        blocks: Blocks of samples of the series.
        folds: Fold of each block; -1 for blocks in no fit.
        weights: Weights of squared residuals.
        row: Index of the row.
    """
    size, groups = len(columns.rows[row]) + 1, int(folds.max(initial=-1)) + 1
    whole, product = np.zeros((groups + 1, size, size)), np.empty((size, size))
    lower = places_in(size, size - 1)
    core_a, core = np.empty((len(blocks), len(lower))), np.empty((len(blocks), size))
    edges: list[list[Array]] = [[] for _ in range(groups + 1)]
    b, c, count = np.empty((len(blocks), size - 1)), np.empty(len(blocks)), np.empty(len(blocks))
    for k, block in enumerate(blocks):
        part = slice(block.start, block.stop)
        use = columns.usable[block.log][part, row]
        # One product of columns and residual together gives all three.
        x, residual = columns.values[block.log][row][part], columns.residual[block.log][part, row]
        joined = np.column_stack([x, residual] if use.all() else [x[use], residual[use]])
        if weights.trust is not None:
            joined *= weights.trust[block.log][part, row][use, None]
        # The core is the block without its first few samples, which are called its edge here.
        first = int(np.searchsorted(np.flatnonzero(use), block.core - block.start))
        np.matmul(joined[first:].T, joined[first:], out=product)
        core_a[k], core[k] = triangle(product, lower), product[:, -1]
        edge = joined[:first]
        last = core[k] + edge.T @ edge[:, -1]
        b[k], c[k] = last[:-1], last[-1]
        # The index -1 of blocks in no fit is the last entry.
        whole[folds[k]] += product
        edges[folds[k]].append(edge)
        count[k] = (len(joined) - first) / weights.spread[row]
    for products, parts in zip(whole, edges, strict=True):
        if parts:
            joined_edges = np.concatenate(parts)
            products += joined_edges.T @ joined_edges
    weight = weights.per_sample[row]
    core_a *= weight
    core *= weight
    whole *= weight
    return RowGrams(
        index=np.array(columns.rows[row]),
        a=triangle(whole, lower),
        b=weight * b,
        c=weight * c,
        core_a=core_a,
        core_b=core[:, :-1],
        core_c=core[:, -1],
        count=count,
    )


def all_row_grams(
    columns: TouchedColumns, blocks: tuple[Block, ...], folds: Int[Array, " B"], weights: Weights
) -> tuple[RowGrams, ...]:
    """Products of every row."""
    return tuple(in_two_threads(lambda row: row_grams(columns, blocks, folds, weights, row), range(len(columns.rows))))


def summed(total: int, rows: tuple[RowGrams, ...], folds: Int[Array, " B"], always: Int[Array, " m"]) -> Grams:
    """Products of all rows, summed.

    Args:
        total: Number of all columns.
        rows: Products of every row.
        folds: Fold of each block; -1 for blocks in no fit.
        always: Indices of the columns of every fit, in ascending order.
    """
    count, index = len(folds), tuple(row.index for row in rows)
    fold_a = RowProducts(index, tuple(row.a[:-1] for row in rows), total, always)
    unseen_a = RowProducts(index, tuple(row.a[-1:] for row in rows), total, always)
    core_a = RowProducts(index, tuple(row.core_a for row in rows), total, always)
    b, core_b = np.zeros((count, total)), np.zeros((count, total))
    for row in rows:
        b[:, row.index] += row.b
        core_b[:, row.index] += row.core_b
    c, core_c, samples = (sum(getattr(row, name) for row in rows) for name in ("c", "core_c", "count"))
    return Grams(
        rows, fold_a, unseen_a, b, np.asarray(c), core_a, core_b, np.asarray(core_c), folds, np.asarray(samples)
    )
