"""Gram matrices of columns by block of samples, stored separately for each row (joint).

A column touches a row if it is not zero there. Most columns touch a single row, and the product of two columns that
touch no common row is zero: for a robot with six joints and a thousand columns, nine tenths of a full matrix would be
zero. Each symmetric matrix is stored as its lower triangle, see `products.triangles`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from identification.engine.products.triangles import diagonal, square
from identification.engine.products.triangles import place as place_of
from phantom_dyn._kernels.jit import fused, jit
from phantom_dyn.array_types import Array, Float, Int


@dataclass(frozen=True)
class RowProducts:
    """Gram matrices of ``B`` blocks, stored row by row; the sum over the rows is computed on demand.

    Attributes:
        index: For each row, the columns that touch it.
        values: For each row, the products of these columns as lower triangles, ``(B, k (k + 1) / 2)``.
        columns: Number of all columns.
        always: Columns that every fit contains, ``(m,)``. Products among them are computed once and kept.
    """

    index: tuple[Int[Array, " k"], ...]
    values: tuple[Float[Array, "B n"], ...]
    columns: int
    always: Int[Array, " m"] = field(default_factory=lambda: np.zeros(0, dtype=int))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the full matrices."""
        return len(self.values[0]), self.columns, self.columns

    def among(self, columns: Int[Array, " k"]) -> Float[Array, "B k k"]:
        """Products among some columns; no column may be given twice."""
        out = np.zeros((self.shape[0], len(columns), len(columns)))
        n_always = self._n_always(columns)
        if n_always:
            out[:, :n_always, :n_always] = self._among_always
        for position, values in zip(self._position_in_row, self.values, strict=True):
            positions = position[columns]
            touching = np.flatnonzero(positions >= 0)
            _add(out, values, positions[touching], touching, int(np.count_nonzero(touching < n_always)))
        return out

    def between(self, left: Int[Array, " k"], right: Int[Array, " m"]) -> Float[Array, "B k m"]:
        """Products of the columns ``left`` with the columns ``right``."""
        out = np.zeros((self.shape[0], len(left), len(right)))
        for position, values in zip(self._position_in_row, self.values, strict=True):
            row_positions, col_positions = position[left], position[right]
            rows, cols = np.flatnonzero(row_positions >= 0), np.flatnonzero(col_positions >= 0)
            if len(rows) and len(cols):
                out[:, rows[:, None], cols] += values[:, place_of(row_positions[rows][:, None], col_positions[cols])]
        return out

    def diagonal(self, columns: Int[Array, " k"]) -> Float[Array, "B k"]:
        """Product of each of some columns with itself."""
        out = np.zeros((self.shape[0], len(columns)))
        for position, values in zip(self._position_in_row, self.values, strict=True):
            positions = position[columns]
            touching = np.flatnonzero(positions >= 0)
            out[:, touching] += diagonal(values, positions[touching])
        return out

    def in_row(self, row: int, columns: Int[Array, " k"]) -> tuple[Int[Array, " m"], Int[Array, " m"]]:
        """Those of the given columns that touch a row: their positions in ``index[row]``, and in ``columns``."""
        positions = self._position_in_row[row][columns]
        touching = np.flatnonzero(positions >= 0)
        return positions[touching], touching

    def of_row(self, row: int, chosen: Int[Array, " m"]) -> Float[Array, "B m m"]:
        """Products in one row among some of the columns that touch it, given by their positions in ``index[row]``."""
        return square(self.values[row], chosen)

    def column_of_row(self, row: int, chosen: Int[Array, " m"], number: int) -> Float[Array, "B m"]:
        """Column ``number`` of the matrices of `of_row`."""
        return self.values[row][:, place_of(chosen, chosen[number])]

    def squares_of_row(self, row: int, chosen: Int[Array, " m"], x: Float[Array, "B m"]) -> Float[Array, " B"]:
        """``x a x`` of each block, where ``a`` is the matrix of `of_row`."""
        out = np.zeros(len(x))
        _square(out, self.values[row], chosen, np.ascontiguousarray(x), 0)
        return out

    def grouped(self, groups: Int[Array, " B"]) -> RowProducts:
        """Sums over the blocks of each group; groups are numbered from zero, and a negative group is left out."""
        if np.array_equal(groups, np.arange(self.shape[0])):
            return self
        chosen = [np.flatnonzero(groups == group) for group in range(int(groups.max(initial=-1)) + 1)]
        values = tuple(np.stack([_total(v, blocks) for blocks in chosen]) for v in self.values)
        return RowProducts(self.index, values, self.columns, self.always)

    def squares(self, columns: Int[Array, " k"], x: Float[Array, "B k"]) -> Float[Array, " B"]:
        """``x a x`` of each block, where ``a`` is the matrix of products among some columns."""
        n_always = self._n_always(columns)
        x0 = np.ascontiguousarray(x[:, :n_always])
        out = (
            np.einsum("bi,bi->b", (self._among_always @ x0[:, :, None])[:, :, 0], x0) if n_always else np.zeros(len(x))
        )
        for position, values in zip(self._position_in_row, self.values, strict=True):
            positions = position[columns]
            touching = np.flatnonzero(positions >= 0)
            _square(
                out,
                values,
                positions[touching],
                np.ascontiguousarray(x[:, touching]),
                int(np.count_nonzero(touching < n_always)),
            )
        return out

    def total(self) -> Float[Array, "K K"]:
        """Sum over all blocks as a full matrix."""
        out = np.zeros((self.columns, self.columns))
        for index, values in zip(self.index, self.values, strict=True):
            out[np.ix_(index, index)] += square(values.sum(axis=0))
        return out

    def within(self, groups: Int[Array, "g m"]) -> Float[Array, "B g m m"]:
        """Products among the columns of each group."""
        out = np.zeros((self.shape[0], *groups.shape, groups.shape[1]))
        for position, values in zip(self._position_in_row, self.values, strict=True):
            positions = position[groups]
            touches = positions >= 0
            with_touch = np.flatnonzero(touches.any(axis=1))
            mask, clipped = touches[with_touch], np.maximum(positions[with_touch], 0)
            products = values[:, place_of(clipped[:, :, None], clipped[:, None, :])]
            out[:, with_touch] += products * (mask[:, :, None] & mask[:, None, :])
        return out

    def _n_always(self, columns: Int[Array, " k"]) -> int:
        """Length of ``always`` if the given columns begin with it, else zero."""
        count = len(self.always)
        return count if np.array_equal(columns[:count], self.always) else 0

    @cached_property
    def _among_always(self) -> Float[Array, "B n n"]:
        """Products among the columns of every fit."""
        return RowProducts(self.index, self.values, self.columns).among(self.always)

    @cached_property
    def _position_in_row(self) -> tuple[Int[Array, " K"], ...]:
        """For each row, the position of each column in its ``index``; -1 for columns that do not touch the row."""
        out = np.full((len(self.index), self.columns), -1)
        for positions, index in zip(out, self.index, strict=True):
            positions[index] = np.arange(len(index))
        return tuple(out)


def _total(values: Float[Array, "B n"], blocks: Int[Array, " m"]) -> Float[Array, " n"]:
    """Sum over some blocks; indexing with all of them at once would copy them."""
    out = np.zeros(values.shape[1:])
    for block in blocks:
        out += values[block]
    return out


@fused
def _square(out: Array, values: Array, source: Array, x: Array, skipped: int) -> None:
    """Add ``x values[:, source, source] x`` to ``out``, without the products among the first ``skipped`` columns."""
    for block in range(len(out)):
        for i in range(skipped, len(source)):
            s = source[i]
            row_start = s * (s + 1) // 2
            inner = 0.5 * values[block, row_start + s] * x[block, i]
            for k in range(i):
                t = source[k]
                inner += values[block, row_start + t if t < s else t * (t + 1) // 2 + s] * x[block, k]
            out[block] += 2.0 * inner * x[block, i]


@jit
def _add(out: Array, values: Array, source: Array, target: Array, skipped: int) -> None:
    """Add ``values[:, source, source]`` to ``out[:, target, target]``, except among the first ``skipped`` columns."""
    for block in range(len(out)):
        for i in range(skipped, len(target)):
            s = source[i]
            row_start = s * (s + 1) // 2
            for k in range(i):
                t = source[k]
                value = values[block, row_start + t if t < s else t * (t + 1) // 2 + s]
                out[block, target[i], target[k]] += value
                out[block, target[k], target[i]] += value
            out[block, target[i], target[i]] += values[block, row_start + s]
