"""Products of all columns, kept row by row: columns on different rows have none, and most are on one row only.

As full matrices, those of a robot with six joints would have a thousand columns for each block of samples, and nine
tenths of them would be zero. Of each row the lower triangle is kept (see `products.triangles`), by symmetry.
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
    """Columns times columns, block by block; rows are summed on demand.

    Attributes:
        index: For each row, which of all columns touch it.
        values: For each row, products of these as triangles, ``(B, k (k + 1) / 2)``.
        columns: How many columns there are in all.
        always: Columns that every fit contains, the first of its columns, ``(m,)``.
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
        """Products among some columns, which are all different."""
        out = np.zeros((self.shape[0], len(columns), len(columns)))
        known = self._known(columns)
        if known:
            out[:, :known, :known] = self._first
        for place, values in zip(self._places, self.values, strict=True):
            here = place[columns]
            into = np.flatnonzero(here >= 0)
            _add(out, values, here[into], into, int(np.count_nonzero(into < known)))
        return out

    def between(self, left: Int[Array, " k"], right: Int[Array, " m"]) -> Float[Array, "B k m"]:
        """Products of some columns with others."""
        out = np.zeros((self.shape[0], len(left), len(right)))
        for place, values in zip(self._places, self.values, strict=True):
            up, across = place[left], place[right]
            rows, columns = np.flatnonzero(up >= 0), np.flatnonzero(across >= 0)
            if len(rows) and len(columns):
                out[:, rows[:, None], columns] += values[:, place_of(up[rows][:, None], across[columns])]
        return out

    def diagonal(self, columns: Int[Array, " k"]) -> Float[Array, "B k"]:
        """Products of some columns with themselves."""
        out = np.zeros((self.shape[0], len(columns)))
        for place, values in zip(self._places, self.values, strict=True):
            here = place[columns]
            into = np.flatnonzero(here >= 0)
            out[:, into] += diagonal(values, here[into])
        return out

    def in_row(self, row: int, columns: Int[Array, " k"]) -> tuple[Int[Array, " m"], Int[Array, " m"]]:
        """Those of some columns that touch one row: their places in the row, and among these columns."""
        here = self._places[row][columns]
        at = np.flatnonzero(here >= 0)
        return here[at], at

    def of_row(self, row: int, chosen: Int[Array, " m"]) -> Float[Array, "B m m"]:
        """Products of one row alone among some of the columns that touch it, by their places there."""
        return square(self.values[row], chosen)

    def column_of_row(self, row: int, chosen: Int[Array, " m"], own: int) -> Float[Array, "B m"]:
        """Of `of_row` the column with the number ``own``."""
        return self.values[row][:, place_of(chosen, chosen[own])]

    def squares_of_row(self, row: int, chosen: Int[Array, " m"], x: Float[Array, "B m"]) -> Float[Array, " B"]:
        """For each block ``x a x`` with its own ``x``, where ``a`` is that of `of_row`."""
        out = np.zeros(len(x))
        _square(out, self.values[row], chosen, np.ascontiguousarray(x), 0)
        return out

    def grouped(self, groups: Int[Array, " B"]) -> RowProducts:
        """Sums over the blocks of each group; groups count from zero, blocks below that belong to none."""
        if np.array_equal(groups, np.arange(self.shape[0])):
            return self
        chosen = [np.flatnonzero(groups == group) for group in range(int(groups.max(initial=-1)) + 1)]
        values = tuple(np.stack([_total(v, blocks) for blocks in chosen]) for v in self.values)
        return RowProducts(self.index, values, self.columns, self.always)

    def squares(self, columns: Int[Array, " k"], x: Float[Array, "B k"]) -> Float[Array, " B"]:
        """For each block ``x a x`` with its own ``x`` among some columns, which are all different."""
        known = self._known(columns)
        first = np.ascontiguousarray(x[:, :known])
        out = np.einsum("bi,bi->b", (self._first @ first[:, :, None])[:, :, 0], first) if known else np.zeros(len(x))
        for place, values in zip(self._places, self.values, strict=True):
            here = place[columns]
            into = np.flatnonzero(here >= 0)
            _square(out, values, here[into], np.ascontiguousarray(x[:, into]), int(np.count_nonzero(into < known)))
        return out

    def sum(self, axis: int = 0) -> Float[Array, "K K"]:  # noqa: ARG002 - asked as an array of all products is
        """Sum over all blocks as a full matrix; ``axis`` is zero, as of an array."""
        out = np.zeros((self.columns, self.columns))
        for index, values in zip(self.index, self.values, strict=True):
            out[np.ix_(index, index)] += square(values.sum(axis=0))
        return out

    def within(self, groups: Int[Array, "g m"]) -> Float[Array, "B g m m"]:
        """Products among the columns of each group."""
        out = np.zeros((self.shape[0], *groups.shape, groups.shape[1]))
        for place, values in zip(self._places, self.values, strict=True):
            here = place[groups]
            there = here >= 0
            some = np.flatnonzero(there.any(axis=1))
            inside, at = there[some], np.maximum(here[some], 0)
            products = values[:, place_of(at[:, :, None], at[:, None, :])]
            out[:, some] += products * (inside[:, :, None] & inside[:, None, :])
        return out

    def __getitem__(self, key: int | Array | tuple[slice, list[int] | Array]) -> Float[Array, "*B k K"]:
        """Blocks written out: ``[block]``, ``[blocks]`` or, in all blocks, some columns with all: ``[:, columns]``."""
        if isinstance(key, tuple):
            chosen = np.asarray(key[1])
            part = np.zeros((self.shape[0], len(chosen), self.columns))
            for place, index, values in zip(self._places, self.index, self.values, strict=True):
                here = place[chosen]
                into = np.flatnonzero(here >= 0)
                if len(into):
                    part[:, into[:, None], index] += values[:, place_of(here[into][:, None], np.arange(len(index)))]
            return part
        blocks = np.atleast_1d(np.arange(self.shape[0])[key])
        out = np.zeros((len(blocks), self.columns, self.columns))
        for index, values in zip(self.index, self.values, strict=True):
            _add(out, values[blocks], np.arange(len(index)), index, 0)
        return out[0] if isinstance(key, int | np.integer) else out

    def __array__(self, dtype: object = None, copy: bool | None = None) -> Array:
        """All blocks as full matrices."""
        return self[np.arange(self.shape[0])]

    def _known(self, columns: Int[Array, " k"]) -> int:
        """How many of the first ones are, in order, the columns of every fit."""
        count = len(self.always)
        return count if np.array_equal(columns[:count], self.always) else 0

    @cached_property
    def _first(self) -> Float[Array, "B n n"]:
        """Among the columns of every fit."""
        return RowProducts(self.index, self.values, self.columns).among(self.always)

    @cached_property
    def _places(self) -> tuple[Int[Array, " K"], ...]:
        """For each row, the place of each column in it; -1 for columns that do not touch it."""
        out = np.full((len(self.index), self.columns), -1)
        for place, index in zip(out, self.index, strict=True):
            place[index] = np.arange(len(index))
        return tuple(out)


def _total(values: Float[Array, "B n"], blocks: Int[Array, " m"]) -> Float[Array, " n"]:
    """Sum over some blocks, without a copy of them."""
    out = np.zeros(values.shape[1:])
    for block in blocks:
        out += values[block]
    return out


@fused
def _square(out: Array, values: Array, source: Array, x: Array, known: int) -> None:
    """Add ``x values[:, source, source] x`` to ``out`` but for what is among the first ``known`` of them."""
    for block in range(len(out)):
        for i in range(known, len(source)):
            s = source[i]
            line = s * (s + 1) // 2
            inner = 0.5 * values[block, line + s] * x[block, i]
            for k in range(i):
                t = source[k]
                inner += values[block, line + t if t < s else t * (t + 1) // 2 + s] * x[block, k]
            out[block] += 2.0 * inner * x[block, i]


@jit
def _add(out: Array, values: Array, source: Array, into: Array, known: int) -> None:
    """Add ``values[:, source, source]`` to ``out[:, into, into]`` but for what is among the first ``known`` of them."""
    for block in range(len(out)):
        for i in range(known, len(into)):
            s = source[i]
            line = s * (s + 1) // 2
            for k in range(i):
                t = source[k]
                value = values[block, line + t if t < s else t * (t + 1) // 2 + s]
                out[block, into[i], into[k]] += value
                out[block, into[k], into[i]] += value
            out[block, into[i], into[i]] += values[block, line + s]
