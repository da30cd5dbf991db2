"""Blocks of recordings: how long what is held out together is."""

from __future__ import annotations

import itertools

import numpy as np

from identification.data.log import Log
from identification.engine.products.blocks import FOLDS, Block
from phantom_dyn.array_types import Float, Int

# share: of what a joint travels in all logs. A block with more is cut: no other shows what this one does.
_MOST_TRAVEL = 2.0 / FOLDS

# share: of the same, in each of its pieces.
_PIECE = 1.0 / FOLDS

# periods of the judged band's edge: a shorter block holds no value of its own.
_SHORTEST = 0.5


def split_blocks(logs: tuple[Log, ...], cutoff_hz: float) -> tuple[Block, ...]:
    """Blocks of at least a second and five periods of the judged band's edge, some twelve to twenty-four in all.

    A joint that moves once and rests else shows all of its friction in one of them, and nothing foresees that one while
    it is held out: such a block is cut into shorter ones, each with an equal part of the joint's travel.

    The core leaves out as many samples as the filter's kernel reaches, so that the noise of a core is not that of
    the block before it.
    """
    period = 1.0 / cutoff_hz
    total = sum(log.motion.t[-1] - log.motion.t[0] for log in logs)
    length = max(1.0, min(5 * period, total / 12), total / 24)
    speeds = [np.abs(log.motion.v[log.samples]) for log in logs]
    travelled = sum(log.band.step / log.band.rate_hz * v.sum(axis=0) for log, v in zip(logs, speeds, strict=True))
    blocks = []
    for k, log in enumerate(logs):
        count = len(log.samples)
        rate = log.band.rate_hz / log.band.step
        parts = max(1, round(count / rate / length))
        edges = np.linspace(0, count, parts + 1).astype(int)
        shortest = max(int(_SHORTEST * rate / cutoff_hz), 2)
        edges = _cut_by_travel(edges, speeds[k] / (rate * np.maximum(travelled, 1e-300)), shortest)
        guard = int(np.ceil(log.band.half / log.band.step))
        for i, (start, stop) in enumerate(itertools.pairwise(edges)):
            core = start + (guard if i and guard < (stop - start) // 2 else 0)
            blocks.append(Block(k, int(start), int(stop), int(core)))
    return tuple(blocks)


def _cut_by_travel(
    edges: Int[np.ndarray, " e"], shares: Float[np.ndarray, "n nv"], shortest: int
) -> Int[np.ndarray, " f"]:
    """Edges of blocks, with more of them where one block holds much of what a joint travels.

    Args:
        edges: First samples of the blocks, and the end of the last.
        shares: Of its travel that each joint makes in a sample.
        shortest: Samples that a block has at least.
    """
    travel = np.vstack([np.zeros(shares.shape[1]), np.cumsum(shares, axis=0)])
    out = [int(edges[0])]
    for start, stop in itertools.pairwise(edges):
        own = travel[stop] - travel[start]
        joint = int(np.argmax(own))
        if own[joint] > _MOST_TRAVEL:
            pieces = int(np.ceil(own[joint] / _PIECE))
            levels = travel[start, joint] + own[joint] * np.arange(1, pieces) / pieces
            for cut in start + np.searchsorted(travel[start:stop, joint], levels):
                if min(cut - out[-1], stop - cut) >= shortest:
                    out.append(int(cut))
        out.append(int(stop))
    return np.array(out)
