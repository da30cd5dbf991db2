"""Counting the edges of an encoder along a straight motion, compiled; see `phantom_dyn.haptics.encoder`."""

from __future__ import annotations

import numpy as np

from phantom_dyn.kernels.jit import jit


@jit
def edge_position(count, step, spacing):
    """Position of the edge below a count: between it and the count before."""
    return (count - 0.5 + spacing[count % 4]) * step


@jit
def count_through(count, t0, x0, t1, x1, step, spacing, times, directions, used):
    """Follow the straight motion from (t0, x0) to (t1, x1); write edges from index `used` on; new count and index.

    Edges that no longer fit into `times` overwrite the last ones modulo its length, so it can be a ring.
    """
    while x1 >= edge_position(count + 1, step, spacing):
        level = edge_position(count + 1, step, spacing)
        times[used % times.size] = t0 + (t1 - t0) * min(max((level - x0) / (x1 - x0), 0.0), 1.0) if x1 > x0 else t0
        directions[used % times.size] = 1.0
        used += 1
        count += 1
    while x1 < edge_position(count, step, spacing):
        level = edge_position(count, step, spacing)
        times[used % times.size] = t0 + (t1 - t0) * min(max((level - x0) / (x1 - x0), 0.0), 1.0) if x1 < x0 else t0
        directions[used % times.size] = -1.0
        used += 1
        count -= 1
    return count, used


@jit
def follow_motion(x, dt, per_sample, step, spacing, counts, times, directions):
    """Counts at every `per_sample`-th point of a polyline and its edges; returns the number of edges."""
    count = int(np.floor(x[0] / step + 0.5))
    count, _ = count_through(count, 0.0, x[0], 0.0, x[0], step, spacing, times, directions, 0)
    counts[0] = count
    used = 0
    for i in range(1, x.size):
        count, used = count_through(count, (i - 1) * dt, x[i - 1], i * dt, x[i], step, spacing, times, directions, used)
        if i % per_sample == 0:
            counts[i // per_sample] = count
    return used
