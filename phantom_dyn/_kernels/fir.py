"""A finite impulse response filter that computes only the samples that are kept."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array

_AT_ONCE = 32
"""Most samples of one block: more of them are not faster, and their matrix has more zeros."""
_LOOKED_AT = 1000
"""Samples of a column by which most are known not to be zero."""


def filtered(kernel: Array, x: Array, step: int) -> Array:
    """Every ``step``-th sample of ``x`` behind a symmetric kernel, only where the kernel lies inside ``x``.

    A block of samples is the product of a matrix, whose rows are the kernel moved on by a step each, with what lies
    under it; all blocks of a column are one product. Column by column, so that none depends on which others there are,
    not even in its last digit.

    Args:
        kernel: Of odd length m and symmetric, ``(m,)``.
        x: Samples, ``(N, k)``.
        step: How many samples go on from one that is kept to the next.

    Returns:
        Shape ``(n, k)``: sample ``m // 2`` and every ``step``-th one after it that has ``m // 2`` behind it.
    """
    taps = len(kernel)
    count = max(0, -(-(len(x) - taps + 1) // step))
    out = np.empty((count, x.shape[1]))
    if not count:
        return out
    rows = max(1, min(_AT_ONCE, taps // step))
    # What lies under the kernel of a block is cut into pieces as long as a block goes on: then the pieces of all
    # blocks are one matrix without a copy, and the blocks one product for each piece of the kernel.
    length, blocks = rows * step, -(-count // rows)
    pieces = -(-(length - step + taps) // length)
    moved = np.zeros((pieces * length, rows))
    for row in range(rows):
        moved[row * step : row * step + taps, row] = kernel
    # Zeros behind the end fill the last block.
    samples = np.zeros((blocks + pieces - 1, length))
    given = samples.ravel()[: len(x)]
    kept = np.empty((blocks, rows))
    for column in range(x.shape[1]):
        given[:] = x[: len(given), column]
        # A few samples suffice to see that most columns are not zero; all are read only if these are zero.
        if not (given[:: len(given) // _LOOKED_AT + 1].any() or given.any()):
            out[:, column] = 0.0
            continue
        np.matmul(samples[:blocks], moved[:length], out=kept)
        for piece in range(1, pieces):
            kept += samples[piece : piece + blocks] @ moved[piece * length : (piece + 1) * length]
        out[:, column] = kept.ravel()[:count]
    return out
