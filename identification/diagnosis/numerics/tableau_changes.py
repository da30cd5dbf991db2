"""Minima within bounds of problems that differ from a solved one by some unknowns, by what its tableau answers.

Unknowns that enter, leave, meet a bound or come off one are a small system of their own (the Schur complement method
for quadratic programs, Gill, Murray, Saunders and Wright, 1990), whose size is the number of changes and not that of
the problem. Compiled: a search solves some hundred thousand of these systems.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from identification.diagnosis.numerics.tableau import TWINS, Entering, Tableau
from phantom_dyn._kernels.jit import fused
from phantom_dyn.array_types import Bool, Float, Int

Array = np.ndarray

# Steps at most where one bound at a time is met or left, and exchanges of all that is amiss at once in a row that may
# leave no less amiss than there ever was.
_STEPS, _TRIES = 300, 3
# Steps at most that take the rounding out of a change, and what of a loss the last of these may gain.
_CORRECTED, _SMALL = 8, 0.01
# A multiplier is of the wrong sign from this size on.
_WRONG = 1e-9


@dataclass(frozen=True)
class Settled:
    """The minimum of a changed problem.

    Attributes:
        x: All unknowns, those of the solved problem first, ``(n + m,)``.
        slope: Of the loss by each, zero where it is free, ``(n + m,)``.
        value: ``x a x - 2 b x`` of the changed problem.
        settled: False where rounding is too large for this, or steps were not enough: it has to be solved as a whole.
        flipped: Unknowns that are free here and held in the solved problem, or the other way round, ``(k,)``.
        action: What makes the change: unknowns, those that are flipped first and then those that are held elsewhere,
            and a force on each that was free or a shift of each that was held.
    """

    x: Float[Array, " v"]
    slope: Float[Array, " v"]
    value: float
    settled: bool
    flipped: Int[Array, " k"]
    action: tuple[Int[Array, " d"], Float[Array, " d"]]


def changed(
    solved: Tableau,
    entering: Entering,
    leaving: Int[Array, " l"],
    bounds: tuple[Float[Array, " v"], Float[Array, " v"]],
    near: Float[Array, " v"],
) -> Settled:
    """Minimum with unknowns that enter and without some that are there.

    Args:
        solved: A solved problem.
        entering: The former, which come last.
        leaving: Places of the latter, which are zero.
        bounds: Lower and upper ones of all.
        near: Minimum of a similar problem; the bounds that bind there are tried first. Where it is NaN, those that
            bind in the solved problem.
    """
    # One form of arrays, as a function is compiled once more for every other one.
    ends = np.stack([*bounds, near])
    x, slope, value, settled, places, action, flipped = _changed(solved, entering, leaving, ends)
    return Settled(x, slope, value, settled, places[:flipped], (places, action))


@fused
def answers_among(solved: Tableau, entering: Entering, places: Array) -> Array:
    """What the states of some unknowns answer to an action on each of them, one column an action, ``(k, k)``."""
    out = np.empty((len(places), len(places)))
    for j in range(len(places)):
        for i in range(len(places)):
            out[i, j] = _answer(solved, entering, places[j], places[i])
    return out


class _Found(NamedTuple):
    """A minimum in the tableau's units, without its value, and what makes the change: see `Settled`."""

    x: Float[Array, " v"]
    slope: Float[Array, " v"]
    places: Int[Array, " d"]
    action: Float[Array, " d"]
    flipped: int


class _Held(NamedTuple):
    """What decides which unknowns are held, in the tableau's units.

    Attributes:
        low: Lower bounds, ``(v,)``.
        high: Upper bounds, ``(v,)``.
        gone: Unknowns that leave, ``(v,)``.
        wrong: Size from which on a slope pulls off a bound, ``(v,)``.
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
    found, total, settled, done = _at_once(one, more, held, value, bounds)
    if not done:
        # Sets that are as similar may bind elsewhere: the solved problem is often nearer than the nearest of them.
        _begin(one, bounds, np.full(v, np.nan), held, value)
        found, total, settled, done = _at_once(one, more, held, value, bounds)
    if not done:
        _begin(one, bounds, ends[2] / unit, held, value)
        found, total, settled = _step_by_step(one, more, held, value, bounds)
    x, slope = np.zeros(v), found.slope / unit
    for i in range(v):
        if not bounds.gone[i]:
            low, high = found.x[i] <= bounds.low[i], found.x[i] >= bounds.high[i]
            x[i] = ends[0, i] if low else ends[1, i] if high else found.x[i] * unit[i]
    return x, slope, total, settled, found.places, found.action, found.flipped


@fused
def _begin(one: Tableau, bounds: _Held, near: Array, held: Array, value: Array) -> None:
    """Fill in which unknowns are held at first and at what, by ``near`` where it is a number, else as they were."""
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
    """Minimum by exchanging all that is amiss at once, its value, if it is settled, and if this went not astray."""
    v = len(held)
    fewest, tries = v + 1, _TRIES
    amiss, outside = np.empty(v, dtype=np.bool_), np.empty(v, dtype=np.bool_)
    found = _minimum(one, more, held, value)
    while True:
        count = _amiss(found.x, found.slope, held, bounds, amiss, outside)
        if count == 0:
            # What is settled has to be so beyond rounding.
            found, total, settled = _refined(one, more, held, found)
            if not settled:
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
        found = _minimum(one, more, held, value)


@fused
def _step_by_step(one: Tableau, more: Entering, held: Array, x: Array, bounds: _Held) -> tuple:
    """The same by steps within the bounds, each of which lowers the loss, so that no set of bounds comes twice."""
    v = len(held)
    amiss, outside = np.empty(v, dtype=np.bool_), np.empty(v, dtype=np.bool_)
    found, released = _within(one, more, held, x, bounds), -1
    for _ in range(_STEPS):
        _amiss(found.x, found.slope, held, bounds, amiss, outside)
        first, least = -1, 2.0
        for i in range(v):
            if outside[i]:
                share = min(max((_met(found.x, bounds, i) - x[i]) / (found.x[i] - x[i]), 0.0), 1.0)
                if share < least:
                    first, least = i, share
        # What is let off its bound moves away from it, but for rounding.
        if first >= 0 and first == released and least == 0.0:
            break
        if first >= 0:
            for i in range(v):
                x[i] = min(max(x[i] + least * (found.x[i] - x[i]), bounds.low[i]), bounds.high[i])
            x[first], held[first] = _met(found.x, bounds, first), True
            found = _minimum(one, more, held, x)
            continue
        _end(found.x, bounds, x)
        worst = _most_pulled(x, found.slope, held, bounds)
        if worst < 0:
            # What is settled has to be so beyond rounding.
            found, total, settled = _refined(one, more, held, found)
            _end(found.x, bounds, x)
            worst = _most_pulled(x, found.slope, held, bounds)
            if not settled or worst < 0:
                return found, total, settled
        all_at_once = held.copy()
        for i in range(v):
            all_at_once[i] = held[i] and not _pulls(x[i], found.slope[i], bounds, i)
        other = _within(one, more, all_at_once, x.copy(), bounds)
        # Of a quadratic form the mean slope is that from one point to the other.
        if np.sum((found.slope + other.slope) * (other.x - found.x)) < 0.0:
            held, found = all_at_once, other
        else:
            held[worst], released = False, worst
            found = _minimum(one, more, held, x)
    found, total, _ = _refined(one, more, held, found)
    return found, total, False


@fused
def _within(one: Tableau, more: Entering, held: Array, value: Array, bounds: _Held) -> _Found:
    """A minimum with what is outside its bounds held there too, and what is then outside, until nothing is."""
    while True:
        found, outside = _minimum(one, more, held, value), 0
        for i in range(len(held)):
            if not held[i] and (found.x[i] < bounds.low[i] or found.x[i] > bounds.high[i]):
                held[i], value[i] = True, _met(found.x, bounds, i)
                outside += 1
        if outside == 0:
            return found


@fused
def _met(x: Array, bounds: _Held, i: int) -> float:
    """The bound that an unknown that is outside them meets."""
    return bounds.low[i] if x[i] < bounds.low[i] else bounds.high[i]


@fused
def _end(x: Array, bounds: _Held, out: Array) -> None:
    """Fill ``out`` with unknowns within their bounds, those that leave at zero."""
    for i in range(len(x)):
        out[i] = 0.0 if bounds.gone[i] else min(max(x[i], bounds.low[i]), bounds.high[i])


@fused
def _pulls(x: float, slope: float, bounds: _Held, i: int) -> bool:
    """True if an unknown pulls off the bound that holds it."""
    below, above = x <= bounds.low[i] and slope < -bounds.wrong[i], x >= bounds.high[i] and slope > bounds.wrong[i]
    return not bounds.gone[i] and (below or above)


@fused
def _amiss(x: Array, slope: Array, held: Array, bounds: _Held, amiss: Array, outside: Array) -> int:
    """Mark unknowns that are outside their bounds or pull off the bound that holds them, and the former; how many."""
    count = 0
    for i in range(len(x)):
        outside[i] = not held[i] and (x[i] < bounds.low[i] or x[i] > bounds.high[i])
        amiss[i] = outside[i] or (held[i] and _pulls(x[i], slope[i], bounds, i))
        count += amiss[i]
    return count


@fused
def _most_pulled(x: Array, slope: Array, held: Array, bounds: _Held) -> int:
    """The unknown that pulls most off the bound that holds it; -1 if none does."""
    worst, largest = -1, -1.0
    for i in range(len(x)):
        if held[i] and _pulls(x[i], slope[i], bounds, i) and abs(slope[i]) > largest:
            worst, largest = i, abs(slope[i])
    return worst


@fused
def _minimum(one: Tableau, more: Entering, held: Array, value: Array) -> _Found:
    """Minimum with some unknowns held at values."""
    n, v = len(one.x), len(held)
    now, at, started = np.empty(v), np.zeros(v), np.ones(v, dtype=np.bool_)
    now[:n], now[n:], started[:n] = one.state, more.slope, one.held
    places, action, k = np.empty(v, dtype=np.int64), np.empty(v), 0
    for i in range(v):
        if i < n and started[i]:
            at[i] = one.x[i]
        if held[i] != started[i]:
            places[k] = i
            k += 1
    d = k
    for i in range(v):
        if held[i] and started[i] and value[i] != at[i]:
            places[d], action[d] = i, value[i] - at[i]
            _add_answers(one, more, i, action[d], now)
            d += 1
    for j in range(k):
        p = places[j]
        action[j] = (value[p] if held[p] else 0.0) - now[p]
    if k:
        action[:k] = np.linalg.solve(answers_among(one, more, places[:k]), action[:k].copy())
    for j in range(k):
        _add_answers(one, more, places[j], action[j], now)
    x, slope = np.empty(v), np.zeros(v)
    for i in range(v):
        x[i] = value[i] if held[i] else at[i] if started[i] else now[i]
        if started[i] and held[i]:
            slope[i] = now[i]
    for j in range(k):
        p = places[j]
        # A shift moves what was held; a force on what was free is its slope.
        if not started[p]:
            slope[p] = action[j]
        elif not held[p]:
            x[p] += action[j]
    return _Found(x, slope, places[:d].copy(), action[:d].copy(), k)


@fused
def _refined(one: Tableau, more: Entering, held: Array, found: _Found) -> tuple:
    """A minimum with the rounding of the tableau taken out, its value, and False where that fails."""
    n, v = len(one.x), len(held)
    x, slope, b, force = found.x.copy(), found.slope, np.empty(v), np.empty(v)
    b[:n], b[n:] = one.b, -more.slope
    for j in range(v - n):
        for i in range(n):
            b[n + j] += more.cross[j, i] * one.x[i]
    total, settled, last = 0.0, False, np.inf
    for _ in range(_CORRECTED):
        slope = _slope(one, more, x, b)
        for i in range(v):
            force[i] = 0.0 if held[i] else -slope[i]
        step = _correction(one, more, force, held, found.places[: found.flipped])
        total, lowered = 0.0, 0.0
        for i in range(v):
            # What keeps twins solvable is no part of the problem.
            total += x[i] * (slope[i] - b[i] - TWINS * x[i])
            lowered += slope[i] * step[i]
            x[i] += step[i]
        total, gained = total + lowered, abs(lowered)
        settled = gained <= _SMALL
        if settled or gained > last:
            break
        last = gained
    for i in range(v):
        if not held[i]:
            slope[i] = 0.0
    return _Found(x, slope, found.places, found.action, found.flipped), total, settled


@fused
def _slope(one: Tableau, more: Entering, x: Array, b: Array) -> Array:
    """Slope of the loss by all unknowns, ``b`` the linear part of it."""
    n, out = len(one.x), -b
    # Line by line: a sum over a line would have to keep its order.
    for j in range(n):
        if x[j] != 0.0:
            for i in range(n):
                out[i] += one.a[j, i] * x[j]
    for j in range(len(x) - n):
        inner = 0.0
        for i in range(n):
            out[i] += more.cross[j, i] * x[n + j]
            inner += more.cross[j, i] * x[i]
        for i in range(len(x) - n):
            inner += more.square[j, i] * x[n + i]
        out[n + j] += inner
    return out


@fused
def _correction(one: Tableau, more: Entering, force: Array, held: Array, flipped: Array) -> Array:
    """What unknowns that are free answer to a force on each of them, ``flipped`` those that were held or are now."""
    n, v, k = len(one.x), len(held), len(flipped)
    out = np.zeros(v)
    for p in range(n):
        if not one.held[p] and force[p] != 0.0:
            _add_answers(one, more, p, force[p], out)
    action = np.empty(k)
    if k:
        for j in range(k):
            action[j] = force[flipped[j]] - out[flipped[j]]
        action = np.linalg.solve(answers_among(one, more, flipped), action)
        for j in range(k):
            _add_answers(one, more, flipped[j], action[j], out)
    for i in range(v):
        if held[i] or i >= n or one.held[i]:
            out[i] = 0.0
    for j in range(k):
        p = flipped[j]
        if not held[p]:
            out[p] = action[j]
    return out


@fused
def _answer(one: Tableau, more: Entering, place: int, other: int) -> float:
    """What the state of one unknown, ``other``, answers to an action on one."""
    n = len(one.x)
    if place >= n:
        return more.answer[place - n, other] if other < n else more.among[place - n, other - n]
    if other < n:
        return one.answer[place, other]
    # A slope answers to a force as what is free answers to a shift, with the other sign.
    return more.answer[other - n, place] if one.held[place] else -more.answer[other - n, place]


@fused
def _add_answers(one: Tableau, more: Entering, place: int, action: float, out: Array) -> None:
    """Add to ``out`` what the states of all unknowns answer to an action on one."""
    n = len(one.x)
    line = one.answer[place] if place < n else more.answer[place - n]
    for i in range(n):
        out[i] += action * line[i]
    for i in range(len(out) - n):
        out[n + i] += action * _answer(one, more, place, n + i)
