"""Finite impulse response filter followed by downsampling; it computes only the samples that are kept."""

from __future__ import annotations

import math

import numpy as np

from phantom_dyn.array_types import Array

# Largest number of samples of one block: larger blocks are not faster, as their matrix has more zeros.
_LARGEST_BLOCK = 32
# Number of samples of a column that are read first to find out whether the column is zero.
_FIRST_LOOK = 1000


def filtered(kernel: Array, x: Array, step: int) -> Array:
    """Every ``step``-th sample of ``x``, filtered by a symmetric kernel; samples near the ends are left out.

    A block of filtered samples is the product of input samples and a matrix, each column of which is the kernel shifted
    by one more step. One product computes all blocks of a column of ``x``. Columns of ``x`` are filtered one by one, so
    that the last digit of a column does not depend on the other columns.

    Args:
        kernel: Symmetric and of odd length m, ``(m,)``.
        x: Samples, ``(N, k)``.
        step: Number of input samples per output sample.

    Returns:
        Filtered samples ``m // 2``, ``m // 2 + step``, and so on, up to ``m // 2`` samples before the end of ``x``,
        shape ``(n, k)``: those for which the whole kernel is inside ``x``.
    """
    taps = len(kernel)
    count = len(range(0, len(x) - taps + 1, step))
    out = np.empty((count, x.shape[1]))
    if not count:
        return out
    rows = max(1, min(_LARGEST_BLOCK, taps // step))
    # Blocks begin ``length`` input samples apart. A block needs more input samples than this, so they are divided into
    # pieces of ``length`` samples. The first pieces of all blocks are the rows of one matrix, without a copy, and so
    # are the second pieces: there is one matrix product for each piece.
    length, blocks = rows * step, math.ceil(count / rows)
    pieces = math.ceil((length - step + taps) / length)
    shifted_kernels = np.zeros((pieces * length, rows))
    for row in range(rows):
        shifted_kernels[row * step : row * step + taps, row] = kernel
    # Zeros after the last sample fill the last block.
    samples = np.zeros((blocks + pieces - 1, length))
    given = samples.ravel()[: len(x)]
    product = np.empty((blocks, rows))
    for column in range(x.shape[1]):
        given[:] = x[: len(given), column]
        # Most columns that are not zero have a nonzero sample among a few; all samples are read only if these are zero.
        if not (given[:: len(given) // _FIRST_LOOK + 1].any() or given.any()):
            out[:, column] = 0.0
            continue
        np.matmul(samples[:blocks], shifted_kernels[:length], out=product)
        for piece in range(1, pieces):
            product += samples[piece : piece + blocks] @ shifted_kernels[piece * length : (piece + 1) * length]
        out[:, column] = product.ravel()[:count]
    return out
