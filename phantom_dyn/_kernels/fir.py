"""Finite impulse response filter followed by downsampling; it computes only the samples that are kept."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array

# Largest number of samples of one block: larger blocks are not faster, as their matrix has more zeros.
_LARGEST_BLOCK = 32
# Number of samples that are first checked to see whether a column is zero.
_FIRST_LOOK = 1000


def filtered(kernel: Array, x: Array, step: int) -> Array:
    """Every ``step``-th sample of ``x``, filtered by a symmetric kernel, where the whole kernel lies inside ``x``.

    A block of filtered samples is a matrix product: each row of the matrix is the kernel, shifted by one more step. One
    product computes all blocks of a column. Columns are filtered one by one, so that the last digit of a column does
    not depend on the other columns.

    Args:
        kernel: Symmetric and of odd length m, ``(m,)``.
        x: Samples, ``(N, k)``.
        step: Number of samples from one that is kept to the next.

    Returns:
        Shape ``(n, k)``: filtered sample ``m // 2`` of ``x``, then every ``step``-th one, up to ``m // 2`` samples
        before the end.
    """
    taps = len(kernel)
    count = max(0, -(-(len(x) - taps + 1) // step))
    out = np.empty((count, x.shape[1]))
    if not count:
        return out
    rows = max(1, min(_LARGEST_BLOCK, taps // step))
    # The samples that a block needs are cut into pieces whose length is the distance from block to block. So the pieces
    # of all blocks are one matrix without a copy, and there is one matrix product for each piece of the kernel.
    length, blocks = rows * step, -(-count // rows)
    pieces = -(-(length - step + taps) // length)
    shifted_kernels = np.zeros((pieces * length, rows))
    for row in range(rows):
        shifted_kernels[row * step : row * step + taps, row] = kernel
    # Zeros after the last sample fill the last block.
    samples = np.zeros((blocks + pieces - 1, length))
    given = samples.ravel()[: len(x)]
    kept = np.empty((blocks, rows))
    for column in range(x.shape[1]):
        given[:] = x[: len(given), column]
        # In most columns that are not zero a few samples already show it; all are read only if these are zero.
        if not (given[:: len(given) // _FIRST_LOOK + 1].any() or given.any()):
            out[:, column] = 0.0
            continue
        np.matmul(samples[:blocks], shifted_kernels[:length], out=kept)
        for piece in range(1, pieces):
            kept += samples[piece : piece + blocks] @ shifted_kernels[piece * length : (piece + 1) * length]
        out[:, column] = kept.ravel()[:count]
    return out
