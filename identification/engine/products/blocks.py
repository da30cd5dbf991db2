"""Blocks of samples, and the folds in which they are held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Bool, Int

FOLDS = 8  # each fit sees seven eighths of the blocks; more folds cost as many fits more


@dataclass(frozen=True)
class Block:
    """A stretch of samples of one series.

    Attributes:
        log: Index of the series.
        start: First sample.
        stop: One after the last.
        core: First sample of its core: earlier ones share noise with the block before, through the filter.
    """

    log: int
    start: int
    stop: int
    core: int


def held_out_share(blocks: Sequence[Block]) -> float:
    """Share of the samples that are judged while they are held out: those of the cores."""
    return sum(b.stop - b.core for b in blocks) / sum(b.stop - b.start for b in blocks)


def assign_folds(blocks: Sequence[Block], held_out: Bool[np.ndarray, " logs"]) -> Int[np.ndarray, " B"]:
    """Fold of each block; folds take turns, so that each covers all series. It is -1 for series held out entirely."""
    folds = np.full(len(blocks), -1)
    seen = [k for k, block in enumerate(blocks) if not held_out[block.log]]
    folds[seen] = np.arange(len(seen)) % min(FOLDS, max(2, len(seen)))
    return folds
