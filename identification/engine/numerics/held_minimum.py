"""Minimum of a changed quadratic problem for a given set of held unknowns, from the tableau of the solved problem.

A changed problem has further unknowns (the entering ones), or other unknowns that are held. Held unknowns are fixed at
a value, the others are free. The method is the Schur complement method for quadratic programs (Gill, Murray, Saunders
and Wright, 1990): the size of the linear system is the number of changes, not that of the problem. The code is
compiled, because a search solves about a hundred thousand of these systems.

An action on an unknown of the solved problem is a force (a change of the linear part) if the unknown is free there, and
a shift of its value if it is held there. The state of an unknown is its value if it is free and the slope of the loss
if it is held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.engine.numerics.tableau import RIDGE, Entering, Tableau
from phantom_dyn._kernels.jit import fused
from phantom_dyn.array_types import Array, Float, Int

# Largest number of Newton steps that remove rounding errors, and the decrease of the loss by a step at or below which
# the steps have converged.
_CORRECTED, _SMALL = 8, 0.01


class HeldMinimum(NamedTuple):
    """A minimum with some unknowns held, in the scaled units of the tableau.

    Attributes:
        x: All unknowns, those of the solved problem first, ``(n + m,)``.
        slope: Derivative of the loss by each unknown, zero for free ones, ``(n + m,)``.
        indices: Unknowns on which an action is applied, ``(d,)``. First those that are flipped: free here and held in
            the solved problem, or the other way round. Then those that are held in both, but at different values.
        action: The action on each of these unknowns, ``(d,)``.
        flipped: Number of flipped unknowns.
    """

    x: Float[Array, " v"]
    slope: Float[Array, " v"]
    indices: Int[Array, " d"]
    action: Float[Array, " d"]
    flipped: int


@fused
def minimum(solved: Tableau, entering: Entering, held: Array, value: Array) -> HeldMinimum:
    """Minimum with some unknowns held at given values.

    Args:
        solved: Tableau of the solved problem, with ``n`` unknowns.
        entering: The ``m`` unknowns that are added; the solved problem holds them at zero.
        held: True for held unknowns, ``(n + m,)``.
        value: Values of the held unknowns, ``(n + m,)``.
    """
    n, v = len(solved.x), len(held)
    state, old_value, was_held = np.empty(v), np.zeros(v), np.ones(v, dtype=np.bool_)
    state[:n], state[n:], was_held[:n] = solved.state, entering.slope, solved.held
    indices, action, flips = np.empty(v, dtype=np.int64), np.empty(v), 0
    for i in range(v):
        if i < n and was_held[i]:
            old_value[i] = solved.x[i]
        if held[i] != was_held[i]:
            indices[flips] = i
            flips += 1
    changes = flips
    for i in range(v):
        if held[i] and was_held[i] and value[i] != old_value[i]:
            indices[changes], action[changes] = i, value[i] - old_value[i]
            _add_responses(solved, entering, i, action[changes], state)
            changes += 1
    for j in range(flips):
        index = indices[j]
        action[j] = (value[index] if held[index] else 0.0) - state[index]
    if flips:
        action[:flips] = np.linalg.solve(responses_among(solved, entering, indices[:flips]), action[:flips].copy())
    for j in range(flips):
        _add_responses(solved, entering, indices[j], action[j], state)
    x, slope = np.empty(v), np.zeros(v)
    for i in range(v):
        x[i] = value[i] if held[i] else old_value[i] if was_held[i] else state[i]
        if was_held[i] and held[i]:
            slope[i] = state[i]
    for j in range(flips):
        index = indices[j]
        # A force on an unknown that is held now is the slope of the loss there. A shift is a change of its value.
        if not was_held[index]:
            slope[index] = action[j]
        elif not held[index]:
            x[index] += action[j]
    return HeldMinimum(x, slope, indices[:changes].copy(), action[:changes].copy(), flips)


@fused
def refined(solved: Tableau, entering: Entering, held: Array, found: HeldMinimum) -> tuple:
    """The minimum after Newton steps that remove its rounding errors, its loss, and whether the steps converged."""
    n, v = len(solved.x), len(held)
    x, slope, b, force = found.x.copy(), found.slope, np.empty(v), np.empty(v)
    b[:n], b[n:] = solved.b, -entering.slope
    for j in range(v - n):
        for i in range(n):
            b[n + j] += entering.cross[j, i] * solved.x[i]
    total, converged, last_gain = 0.0, False, np.inf
    for _ in range(_CORRECTED):
        slope = _slope(solved, entering, x, b)
        for i in range(v):
            force[i] = 0.0 if held[i] else -slope[i]
        step = _correction(solved, entering, force, held, found.indices[: found.flipped])
        total, lowered = 0.0, 0.0
        for i in range(v):
            # The ridge on the diagonal is not part of the loss.
            total += x[i] * (slope[i] - b[i] - RIDGE * x[i])
            lowered += slope[i] * step[i]
            x[i] += step[i]
        total, gain = total + lowered, abs(lowered)
        converged = gain <= _SMALL
        if converged or gain > last_gain:
            break
        last_gain = gain
    for i in range(v):
        if not held[i]:
            slope[i] = 0.0
    return HeldMinimum(x, slope, found.indices, found.action, found.flipped), total, converged


@fused
def _slope(solved: Tableau, entering: Entering, x: Array, b: Array) -> Array:
    """Gradient of the loss with the linear part ``b``."""
    n, out = len(solved.x), -b
    # Rows are added one by one: the compiler may not reorder a sum over a row.
    for j in range(n):
        if x[j] != 0.0:
            for i in range(n):
                out[i] += solved.a[j, i] * x[j]
    for j in range(len(x) - n):
        inner = 0.0
        for i in range(n):
            out[i] += entering.cross[j, i] * x[n + j]
            inner += entering.cross[j, i] * x[i]
        for i in range(len(x) - n):
            inner += entering.square[j, i] * x[n + i]
        out[n + j] += inner
    return out


@fused
def _correction(solved: Tableau, entering: Entering, force: Array, held: Array, flipped: Array) -> Array:
    """Change of the free unknowns by a force on each; ``flipped`` holds the flipped unknowns, see `HeldMinimum`."""
    n, v, k = len(solved.x), len(held), len(flipped)
    out = np.zeros(v)
    for p in range(n):
        if not solved.held[p] and force[p] != 0.0:
            _add_responses(solved, entering, p, force[p], out)
    action = np.empty(k)
    if k:
        for j in range(k):
            action[j] = force[flipped[j]] - out[flipped[j]]
        action = np.linalg.solve(responses_among(solved, entering, flipped), action)
        for j in range(k):
            _add_responses(solved, entering, flipped[j], action[j], out)
    for i in range(v):
        if held[i] or i >= n or solved.held[i]:
            out[i] = 0.0
    for j in range(k):
        p = flipped[j]
        if not held[p]:
            out[p] = action[j]
    return out


@fused
def _response(solved: Tableau, entering: Entering, index: int, observed: int) -> float:
    """Change of the state of unknown ``observed`` by a unit action on unknown ``index``."""
    n = len(solved.x)
    if index >= n:
        return (
            entering.response[index - n, observed]
            if observed < n
            else entering.schur_complement[index - n, observed - n]
        )
    if observed < n:
        return solved.response[index, observed]
    # Responses are symmetric, except that those between a free and a held unknown have opposite signs.
    return entering.response[observed - n, index] if solved.held[index] else -entering.response[observed - n, index]


@fused
def _add_responses(solved: Tableau, entering: Entering, index: int, action: float, out: Array) -> None:
    """Add to ``out`` the changes of all states by an action on one unknown."""
    n = len(solved.x)
    row = solved.response[index] if index < n else entering.response[index - n]
    for i in range(n):
        out[i] += action * row[i]
    for i in range(len(out) - n):
        out[n + i] += action * _response(solved, entering, index, n + i)


@fused
def responses_among(solved: Tableau, entering: Entering, indices: Array) -> Array:
    """Responses of the states of some unknowns to a unit action on each of them, one column per action, ``(k, k)``."""
    out = np.empty((len(indices), len(indices)))
    for j in range(len(indices)):
        for i in range(len(indices)):
            out[i, j] = _response(solved, entering, indices[j], indices[i])
    return out
