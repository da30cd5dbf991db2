"""Blocks of samples: what is held out together, and the Gram matrices that every fit works on."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identification.data.log import Log
from identification.diagnosis.fit.row_products import RowProducts
from identification.diagnosis.model.columns import Columns
from identification.diagnosis.numerics.two_threads import two_at_a_time

Array = np.ndarray

FOLDS = 8


@dataclass(frozen=True)
class Block:
    """A stretch of in-band samples of one log.

    Attributes:
        log: Index of the log.
        start: First sample.
        stop: One after the last.
        core: First sample of its core: earlier ones share noise with the block before, through the filter.
    """

    log: int
    start: int
    stop: int
    core: int


def held_out_share(blocks: tuple[Block, ...]) -> float:
    """Share of the samples that are judged while they are held out: those of the cores."""
    return sum(b.stop - b.core for b in blocks) / sum(b.stop - b.start for b in blocks)


@dataclass(frozen=True)
class Weights:
    """Noise of each row: a squared residual counts ``1 / (floor^2 * spread)``.

    Attributes:
        floor: Noise floor [torque unit], shape ``(nv,)``.
        spread: How many samples of coloured noise tell as much as one of white noise, shape ``(nv,)``.
    """

    floor: Float[Array, " nv"]
    spread: Float[Array, " nv"]

    @property
    def per_sample(self) -> Float[Array, " nv"]:
        """Weight of a squared residual on each row."""
        return 1.0 / (self.floor**2 * self.spread)


@dataclass(frozen=True)
class RowGrams:
    """Weighted products of one row's columns and residual, block by block.

    Attributes:
        index: Which of all columns, ``(k,)``.
        a: Columns times columns over whole blocks, ``(B, k, k)``.
        b: Columns times residual, ``(B, k)``.
        c: Residual times residual, ``(B,)``.
        core_a, core_b, core_c: The same over the cores of blocks.
        count: Effective number of samples in each core, ``(B,)``.
    """

    index: Int[Array, " k"]
    a: Float[Array, "B k k"]
    b: Float[Array, "B k"]
    c: Float[Array, " B"]
    core_a: Float[Array, "B k k"]
    core_b: Float[Array, "B k"]
    core_c: Float[Array, " B"]
    count: Float[Array, " B"]


@dataclass(frozen=True)
class Grams:
    """Products of all columns and the residual, block by block, rows summed with their weights.

    Attributes:
        rows: The rows that were summed.
        a: Columns times columns over whole blocks, as if ``(B, K, K)``.
        b: Columns times residual, ``(B, K)``.
        c: Residual times residual, ``(B,)``.
        core_a, core_b, core_c: The same over the cores of blocks, on which fits of other blocks are judged.
        fold: Which blocks are held out together, ``(B,)``; -1 for blocks that no fit may see.
        count: Effective number of samples in each core, ``(B,)``.
    """

    rows: tuple[RowGrams, ...]
    a: RowProducts
    b: Float[Array, "B K"]
    c: Float[Array, " B"]
    core_a: RowProducts
    core_b: Float[Array, "B K"]
    core_c: Float[Array, " B"]
    fold: Int[Array, " B"]
    count: Float[Array, " B"]

    @cached_property
    def fold_a(self) -> RowProducts:
        """Columns times columns, summed over the blocks of each fold."""
        return self.a.grouped(self.fold)

    def by_fold(self, series: Float[Array, "B ..."]) -> Float[Array, "F ..."]:
        """What is known of each block, summed over the blocks of each fold."""
        return np.stack([series[self.fold == fold].sum(axis=0) for fold in range(int(self.fold.max()) + 1)])


def split_blocks(logs: tuple[Log, ...], cutoff_hz: float) -> tuple[Block, ...]:
    """Blocks of at least a second and five periods of the judged band's edge, some twelve to twenty-four in all.

    The core leaves out as many samples as the filter's kernel reaches, so that the noise of a core is not that of
    the block before it.
    """
    period = 1.0 / cutoff_hz
    total = sum(log.motion.t[-1] - log.motion.t[0] for log in logs)
    length = max(1.0, min(5 * period, total / 12), total / 24)
    blocks = []
    for k, log in enumerate(logs):
        count = len(log.samples)
        rate = log.band.rate_hz / log.band.step
        parts = max(1, round(count / rate / length))
        edges = np.linspace(0, count, parts + 1).astype(int)
        guard = int(np.ceil(log.band.half / log.band.step))
        for i, (start, stop) in enumerate(itertools.pairwise(edges)):
            core = start + (guard if i and guard < (stop - start) // 2 else 0)
            blocks.append(Block(k, int(start), int(stop), int(core)))
    return tuple(blocks)


def assign_folds(blocks: tuple[Block, ...], held_out: Bool[Array, " logs"]) -> Int[Array, " B"]:
    """Fold of each block, in turn, so that every fold covers the whole recording; -1 for logs held out entirely."""
    folds = np.full(len(blocks), -1)
    seen = [k for k, block in enumerate(blocks) if not held_out[block.log]]
    folds[seen] = np.arange(len(seen)) % min(FOLDS, max(2, len(seen)))
    return folds


def row_grams(columns: Columns, blocks: tuple[Block, ...], weights: Weights, row: int) -> RowGrams:
    """Products of one row.

    Args:
        columns: All columns.
        blocks: Of the same logs.
        weights: Noise per row.
        row: Which joint's torque.
    """
    weight = weights.per_sample[row]
    size = len(columns.rows[row]) + 1
    whole, core, count = np.empty((len(blocks), size, size)), np.empty((len(blocks), size, size)), np.empty(len(blocks))
    for k, block in enumerate(blocks):
        part = slice(block.start, block.stop)
        use = columns.usable[block.log][part, row]
        # One product of the columns with the residual beside them gives all three.
        x, residual = columns.values[block.log][row][part], columns.residual[block.log][part, row]
        joined = np.column_stack([x, residual] if use.all() else [x[use], residual[use]])
        np.matmul(joined.T, joined, out=whole[k])
        # The core is the block less its first few samples.
        guard = joined[: int(np.searchsorted(np.flatnonzero(use), block.core - block.start))]
        np.matmul(guard.T, guard, out=core[k])
        np.subtract(whole[k], core[k], out=core[k])
        count[k] = (len(joined) - len(guard)) / weights.spread[row]
    whole *= weight
    core *= weight
    return RowGrams(
        index=np.array(columns.rows[row]),
        a=whole[:, :-1, :-1],
        b=whole[:, :-1, -1],
        c=whole[:, -1, -1],
        core_a=core[:, :-1, :-1],
        core_b=core[:, :-1, -1],
        core_c=core[:, -1, -1],
        count=count,
    )


def build_grams(columns: Columns, blocks: tuple[Block, ...], folds: Int[Array, " B"], weights: Weights) -> Grams:
    """Products of all rows, summed."""
    rows = tuple(two_at_a_time(lambda row: row_grams(columns, blocks, weights, row), range(len(columns.rows))))
    count, total = len(blocks), len(columns.names)
    index, always = tuple(row.index for row in rows), len(columns.nuisances)
    a = RowProducts(index, tuple(row.a for row in rows), total, always)
    core_a = RowProducts(index, tuple(row.core_a for row in rows), total, always)
    b, core_b = np.zeros((count, total)), np.zeros((count, total))
    for row in rows:
        b[:, row.index] += row.b
        core_b[:, row.index] += row.core_b
    c, core_c, samples = (sum(getattr(row, name) for row in rows) for name in ("c", "core_c", "count"))
    return Grams(rows, a, b, np.asarray(c), core_a, core_b, np.asarray(core_c), folds, np.asarray(samples))
