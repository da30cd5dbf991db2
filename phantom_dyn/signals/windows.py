"""What a window that moves over samples sees: its extremes, its mean, its median.

`scipy.ndimage` has the same; importing it takes longer than all that a small command does with it. It is the oracle of
the tests.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from phantom_dyn.array_types import Float

Array = np.ndarray

# From so many samples on, medians one by one take longer than the import of those that follow the window.
_MANY = 4000


def highest(x: Array, width: int) -> Array:
    """Largest value in a window of ``width`` samples about each one, along the first axis; of booleans, if any is true.

    Where the window reaches beyond an end, what is inside counts. A window of an even width reaches further back.
    """
    return _extreme(np.maximum, x, width, False if x.dtype == bool else -np.inf)


def lowest(x: Float[Array, "N ..."], width: int) -> Float[Array, "N ..."]:
    """Smallest value in a window, see `highest`."""
    return _extreme(np.minimum, x, width, np.inf)


def _extreme(better: np.ufunc, x: Array, width: int, worst: float) -> Array:
    """Extremes of windows that are made of two each of half their length or more, until they are wide enough."""
    before, behind = (min(part, len(x)) for part in (width // 2, width - 1 - width // 2))
    width = before + behind + 1
    ends = [np.full((count, *x.shape[1:]), worst, x.dtype) for count in (before, behind)]
    seen, length = np.concatenate([ends[0], x, ends[1]]), 1
    while 2 * length <= width:
        seen, length = better(seen[:-length], seen[length:]), 2 * length
    return better(seen[: len(x)], seen[width - length : width - length + len(x)])


def moving_mean(x: Float[Array, " N"], width: int) -> Float[Array, " N"]:
    """Mean of ``width`` samples about each one; beyond the ends the first and the last sample go on.

    A window of an even width reaches further back.
    """
    before = width // 2
    # About the mean of all: sums from the beginning on stay small, and so does what they lose.
    level = x.mean()
    padded = np.pad(x - level, (before + 1, width - 1 - before), mode="edge")
    padded[0] = 0.0
    sums = np.cumsum(padded)
    return level + (sums[width:] - sums[:-width]) / width


def moving_median(
    x: Float[Array, " N"], width: int, edges: Literal["nearest", "reflect"] = "nearest"
) -> Float[Array, " N"]:
    """Median of an odd number of samples about each one.

    Args:
        x: Samples.
        width: Of the window, odd.
        edges: What is beyond the ends: the last sample again and again, or the samples once more, the last one first.
    """
    if len(x) > _MANY:
        from scipy.ndimage import median_filter

        return median_filter(x, width, mode=edges)
    half = width // 2
    padded = np.pad(x, half, mode="edge" if edges == "nearest" else "symmetric")
    return np.partition(sliding_window_view(padded, width), half, axis=1)[:, half]
