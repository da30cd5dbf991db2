"""Least squares within bounds, of few columns.

From the columns and not from their products, as the fits of the diagnosis are: the checks compare what two causes leave
of recordings without noise, and products know that to half the digits only.

`scipy.optimize` has the same; importing it takes longer than a check of a recording does. It is the oracle of the
tests. Source: Stark and Parker, Computational Statistics 10 (1995) 129-141.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Bool, Float

Array = np.ndarray

# A slope is of the wrong sign from this share of the largest product of a column with the target on.
_WRONG = 1e-10


def bounded_fit(
    columns: Float[Array, "n k"], target: Float[Array, " n"], low: Float[Array, " k"], high: Float[Array, " k"]
) -> Float[Array, " k"]:
    """The coefficients within their bounds whose columns leave least of the target.

    Coefficients at a bound are let go one at a time, where that leaves less, until none does.

    Args:
        columns: Few, and not the same one twice.
        target: What they are to make.
        low: Lower bounds.
        high: Upper bounds, above the lower ones.
    """
    x = np.clip(np.linalg.lstsq(columns, target, rcond=None)[0], low, high)
    free = (x > low) & (x < high)
    x = _within(columns, target, low, high, x, free)
    wrong = _WRONG * float(np.abs(columns.T @ target).max(initial=0.0))
    # Each time less is left than before, so that no set of bounds comes twice; the count is for rounding.
    for _ in range(10 * len(x) + 10):
        slope = columns.T @ (columns @ x - target)
        gain = np.where(free, 0.0, np.where(x <= low, -slope, slope))
        if gain.max(initial=0.0) <= wrong:
            break
        free[np.argmax(gain)] = True
        x = _within(columns, target, low, high, x, free)
    return x


def _within(columns: Array, target: Array, low: Array, high: Array, x: Array, free: Bool[Array, " k"]) -> Array:
    """The best free coefficients, reached from ``x``; those that meet a bound on the way stay there, not free any more.

    ``free`` is changed.
    """
    while free.any():
        rest = target - columns[:, ~free] @ x[~free]
        wanted = np.linalg.lstsq(columns[:, free], rest, rcond=None)[0]
        now, bottom, top = x[free], low[free], high[free]
        way = wanted - now
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(way > 0, (top - now) / way, np.where(way < 0, (bottom - now) / way, np.inf))
        share = min(float(shares.min()), 1.0)
        x = x.copy()
        x[free] = np.clip(now + share * way, bottom, top)
        if share == 1.0:
            break
        met = np.flatnonzero(free)[shares <= share]
        x[met] = np.where(wanted[shares <= share] > now[shares <= share], high[met], low[met])
        free[met] = False
    return x
