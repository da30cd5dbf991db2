"""Minimises small quadratic functions ``x a x / 2 - b x`` within bounds."""

from __future__ import annotations

import numpy as np

from identification.engine.numerics.elimination import eliminate, solve_eliminated
from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn.array_types import Array, Float

# Added to the diagonal of a matrix that is scaled to a unit diagonal, so that problems with two equal columns can be
# solved. It is smaller than the rounding errors of the products.
_RIDGE = 1e-12
# Largest number of steps that exchange all wrong bounds at once, and of the following steps that each lower the loss.
# After the last step the present point is returned.
_AT_ONCE, _DESCENDING = 10, 400
# A multiplier (the slope of the loss at a bound) counts as having the wrong sign from this size on.
_WRONG = 1e-9


def solve(a: Float[Array, "k k"], b: Float[Array, "k ..."]) -> Float[Array, "k ..."]:
    """Solution of ``a x = b`` for a positive definite ``a`` whose rows may differ by many orders of magnitude."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
    scaled = a * scale[:, None] * scale[None, :]
    scaled.flat[:: len(scaled) + 1] += _RIDGE
    right = b * (scale if b.ndim == 1 else scale[:, None])
    x = np.linalg.solve(scaled, right)
    return x * (scale if b.ndim == 1 else scale[:, None])


def solve_each(a: Float[Array, "g k k"], b: Float[Array, "g k r"]) -> Float[Array, "g k r"]:
    """Solutions of ``a x = b`` as `solve` returns them, for several matrices of one size at once."""
    if a.shape[-1] == 1:  # the most frequent case, in which a division is many times as fast as LAPACK
        return b / (np.maximum(a, 1e-300) * (1.0 + _RIDGE))
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(a, axis1=1, axis2=2), 1e-300))
    scaled = a * scale[:, :, None] * scale[:, None, :] + _RIDGE * np.eye(a.shape[-1])
    return np.linalg.solve(scaled, b * scale[:, :, None]) * scale[:, :, None]


def bounded_solve(
    a: Float[Array, "k k"],
    b: Float[Array, " k"],
    lower: Float[Array, " k"],
    upper: Float[Array, " k"],
    near: Float[Array, " k"] | None = None,
) -> Float[Array, " k"]:
    """Minimum of ``x a x / 2 - b x`` within bounds, ``a`` positive definite, by active sets.

    The first steps make all violated bounds active and all bounds with a wrong multiplier inactive (the primal-dual
    active set method of Hintermueller, Ito and Kunisch, 2002). They usually converge within a few steps, but may cycle
    if two columns are nearly equal. The steps after them lower the loss each time, so that no active set is repeated.

    Args:
        a: Quadratic part.
        b: Linear part.
        lower: Lower bounds.
        upper: Upper bounds.
        near: Minimum of a similar problem, whose active bounds are tried first; NaN for unknowns without a start.
    """
    start = np.full(len(b), np.nan) if near is None else near
    return _minima_of(a, b, np.zeros((0, len(b), len(b))), np.zeros((0, len(b))), np.stack([lower, upper, start]))[0]


def bounded_solve_without(
    a: Float[Array, "k k"],
    b: Float[Array, " k"],
    less_a: Float[Array, "F k k"],
    less_b: Float[Array, "F k"],
    lower: Float[Array, " k"],
    upper: Float[Array, " k"],
    near: Float[Array, " k"],
) -> Float[Array, "F k"]:
    """Minima within bounds, one row for each part (fold) that is subtracted from ``a`` and ``b``; see `bounded_solve`.

    Args:
        a: Quadratic part, with all parts.
        b: Linear part, with all parts.
        less_a: Part of ``a`` that each row leaves out.
        less_b: Part of ``b`` that each row leaves out.
        lower: Lower bounds.
        upper: Upper bounds.
        near: Minimum of a similar problem, whose active bounds are tried first; NaN for unknowns without a start.
    """
    return _minima_of(a, b, less_a, less_b, np.stack([lower, upper, near]))[: len(less_a)]


def _minima_of(a: Array, b: Array, less_a: Array, less_b: Array, ends: Array) -> Array:
    """Result of `_minima`, called with arrays of one memory layout: the loop is compiled once for each layout."""
    k = len(b)
    out = np.empty((max(len(less_a), 1), k))
    a, b, less_a, less_b = (np.ascontiguousarray(array, dtype=float) for array in (a, b, less_a, less_b))
    # Work space is allocated here: compiling the allocation of an array takes longer than compiling a loop.
    work = np.empty((2, k, k)), np.empty((8, k)), np.empty((2, k), dtype=bool), np.empty(k, dtype=np.int64)
    _minima(a, b, less_a, less_b, ends, out, work)
    return out


@fused
def _minima(
    a: Array,
    b: Array,
    less_a: Array,
    less_b: Array,
    ends: Array,
    out: Array,
    work: tuple[Array, Array, Array, Array],
) -> None:
    """Fill each row of ``out`` with a minimum within bounds.

    The loops are over single numbers, because array expressions take several times as long to compile.

    Args:
        a: Quadratic part.
        b: Linear part.
        less_a: Part of ``a`` that each row leaves out; of length 0 if nothing is left out.
        less_b: Part of ``b`` that each row leaves out.
        ends: Lower bounds, upper bounds and start, ``(3, k)``.
        out: One row per minimum.
        work: Arrays that the loop works in, from `_minima_of`.
    """
    k = len(b)
    matrices, vectors, flags, free = work
    lower, upper, near = ends[0], ends[1], ends[2]
    fixed, outside = flags[0], flags[1]
    right, x, trial, end, gradient = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    for part in range(len(out)):
        for i in range(k):
            right[i] = b[i] - less_b[part, i] if len(less_b) else b[i]
            for j in range(k):
                matrices[0, i, j] = a[i, j] - less_a[part, i, j] if len(less_a) else a[i, j]
            x[i], fixed[i] = near[i], near[i] <= lower[i] or near[i] >= upper[i]
        # For the steps that lower the loss: the loss now, the loss when bounds were last released, and the released
        # unknown with the largest expected gain.
        lowest, at_release, best = np.inf, np.inf, -1
        for step in range(_AT_ONCE + _DESCENDING):
            descending = step >= _AT_ONCE
            for i in range(k):
                trial[i] = x[i] if fixed[i] else 0.0
            _free_minimum(matrices, right, fixed, trial, vectors, free)
            violated = _clip_to_bounds(trial, lower, upper, fixed, outside, end)
            reached = _loss(matrices, right, end if descending else trial, gradient)
            if descending and violated:
                if reached < lowest:
                    _hold(outside, end, fixed, x)
                    lowest, best = reached, -1
                elif best >= 0:
                    # Releasing all bounds at once raised the loss: release only the best one.
                    for i in range(k):
                        fixed[i] = i != best and (x[i] <= lower[i] or x[i] >= upper[i])
                    best = -1
                else:
                    _step_to_first_bound(outside, trial, end, fixed, x)
                continue
            converged = descending and reached >= at_release  # equal up to rounding
            best = _release(matrices, gradient, trial, lower, upper, fixed)
            _hold(outside, end, fixed, x)
            if violated == 0 and (converged or best < 0):
                break
            if descending:
                lowest, at_release = reached, reached
        for i in range(k):
            out[part, i] = min(max(x[i], lower[i]), upper[i])


@inlined
def _clip_to_bounds(x: Array, lower: Array, upper: Array, fixed: Array, outside: Array, out: Array) -> int:
    """Write a point, clipped to its bounds, to ``out``; mark the unknowns that were outside and return their number."""
    count = 0
    for i in range(len(x)):
        outside[i] = not fixed[i] and (x[i] < lower[i] or x[i] > upper[i])
        out[i] = min(max(x[i], lower[i]), upper[i]) if outside[i] else x[i]
        count += outside[i]
    return count


@inlined
def _hold(outside: Array, end: Array, fixed: Array, x: Array) -> None:
    """Set ``x`` to a clipped point, and fix the unknowns that were outside of their bounds."""
    for i in range(len(x)):
        x[i] = end[i]
        fixed[i] = fixed[i] or outside[i]


@inlined
def _release(matrices: Array, slope: Array, x: Array, lower: Array, upper: Array, fixed: Array) -> int:
    """Free all unknowns at a bound from which the loss decreases inwards.

    Returns:
        The freed unknown with the largest expected gain; -1 if none is freed.
    """
    most, largest = -1, 0.0
    for i in range(len(x)):
        inwards = (x[i] <= lower[i] and slope[i] < -_WRONG) or (x[i] >= upper[i] and slope[i] > _WRONG)
        if fixed[i] and inwards and lower[i] < upper[i]:
            fixed[i] = False
            gain = slope[i] * slope[i] / max(matrices[0, i, i], 1e-300)
            if gain > largest:
                most, largest = i, gain
    return most


@inlined
def _step_to_first_bound(outside: Array, to: Array, end: Array, fixed: Array, x: Array) -> None:
    """Move ``x`` straight towards a point until the first unknown reaches its bound, and fix this unknown."""
    share, first = 1.0, -1
    for i in range(len(x)):
        if outside[i]:
            own = (end[i] - x[i]) / (to[i] - x[i])
            if own <= share:
                share, first = own, i
    for i in range(len(x)):
        # Rounding must not move the other unknowns beyond their bounds.
        moved = x[i] + share * (to[i] - x[i])
        x[i] = moved if not outside[i] or (moved < end[i]) == (x[i] < end[i]) else end[i]
    x[first], fixed[first] = end[first], True


@inlined
def _loss(matrices: Array, b: Array, x: Array, slope: Array) -> float:
    """Value of ``x a x / 2 - b x``; the gradient is written to ``slope``."""
    _slope(matrices, b, x, slope)
    total = 0.0
    for i in range(len(x)):
        total += 0.5 * x[i] * (slope[i] - b[i])
    return total


@inlined
def _slope(matrices: Array, b: Array, x: Array, out: Array) -> None:
    """Fill ``out`` with ``a x - b``, with ``a`` the first matrix."""
    for i in range(len(x)):
        out[i] = -b[i]
    # Rows are added one by one: the compiler may not reorder a sum over a row.
    for j in range(len(x)):
        if x[j] != 0.0:
            for i in range(len(x)):
                out[i] += matrices[0, j, i] * x[j]


@inlined
def _free_minimum(matrices: Array, b: Array, fixed: Array, x: Array, vectors: Array, free: Array) -> None:
    """Fill the free entries of ``x`` with the minimum for the given fixed ones; the free entries are zero at first.

    The solution is by ``L D L^T`` without pivoting, which a positive definite matrix does not need.
    """
    scale, right, moved = vectors[5], vectors[6], vectors[7]
    _slope(matrices, b, x, moved)
    # With a plain zero the called functions would be compiled twice, for that literal and for any integer.
    count = np.int64(0)
    for i in range(len(b)):
        if not fixed[i]:
            free[count] = i
            scale[count] = 1.0 / np.sqrt(max(matrices[0, i, i], 1e-300))
            right[count] = -moved[i] * scale[count]
            count += 1
    for i in range(count):
        for k in range(i, count):
            matrices[1, i, k] = matrices[0, free[i], free[k]] * scale[i] * scale[k]
        matrices[1, i, i] += _RIDGE
    eliminate(matrices[1], count)
    solve_eliminated(matrices[1], right, count)
    for i in range(count):
        x[free[i]] = right[i] * scale[i]
