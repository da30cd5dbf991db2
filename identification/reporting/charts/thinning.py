"""Chooses samples for figures: thinned curves and clouds, sections with large residuals, medians in bins."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.random_streams import random_stream

CURVE_POINTS = 500  # samples of a thinned curve
CLOUD_POINTS = 3000  # samples of a cloud
BINS = 48  # largest number of bins of a binned median
LEAST_BINS = 8  # smallest number of bins of a binned median
PER_BIN = 12  # smallest mean number of samples per bin, so that few bins have too few samples for a median
LEAST_IN_BIN = 5  # smallest number of samples for a median


def thinned(y: Float[Array, " N"], most: int = CURVE_POINTS) -> Int[Array, " n"]:
    """Indices of at most `most` samples of a curve: the smallest and largest sample of every section.

    No spike of the curve is lost.

    Args:
        y: Samples of a curve, shape ``(N,)``.
        most: Largest number of indices, at least 2.

    Returns:
        Increasing indices, shape ``(n,)``.
    """
    if len(y) <= most:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), most // 2 + 1).astype(int)
    starts = edges[:-1]
    finite = np.where(np.isfinite(y), y, 0.0)
    extremes = [
        (a + np.argmin(finite[a:b]), a + np.argmax(finite[a:b])) for a, b in zip(starts, edges[1:], strict=True)
    ]
    return np.unique(np.array(extremes))


def gap_starts(t: Float[Array, " N"]) -> Int[Array, " g"]:
    """Indices of samples before which time jumps, because another recording begins or samples were left out."""
    step = np.diff(t)
    if not len(step):
        return np.zeros(0, dtype=int)
    return np.flatnonzero(step > 10 * np.median(step)) + 1


def largest_residual_section(t: Float[Array, " N"], residual: Float[Array, " N"], seconds: float) -> slice:
    """The section of one recording, at most `seconds` long, with the largest mean square of the residual.

    A recording shorter than `seconds` is chosen only if all recordings are shorter.

    Args:
        t: Time [s], shape ``(N,)``.
        residual: Residual of one joint, shape ``(N,)``.
        seconds: Length of the section [s].

    Returns:
        Indices of the section's samples.
    """
    bounds = [0, *gap_starts(t).tolist(), len(t)]
    best, best_rank = slice(0, len(t)), (-1.0, -1.0)
    for first, last in pairwise(bounds):
        if last <= first:
            continue
        time = t[first:last]
        energy = np.concatenate([[0.0], np.cumsum(np.nan_to_num(residual[first:last]) ** 2)])
        ends = np.searchsorted(time, time + seconds, side="right")
        fits = time + seconds <= time[-1]
        starts = np.flatnonzero(fits) if fits.any() else np.array([0])
        mean_square = (energy[ends[starts]] - energy[starts]) / (ends[starts] - starts)
        k = int(np.argmax(mean_square))
        # A longer section is better; of equally long ones, that with the larger mean square.
        rank = (min(seconds, float(time[-1] - time[0])), float(mean_square[k]))
        if rank > best_rank:
            best, best_rank = slice(first + int(starts[k]), first + int(ends[starts[k]])), rank
    return best


def scatter_choice(finite: Bool[Array, " N"]) -> Int[Array, " n"]:
    """Indices of at most `CLOUD_POINTS` usable samples, drawn at random so that no period of the motion is favoured."""
    usable = np.flatnonzero(finite)
    if len(usable) <= CLOUD_POINTS:
        return usable
    return np.sort(random_stream("thinning of a scatter").choice(usable, CLOUD_POINTS, replace=False))


def binned_median(x: Float[Array, " N"], y: Float[Array, " N"]) -> tuple[Float[Array, " b"], Float[Array, " b"]]:
    """Median of `y` in equal bins of `x`. Zero is an edge of bins, so that no bin has both directions of motion.

    Args:
        x: Abscissa, shape ``(N,)``, finite.
        y: Ordinate, shape ``(N,)``, finite.

    Returns:
        Centres of the bins and medians, shape ``(b,)`` each; bins with fewer than five samples are left out.
    """
    span = float(np.ptp(x)) if len(x) else 0.0
    if span == 0.0:
        return np.zeros(0), np.zeros(0)
    bins = min(BINS, max(LEAST_BINS, len(x) // PER_BIN))
    which = bin_numbers(x, bins)
    order = np.argsort(which, kind="stable")
    numbers, starts = np.unique(which[order], return_index=True)
    groups = np.split(y[order], starts[1:])
    full_bins = [(k, group) for k, group in zip(numbers, groups, strict=True) if len(group) >= LEAST_IN_BIN]
    centres = np.array([(k + 0.5) * span / bins for k, _ in full_bins])
    return centres, np.array([float(np.median(group)) for _, group in full_bins])


def bin_numbers(x: Float[Array, " N"], bins: int = BINS) -> Int[Array, " N"]:
    """Index of the bin of each sample: `bins` equal bins over the range of `x`, with an edge at zero."""
    span = float(np.ptp(x)) if len(x) else 0.0
    return np.zeros(len(x), dtype=int) if span == 0.0 else np.floor(x / (span / bins)).astype(int)
