"""Divides recordings into blocks, stretches of samples that are held out of fits together."""

from __future__ import annotations

import itertools

import numpy as np

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from identification.engine.products.blocks import FOLDS, Block
from phantom_dyn.array_types import Float, Int

# Largest share of a joint's travel in all logs that a piece of a divided block has. With pieces of this size, every
# fold may contain a part of the travel.
_PIECE = 1.0 / FOLDS

# A block is divided if its share of a joint's travel is more than this many times the mean share of a block.
_UNEVEN = 2.0

# Shortest piece of a divided block, in periods of the judged band's edge: a shorter one has no independent samples.
_SHORTEST = 0.5


def split_blocks(logs: tuple[Log, ...], cutoff_hz: float) -> tuple[Block, ...]:
    """Blocks of at least a second and five periods of the judged band's edge, some twelve to twenty-four in all.

    If a joint moves only once, all information on its friction is in one block, and fits to the other blocks cannot
    predict that block. So it is divided into shorter blocks, each with an equal part of the joint's travel.

    The core of a block leaves out samples at its start, over half the length of the filter's kernel, because the filter
    spreads noise from the block before into them.
    """
    period = 1.0 / cutoff_hz
    total = sum(log.motion.t[-1] - log.motion.t[0] for log in logs)
    length = max(1.0, min(5 * period, total / 12), total / 24)
    speeds = [np.abs(log.motion.v[log.samples]) for log in logs]
    travelled = sum(v.sum(axis=0) / log.band.output_rate_hz for log, v in zip(logs, speeds, strict=True))
    every = [
        np.linspace(0, len(v), max(1, round(len(v) / log.band.output_rate_hz / length)) + 1).astype(int)
        for log, v in zip(logs, speeds, strict=True)
    ]
    # A recording that is too short to hold data out is not divided further.
    count = sum(len(edges) - 1 for edges in every)
    most = max(_PIECE, _UNEVEN / count) if count >= rules.LEAST_BLOCKS else 1.0
    blocks = []
    for k, (log, uniform) in enumerate(zip(logs, every, strict=True)):
        rate = log.band.output_rate_hz
        shares = speeds[k] / (rate * np.maximum(travelled, 1e-300))
        shortest = max(int(_SHORTEST * rate / cutoff_hz), 2)
        edges = _cut_by_travel(uniform, shares, most, shortest)
        guard = int(np.ceil(log.band.half / log.band.step))
        for i, (start, stop) in enumerate(itertools.pairwise(edges)):
            core = start + (guard if i and guard < (stop - start) // 2 else 0)
            blocks.append(Block(k, int(start), int(stop), int(core)))
    return tuple(blocks)


def _cut_by_travel(
    edges: Int[np.ndarray, " e"], shares: Float[np.ndarray, "n nv"], most: float, shortest: int
) -> Int[np.ndarray, " f"]:
    """Edges of blocks after division of those blocks that have a large share of a joint's travel.

    Args:
        edges: First samples of the blocks, and the end of the last.
        shares: Share of each joint's travel in each sample.
        most: Share above which a block is divided.
        shortest: Least number of samples of a block.
    """
    travel = np.vstack([np.zeros(shares.shape[1]), np.cumsum(shares, axis=0)])
    out = [int(edges[0])]
    for start, stop in itertools.pairwise(edges):
        own = travel[stop] - travel[start]
        joint = int(np.argmax(own))
        if own[joint] > most:
            pieces = int(np.ceil(own[joint] / _PIECE))
            levels = travel[start, joint] + own[joint] * np.arange(1, pieces) / pieces
            for cut in start + np.searchsorted(travel[start:stop, joint], levels):
                if min(cut - out[-1], stop - cut) >= shortest:
                    out.append(int(cut))
        out.append(int(stop))
    return np.array(out)
