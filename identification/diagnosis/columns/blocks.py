"""Blocks of recordings: how long what is held out together is."""

from __future__ import annotations

import itertools

import numpy as np

from identification.data.log import Log
from identification.engine.products.blocks import Block


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
