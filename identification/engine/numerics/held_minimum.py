"""Minima of a changed problem with given unknowns held, from the tableau of the solved one.

The changes to the solved problem are a small system of their own (the Schur complement method for quadratic programs,
Gill, Murray, Saunders and Wright, 1990), whose size is the number of changes and not that of the problem. Compiled: a
search solves some hundred thousand of these systems.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.engine.numerics.tableau import TWINS, Entering, Tableau
from phantom_dyn._kernels.jit import fused
from phantom_dyn.array_types import Array, Float, Int

# Most steps that remove the rounding of a minimum, and the largest gain of the last of these.
_CORRECTED, _SMALL = 8, 0.01


class HeldMinimum(NamedTuple):
    """A minimum with some unknowns held, in the tableau's units.

    Attributes:
        x: All unknowns, those of the solved problem first, ``(n + m,)``.
        slope: Derivative of the loss by each, zero where it is free, ``(n + m,)``.
        places: Unknowns that are free here and held in the solved problem, or the other way round, and then those that
            are held elsewhere, ``(d,)``.
        action: A force on each of these that was free, a shift of each that was held, ``(d,)``.
        flipped: Number of these that are of the first kind.
    """

    x: Float[Array, " v"]
    slope: Float[Array, " v"]
    places: Int[Array, " d"]
    action: Float[Array, " d"]
    flipped: int


@fused
def minimum(one: Tableau, more: Entering, held: Array, value: Array) -> HeldMinimum:
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
            _add_responses(one, more, i, action[d], now)
            d += 1
    for j in range(k):
        p = places[j]
        action[j] = (value[p] if held[p] else 0.0) - now[p]
    if k:
        action[:k] = np.linalg.solve(answers_among(one, more, places[:k]), action[:k].copy())
    for j in range(k):
        _add_responses(one, more, places[j], action[j], now)
    x, slope = np.empty(v), np.zeros(v)
    for i in range(v):
        x[i] = value[i] if held[i] else at[i] if started[i] else now[i]
        if started[i] and held[i]:
            slope[i] = now[i]
    for j in range(k):
        p = places[j]
        # An unknown that was held is shifted; one that was free gets its slope as a force.
        if not started[p]:
            slope[p] = action[j]
        elif not held[p]:
            x[p] += action[j]
    return HeldMinimum(x, slope, places[:d].copy(), action[:d].copy(), k)


@fused
def refined(one: Tableau, more: Entering, held: Array, found: HeldMinimum) -> tuple:
    """A minimum without the rounding of the tableau, its value, and False where the correction does not converge."""
    n, v = len(one.x), len(held)
    x, slope, b, force = found.x.copy(), found.slope, np.empty(v), np.empty(v)
    b[:n], b[n:] = one.b, -more.slope
    for j in range(v - n):
        for i in range(n):
            b[n + j] += more.cross[j, i] * one.x[i]
    total, converged, last = 0.0, False, np.inf
    for _ in range(_CORRECTED):
        slope = _slope(one, more, x, b)
        for i in range(v):
            force[i] = 0.0 if held[i] else -slope[i]
        step = _correction(one, more, force, held, found.places[: found.flipped])
        total, lowered = 0.0, 0.0
        for i in range(v):
            # The ridge that keeps twins solvable is no part of the problem.
            total += x[i] * (slope[i] - b[i] - TWINS * x[i])
            lowered += slope[i] * step[i]
            x[i] += step[i]
        total, gained = total + lowered, abs(lowered)
        converged = gained <= _SMALL
        if converged or gained > last:
            break
        last = gained
    for i in range(v):
        if not held[i]:
            slope[i] = 0.0
    return HeldMinimum(x, slope, found.places, found.action, found.flipped), total, converged


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
    """Change of the free unknowns by a force on each; ``flipped`` are free here and held there, or the other way."""
    n, v, k = len(one.x), len(held), len(flipped)
    out = np.zeros(v)
    for p in range(n):
        if not one.held[p] and force[p] != 0.0:
            _add_responses(one, more, p, force[p], out)
    action = np.empty(k)
    if k:
        for j in range(k):
            action[j] = force[flipped[j]] - out[flipped[j]]
        action = np.linalg.solve(answers_among(one, more, flipped), action)
        for j in range(k):
            _add_responses(one, more, flipped[j], action[j], out)
    for i in range(v):
        if held[i] or i >= n or one.held[i]:
            out[i] = 0.0
    for j in range(k):
        p = flipped[j]
        if not held[p]:
            out[p] = action[j]
    return out


@fused
def _response(one: Tableau, more: Entering, place: int, other: int) -> float:
    """Change of the state of one unknown, ``other``, by a unit action on another."""
    n = len(one.x)
    if place >= n:
        return more.response[place - n, other] if other < n else more.among[place - n, other - n]
    if other < n:
        return one.response[place, other]
    # By symmetry, a slope changes by a force as the free unknown does by a shift, with the other sign.
    return more.response[other - n, place] if one.held[place] else -more.response[other - n, place]


@fused
def _add_responses(one: Tableau, more: Entering, place: int, action: float, out: Array) -> None:
    """Add to ``out`` the changes of all states by an action on one unknown."""
    n = len(one.x)
    line = one.response[place] if place < n else more.response[place - n]
    for i in range(n):
        out[i] += action * line[i]
    for i in range(len(out) - n):
        out[n + i] += action * _response(one, more, place, n + i)


@fused
def answers_among(solved: Tableau, entering: Entering, places: Array) -> Array:
    """Changes of the states of some unknowns by a unit action on each of them, one column an action, ``(k, k)``."""
    out = np.empty((len(places), len(places)))
    for j in range(len(places)):
        for i in range(len(places)):
            out[i, j] = _response(solved, entering, places[j], places[i])
    return out
