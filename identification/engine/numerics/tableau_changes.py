"""Minimum of a quadratic problem within bounds, from a solved problem to which unknowns are added or removed.

The search finds which unknowns are held at a bound. It first uses block principal pivoting, which exchanges all wrong
bounds at once. If this does not converge, it uses an active-set method. For each set of held unknowns `held_minimum.py`
computes the minimum.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from identification.engine.numerics.held_minimum import HeldMinimum, minimum, refined
from identification.engine.numerics.tableau import Entering, Tableau
from phantom_dyn._kernels.jit import fused
from phantom_dyn.array_types import Array, Bool, Float, Int

# Largest number of active-set steps, and of block exchanges in a row that do not lower the number of wrong bounds.
# After more exchanges the active-set method is used; after more steps the problem counts as not converged.
_STEPS, _TRIES = 300, 3
# A multiplier (the slope of the loss at a bound) counts as having the wrong sign from this size on.
_WRONG = 1e-9


@dataclass(frozen=True)
class ChangedMinimum:
    """The minimum of a changed problem.

    Attributes:
        x: All unknowns, those of the solved problem first, ``(n + m,)``.
        slope: Derivative of the loss by each unknown, zero for free ones, ``(n + m,)``.
        value: ``x a x - 2 b x`` of the changed problem.
        converged: False if rounding errors are too large or the steps were not enough; the problem then has to be
            solved from scratch.
        flipped: Unknowns that are free here and held in the solved problem, or the other way round, ``(k,)``.
        action: Unknowns of the solved problem on which an action is applied, and the actions: see `HeldMinimum`.
    """

    x: Float[Array, " v"]
    slope: Float[Array, " v"]
    value: float
    converged: bool
    flipped: Int[Array, " k"]
    action: tuple[Int[Array, " d"], Float[Array, " d"]]


def changed(
    solved: Tableau,
    entering: Entering,
    leaving: Int[Array, " l"],
    bounds: tuple[Float[Array, " v"], Float[Array, " v"]],
    near: Float[Array, " v"],
) -> ChangedMinimum:
    """Minimum of a solved problem after unknowns are added and others removed.

    Args:
        solved: A solved problem.
        entering: Unknowns that are added, after those of the solved problem.
        leaving: Indices of the unknowns that are removed; the result has zeros there.
        bounds: Lower and upper bounds of all unknowns.
        near: Minimum of a similar problem, whose active bounds are tried first. For unknowns whose entry is NaN, the
            active bounds of the solved problem are tried first.
    """
    # One array of a fixed layout, because the function is compiled once for each layout.
    ends = np.stack([*bounds, near])
    x, slope, value, converged, places, action, flipped = _changed(solved, entering, leaving, ends)
    return ChangedMinimum(x, slope, value, converged, places[:flipped], (places, action))


class _Constraints(NamedTuple):
    """Bounds and removed unknowns, in the scaled units of the tableau.

    Attributes:
        low: Lower bounds, ``(v,)``.
        high: Upper bounds, ``(v,)``.
        leaving: True for removed unknowns, which are held at zero, ``(v,)``.
        tolerance: Size of a slope above which its unknown is released from a bound, ``(v,)``.
    """

    low: Float[Array, " v"]
    high: Float[Array, " v"]
    leaving: Bool[Array, " v"]
    tolerance: Float[Array, " v"]


@fused
def _changed(solved: Tableau, entering: Entering, leaving: Array, ends: Array) -> tuple:
    """The minimum of `changed`; ``ends`` holds lower bounds, upper bounds and the start, ``(3, v)``."""
    n, v = len(solved.x), ends.shape[1]
    unit = np.empty(v)
    unit[:n], unit[n:] = solved.scale, entering.scale
    bounds = _Constraints(
        ends[0] / unit, ends[1] / unit, np.zeros(v, dtype=np.bool_), np.maximum(_WRONG * unit, solved.rounding)
    )
    for place in leaving:
        bounds.leaving[place] = True
    held, value = np.empty(v, dtype=np.bool_), np.empty(v)
    _fill_start(solved, bounds, ends[2] / unit, held, value)
    found, total, converged, done = _block_pivoting(solved, entering, held, value, bounds)
    if not done and not np.isnan(ends[2]).all():
        # The bounds of the similar problem did not work: try those of the solved problem.
        _fill_start(solved, bounds, np.full(v, np.nan), held, value)
        found, total, converged, done = _block_pivoting(solved, entering, held, value, bounds)
    if not done:
        _fill_start(solved, bounds, ends[2] / unit, held, value)
        found, total, converged = _active_set_steps(solved, entering, held, value, bounds)
    x, slope = np.zeros(v), found.slope / unit
    for i in range(v):
        if not bounds.leaving[i]:
            low, high = found.x[i] <= bounds.low[i], found.x[i] >= bounds.high[i]
            x[i] = ends[0, i] if low else ends[1, i] if high else found.x[i] * unit[i]
    return x, slope, total, converged, found.indices, found.action, found.flipped


@fused
def _fill_start(solved: Tableau, bounds: _Constraints, start: Array, held: Array, value: Array) -> None:
    """Write the initially held unknowns and their values: from ``start``, or where it is NaN from the solved one."""
    for i in range(len(start)):
        given, was_held = not np.isnan(start[i]), i < len(solved.x) and solved.held[i]
        held[i], value[i] = was_held, solved.x[i] if was_held else 0.0
        if given:
            value[i] = min(max(start[i], bounds.low[i]), bounds.high[i])
            held[i] = value[i] == bounds.low[i] or value[i] == bounds.high[i]
        if bounds.leaving[i]:
            held[i], value[i] = True, 0.0


@fused
def _block_pivoting(solved: Tableau, entering: Entering, held: Array, value: Array, bounds: _Constraints) -> tuple:
    """Minimum by block principal pivoting, its loss, whether it is accurate, and whether the active set was found."""
    v = len(held)
    fewest, attempts = v + 1, _TRIES
    wrong, outside = np.empty(v, dtype=np.bool_), np.empty(v, dtype=np.bool_)
    found = minimum(solved, entering, held, value)
    while True:
        count = _mark_wrong(found.x, found.slope, held, bounds, wrong, outside)
        if count == 0:
            # No bound may be wrong after rounding errors are removed, too.
            found, total, converged = refined(solved, entering, held, found)
            if not converged:
                return found, total, False, True
            count = _mark_wrong(found.x, found.slope, held, bounds, wrong, outside)
            if count == 0:
                return found, total, True, True
        if count < fewest:
            fewest, attempts = count, _TRIES
        else:
            attempts -= 1
        if attempts < 0:
            return found, 0.0, False, False
        for i in range(v):
            if wrong[i]:
                held[i] = outside[i]
                if outside[i]:
                    value[i] = _violated_bound(found.x, bounds, i)
        found = minimum(solved, entering, held, value)


@fused
def _active_set_steps(solved: Tableau, entering: Entering, held: Array, x: Array, bounds: _Constraints) -> tuple:
    """Minimum by an active-set method, its loss, and whether it converged.

    All points are within the bounds, and every step lowers the loss, so that no active set is repeated.
    """
    v = len(held)
    found, released = _hold_violated(solved, entering, held, x, bounds), -1
    for _ in range(_STEPS):
        blocking, step = -1, 2.0
        for i in range(v):
            if not held[i] and _outside(found.x[i], bounds, i):
                share = min(max((_violated_bound(found.x, bounds, i) - x[i]) / (found.x[i] - x[i]), 0.0), 1.0)
                if share < step:
                    blocking, step = i, share
        # A released unknown moves away from its bound; only rounding can move it back.
        if blocking >= 0 and blocking == released and step == 0.0:
            break
        if blocking >= 0:
            for i in range(v):
                x[i] = min(max(x[i] + step * (found.x[i] - x[i]), bounds.low[i]), bounds.high[i])
            x[blocking], held[blocking] = _violated_bound(found.x, bounds, blocking), True
            found = minimum(solved, entering, held, x)
            continue
        _clip(found.x, bounds, x)
        worst = _worst_multiplier(x, found.slope, held, bounds)
        if worst < 0:
            # No multiplier may be wrong after rounding errors are removed, too.
            found, total, converged = refined(solved, entering, held, found)
            _clip(found.x, bounds, x)
            worst = _worst_multiplier(x, found.slope, held, bounds)
            if not converged or worst < 0:
                return found, total, converged
        all_released = held.copy()
        for i in range(v):
            all_released[i] = held[i] and not _has_wrong_multiplier(x[i], found.slope[i], bounds, i)
        released_minimum = _hold_violated(solved, entering, all_released, x.copy(), bounds)
        # The change of a quadratic loss is the step times the mean of the slopes at its two ends.
        if np.sum((found.slope + released_minimum.slope) * (released_minimum.x - found.x)) < 0.0:
            held, found = all_released, released_minimum
        else:
            held[worst], released = False, worst
            found = minimum(solved, entering, held, x)
    found, total, _ = refined(solved, entering, held, found)
    return found, total, False


@fused
def _hold_violated(solved: Tableau, entering: Entering, held: Array, value: Array, bounds: _Constraints) -> HeldMinimum:
    """The minimum after all unknowns outside of their bounds are held at these, repeated until none is outside."""
    while True:
        found, outside = minimum(solved, entering, held, value), 0
        for i in range(len(held)):
            if not held[i] and _outside(found.x[i], bounds, i):
                held[i], value[i] = True, _violated_bound(found.x, bounds, i)
                outside += 1
        if outside == 0:
            return found


@fused
def _violated_bound(x: Array, bounds: _Constraints, i: int) -> float:
    """The bound that an unknown violates."""
    return bounds.low[i] if x[i] < bounds.low[i] else bounds.high[i]


@fused
def _clip(x: Array, bounds: _Constraints, out: Array) -> None:
    """Write the unknowns, clipped to their bounds, into ``out``; removed unknowns are zero."""
    for i in range(len(x)):
        out[i] = 0.0 if bounds.leaving[i] else min(max(x[i], bounds.low[i]), bounds.high[i])


@fused
def _outside(x: float, bounds: _Constraints, i: int) -> bool:
    """True if an unknown is beyond one of its bounds."""
    return x < bounds.low[i] or x > bounds.high[i]


@fused
def _has_wrong_multiplier(x: float, slope: float, bounds: _Constraints, i: int) -> bool:
    """True if the multiplier of a held unknown has the wrong sign: the loss decreases from its bound inwards."""
    below, above = (
        x <= bounds.low[i] and slope < -bounds.tolerance[i],
        x >= bounds.high[i] and slope > bounds.tolerance[i],
    )
    return not bounds.leaving[i] and (below or above)


@fused
def _mark_wrong(x: Array, slope: Array, held: Array, bounds: _Constraints, wrong: Array, outside: Array) -> int:
    """Mark unknowns that violate a bound, or whose multiplier has the wrong sign, in ``wrong``; return their number.

    Unknowns that violate a bound are marked in ``outside``, too.
    """
    count = 0
    for i in range(len(x)):
        outside[i] = not held[i] and _outside(x[i], bounds, i)
        wrong[i] = outside[i] or (held[i] and _has_wrong_multiplier(x[i], slope[i], bounds, i))
        count += wrong[i]
    return count


@fused
def _worst_multiplier(x: Array, slope: Array, held: Array, bounds: _Constraints) -> int:
    """The held unknown with the largest multiplier of the wrong sign; -1 if there is none."""
    worst, largest = -1, -1.0
    for i in range(len(x)):
        if held[i] and _has_wrong_multiplier(x[i], slope[i], bounds, i) and abs(slope[i]) > largest:
            worst, largest = i, abs(slope[i])
    return worst
