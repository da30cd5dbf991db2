"""Blocks of samples: what is held out together."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from phantom_dyn.array_types import Bool, Int

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
