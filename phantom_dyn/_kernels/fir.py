"""A finite impulse response filter that computes only the samples that are kept."""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit

Array = np.ndarray


@jit
def filtered(kernel: Array, x: Array, step: int) -> Array:
    """Every ``step``-th sample of ``x`` behind a symmetric kernel, only where the kernel lies inside ``x``.

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
    for column in range(x.shape[1]):
        samples = x[:, column].copy()
        for k in range(count):
            out[k, column] = np.dot(kernel, samples[k * step : k * step + taps])
    return out
