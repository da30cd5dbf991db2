"""Minima within bounds of problems that differ from a solved one by some unknowns: which of them are held at a bound.

Unknowns enter, leave, meet a bound or are released. With given ones held, `held_minimum` computes the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from identification.engine.numerics.held_minimum import HeldMinimum, minimum, refined
from identification.engine.numerics.tableau import Entering, Tableau
from phantom_dyn._kernels.jit import fused
from phantom_dyn.array_types import Array, Bool, Float, Int

# Most steps where one bound at a time is met or released, and most exchanges of all wrong bounds in a row that leave no
# fewer wrong bounds than before.
_STEPS, _TRIES = 300, 3
# A multiplier is of the wrong sign from this size on.
_WRONG = 1e-9


@dataclass(frozen=True)
class ChangedMinimum:
    """The minimum of a changed problem.

    Attributes:
        x: All unknowns, those of the solved problem first, ``(n + m,)``.
        slope: Derivative of the loss by each, zero where it is free, ``(n + m,)``.
        value: ``x a x - 2 b x`` of the changed problem.
        converged: False where rounding is too large or steps were not enough: solve the problem from scratch.
        flipped: Unknowns that are free here and held in the solved problem, or the other way round, ``(k,)``.
        action: The change as actions on the solved problem: unknowns (flipped ones first, then those that are held at
            another value), and a force on each that was free or a shift of each that was held.
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
    """Minimum of a solved problem after unknowns enter and others leave.

    Args:
        solved: A solved problem.
        entering: Unknowns that enter; they come last.
        leaving: Places of those that leave, which are zero in the result.
        bounds: Lower and upper bounds of all.
        near: Minimum of a similar problem; the bounds that bind there are tried first. Where it is NaN, those that
            bind in the solved problem.
    """
    # Arrays of one layout, as the function is compiled for each layout.
    ends = np.stack([*bounds, near])
    x, slope, value, converged, places, action, flipped = _changed(solved, entering, leaving, ends)
    return ChangedMinimum(x, slope, value, converged, places[:flipped], (places, action))


class _Held(NamedTuple):
    """Bounds and unknowns that leave, in the tableau's units: they decide which unknowns are held.

    Attributes:
        low: Lower bounds, ``(v,)``.
        high: Upper bounds, ``(v,)``.
        gone: Unknowns that leave, ``(v,)``.
        wrong: Size of a slope above which its unknown is released from a bound, ``(v,)``.
    """

    low: Float[Array, " v"]
    high: Float[Array, " v"]
    gone: Bool[Array, " v"]
    wrong: Float[Array, " v"]


@fused
def _changed(one: Tableau, more: Entering, leaving: Array, ends: Array) -> tuple:
    """As `changed`, with lower bounds, upper bounds and the start in one array, ``(3, v)``."""
    n, v = len(one.x), ends.shape[1]
    unit = np.empty(v)
    unit[:n], unit[n:] = one.scale, more.scale
    bounds = _Held(ends[0] / unit, ends[1] / unit, np.zeros(v, dtype=np.bool_), np.maximum(_WRONG * unit, one.rounding))
    for place in leaving:
        bounds.gone[place] = True
    held, value = np.empty(v, dtype=np.bool_), np.empty(v)
    _begin(one, bounds, ends[2] / unit, held, value)
    found, total, converged, done = _at_once(one, more, held, value, bounds)
    if not done and not np.isnan(ends[2]).all():
        # Sets of equal similarity may have other bounds: the solved problem is often a better start than any of them.
        _begin(one, bounds, np.full(v, np.nan), held, value)
        found, total, converged, done = _at_once(one, more, held, value, bounds)
    if not done:
        _begin(one, bounds, ends[2] / unit, held, value)
        found, total, converged = _step_by_step(one, more, held, value, bounds)
    x, slope = np.zeros(v), found.slope / unit
    for i in range(v):
        if not bounds.gone[i]:
            low, high = found.x[i] <= bounds.low[i], found.x[i] >= bounds.high[i]
            x[i] = ends[0, i] if low else ends[1, i] if high else found.x[i] * unit[i]
    return x, slope, total, converged, found.places, found.action, found.flipped


@fused
def _begin(one: Tableau, bounds: _Held, near: Array, held: Array, value: Array) -> None:
    """Fill in which unknowns are held at first, and their values: by ``near`` where it is a number, else as before."""
    for i in range(len(near)):
        known, started = not np.isnan(near[i]), i < len(one.x) and one.held[i]
        held[i], value[i] = started, one.x[i] if started else 0.0
        if known:
            value[i] = min(max(near[i], bounds.low[i]), bounds.high[i])
            held[i] = value[i] == bounds.low[i] or value[i] == bounds.high[i]
        if bounds.gone[i]:
            held[i], value[i] = True, 0.0


@fused
def _at_once(one: Tableau, more: Entering, held: Array, value: Array, bounds: _Held) -> tuple:
    """Minimum by exchanging all wrong bounds at once; its value, whether it converged, and whether this succeeded."""
    v = len(held)
    fewest, tries = v + 1, _TRIES
    amiss, outside = np.empty(v, dtype=np.bool_), np.empty(v, dtype=np.bool_)
    found = minimum(one, more, held, value)
    while True:
        count = _amiss(found.x, found.slope, held, bounds, amiss, outside)
        if count == 0:
            # Convergence has to hold after the rounding is removed.
            found, total, converged = refined(one, more, held, found)
            if not converged:
                return found, total, False, True
            count = _amiss(found.x, found.slope, held, bounds, amiss, outside)
            if count == 0:
                return found, total, True, True
        if count < fewest:
            fewest, tries = count, _TRIES
        else:
            tries -= 1
        if tries < 0:
            return found, 0.0, False, False
        for i in range(v):
            if amiss[i]:
                held[i] = outside[i]
                if outside[i]:
                    value[i] = _met(found.x, bounds, i)
        found = minimum(one, more, held, value)


@fused
def _step_by_step(one: Tableau, more: Entering, held: Array, x: Array, bounds: _Held) -> tuple:
    """The same by steps within the bounds, each of which lowers the loss, so that no set of bounds comes twice."""
    v = len(held)
    found, released = _within(one, more, held, x, bounds), -1
    for _ in range(_STEPS):
        first, least = -1, 2.0
        for i in range(v):
            if not held[i] and _outside(found.x[i], bounds, i):
                share = min(max((_met(found.x, bounds, i) - x[i]) / (found.x[i] - x[i]), 0.0), 1.0)
                if share < least:
                    first, least = i, share
        # A released unknown moves away from its bound, but for rounding.
        if first >= 0 and first == released and least == 0.0:
            break
        if first >= 0:
            for i in range(v):
                x[i] = min(max(x[i] + least * (found.x[i] - x[i]), bounds.low[i]), bounds.high[i])
            x[first], held[first] = _met(found.x, bounds, first), True
            found = minimum(one, more, held, x)
            continue
        _end(found.x, bounds, x)
        worst = _most_pulled(x, found.slope, held, bounds)
        if worst < 0:
            # Convergence has to hold after the rounding is removed.
            found, total, converged = refined(one, more, held, found)
            _end(found.x, bounds, x)
            worst = _most_pulled(x, found.slope, held, bounds)
            if not converged or worst < 0:
                return found, total, converged
        all_at_once = held.copy()
        for i in range(v):
            all_at_once[i] = held[i] and not _pulls(x[i], found.slope[i], bounds, i)
        other = _within(one, more, all_at_once, x.copy(), bounds)
        # Of a quadratic form the mean slope is that from one point to the other.
        if np.sum((found.slope + other.slope) * (other.x - found.x)) < 0.0:
            held, found = all_at_once, other
        else:
            held[worst], released = False, worst
            found = minimum(one, more, held, x)
    found, total, _ = refined(one, more, held, found)
    return found, total, False


@fused
def _within(one: Tableau, more: Entering, held: Array, value: Array, bounds: _Held) -> HeldMinimum:
    """A minimum with unknowns outside of their bounds held at them, repeated until none is outside."""
    while True:
        found, outside = minimum(one, more, held, value), 0
        for i in range(len(held)):
            if not held[i] and _outside(found.x[i], bounds, i):
                held[i], value[i] = True, _met(found.x, bounds, i)
                outside += 1
        if outside == 0:
            return found


@fused
def _met(x: Array, bounds: _Held, i: int) -> float:
    """The bound that is nearest to an unknown outside of its bounds."""
    return bounds.low[i] if x[i] < bounds.low[i] else bounds.high[i]


@fused
def _end(x: Array, bounds: _Held, out: Array) -> None:
    """Fill ``out`` with the unknowns clipped to their bounds; those that leave are zero."""
    for i in range(len(x)):
        out[i] = 0.0 if bounds.gone[i] else min(max(x[i], bounds.low[i]), bounds.high[i])


@fused
def _outside(x: float, bounds: _Held, i: int) -> bool:
    """True if an unknown is beyond one of its bounds."""
    return x < bounds.low[i] or x > bounds.high[i]


@fused
def _pulls(x: float, slope: float, bounds: _Held, i: int) -> bool:
    """True if the slope of an unknown points away from the bound that holds it."""
    below, above = x <= bounds.low[i] and slope < -bounds.wrong[i], x >= bounds.high[i] and slope > bounds.wrong[i]
    return not bounds.gone[i] and (below or above)


@fused
def _amiss(x: Array, slope: Array, held: Array, bounds: _Held, amiss: Array, outside: Array) -> int:
    """Mark unknowns outside of their bounds, and those with a wrong bound (to be met or released); return how many."""
    count = 0
    for i in range(len(x)):
        outside[i] = not held[i] and _outside(x[i], bounds, i)
        amiss[i] = outside[i] or (held[i] and _pulls(x[i], slope[i], bounds, i))
        count += amiss[i]
    return count


@fused
def _most_pulled(x: Array, slope: Array, held: Array, bounds: _Held) -> int:
    """The held unknown whose slope points most away from its bound; -1 if none does."""
    worst, largest = -1, -1.0
    for i in range(len(x)):
        if held[i] and _pulls(x[i], slope[i], bounds, i) and abs(slope[i]) > largest:
            worst, largest = i, abs(slope[i])
    return worst
