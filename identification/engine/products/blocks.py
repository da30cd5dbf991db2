"""Blocks of samples, and the folds in which they are held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Bool, Int

FOLDS = 8  # so each fit uses seven eighths of the blocks; every further fold costs a further fit


@dataclass(frozen=True)
class Block:
    """A stretch of samples of one series.

    Attributes:
        log: Index of the series.
        start: Index of the first sample.
        stop: Index after the last sample.
        core: Index of the first sample of the core. The samples before it share noise with the previous block, because
            the filter spreads noise.
    """

    log: int
    start: int
    stop: int
    core: int


def held_out_share(blocks: Sequence[Block]) -> float:
    """Share of the samples that are in the cores, on which held-out losses are computed."""
    return sum(b.stop - b.core for b in blocks) / sum(b.stop - b.start for b in blocks)


def assign_folds(blocks: Sequence[Block], held_out: Bool[np.ndarray, " logs"]) -> Int[np.ndarray, " B"]:
    """Fold of each block, in turn, so that each fold covers all series; -1 for blocks of series held out entirely."""
    folds = np.full(len(blocks), -1)
    seen = [k for k, block in enumerate(blocks) if not held_out[block.log]]
    folds[seen] = np.arange(len(seen)) % min(FOLDS, max(2, len(seen)))
    return folds
