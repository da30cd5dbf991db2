"""Small quadratic minima within bounds."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from phantom_dyn._kernels.jit import compiles, fused

Array = np.ndarray

# Below what any of these products is known to; it keeps exact twins solvable.
_TWINS = 1e-12
# Sweeps in all, and those in which all wrong multipliers are released at once.
_SWEEPS, _AT_ONCE = 72, 12
# A multiplier is of the wrong sign from this size on.
_WRONG = 1e-9
# Rows that are taken out of all others at once.
_PANEL = 4


def solve(a: Float[Array, "k k"], b: Float[Array, "k ..."]) -> Float[Array, "k ..."]:
    """Solution of ``a x = b`` for a positive definite ``a`` whose rows may differ by many orders of magnitude."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
    scaled = a * scale[:, None] * scale[None, :]
    scaled.flat[:: len(scaled) + 1] += _TWINS
    right = b * (scale if b.ndim == 1 else scale[:, None])
    x = np.linalg.solve(scaled, right)
    return x * (scale if b.ndim == 1 else scale[:, None])


def solve_each(a: Float[Array, "g k k"], b: Float[Array, "g k r"]) -> Float[Array, "g k r"]:
    """As `solve`, for several matrices of one size at once."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(a, axis1=1, axis2=2), 1e-300))
    scaled = a * scale[:, :, None] * scale[:, None, :] + _TWINS * np.eye(a.shape[-1])
    return np.linalg.solve(scaled, b * scale[:, :, None]) * scale[:, :, None]


def bounded_solve(
    a: Float[Array, "k k"],
    b: Float[Array, " k"],
    lower: Float[Array, " k"],
    upper: Float[Array, " k"],
    near: Float[Array, " k"] | None = None,
) -> Float[Array, " k"]:
    """Minimum of ``x a x / 2 - b x`` within bounds, ``a`` positive definite, by active sets.

    First all violated bounds are taken in and all wrong multipliers released at once, sweep by sweep (the primal-dual
    active set method of Hintermueller, Ito and Kunisch, 2002), which takes three to five sweeps. Where that does not
    settle, multipliers are released one by one, which always does.

    Args:
        a: Quadratic part.
        b: Linear part.
        lower: Lower bounds.
        upper: Upper bounds.
        near: Minimum of a similar problem; the bounds that bind there are tried first. Not a number: none is.
    """
    start = np.full(len(b), np.nan) if near is None else near
    return _bounded_minimum(np.ascontiguousarray(a), b, lower, upper, start)


def bounded_solve_without(
    a: Float[Array, "k k"],
    b: Float[Array, " k"],
    less_a: Float[Array, "F k k"],
    less_b: Float[Array, "F k"],
    lower: Float[Array, " k"],
    upper: Float[Array, " k"],
    near: Float[Array, " k"],
) -> Float[Array, "F k"]:
    """As `bounded_solve`, once without each of several parts of ``a`` and ``b``."""
    out = np.empty((len(less_a), len(b)))
    _minima_without(a, b, less_a, less_b, lower, upper, near, out)
    return out


@fused
def _minima_without(
    a: Array, b: Array, less_a: Array, less_b: Array, lower: Array, upper: Array, near: Array, out: Array
) -> None:
    """Fill ``out`` with the minimum without each part."""
    for part in range(len(out)):
        out[part] = _bounded_minimum(a - less_a[part], b - less_b[part], lower, upper, near)


@fused
def _bounded_minimum(a: Array, b: Array, lower: Array, upper: Array, near: Array) -> Array:
    """Minimum within bounds from the bounds that bind at ``near``."""
    fixed = (near <= lower) | (near >= upper)
    x = _free_minimum(a, b, fixed, np.where(fixed, near, 0.0))
    for sweep in range(_SWEEPS):
        gradient = np.dot(a, x) - b
        below, above = (x < lower) & ~fixed, (x > upper) & ~fixed
        wrong = fixed & (((x <= lower) & (gradient < -_WRONG)) | ((x >= upper) & (gradient > _WRONG)))
        outside = below | above
        if not np.any(outside | wrong):
            break
        value = np.where(below, lower, np.where(above, upper, x))
        if sweep < _AT_ONCE:
            fixed = fixed & ~wrong
        elif not np.any(outside):
            fixed[np.argmax(np.where(wrong, np.abs(gradient), -1.0))] = False
        fixed = fixed | outside
        x = _free_minimum(a, b, fixed, np.where(fixed, value, 0.0))
    return np.minimum(np.maximum(x, lower), upper)


def _free_minimum_plain(
    a: Float[Array, "k k"], b: Float[Array, " k"], fixed: Bool[Array, " k"], x: Float[Array, " k"]
) -> Float[Array, " k"]:
    """Minimum with some coefficients fixed at their values in ``x``, the others zero there."""
    free = ~fixed
    x[free] = solve(a[np.ix_(free, free)], b[free] - a[free] @ x)
    return x


@fused
def _free_minimum_compiled(a: Array, b: Array, fixed: Array, x: Array) -> Array:
    """The same, by ``L D L^T`` without an order of pivots, which a positive definite matrix does not need."""
    free = np.flatnonzero(~fixed)
    count = len(free)
    scale, right = np.empty(count), np.empty(count)
    for i in range(count):
        scale[i] = 1.0 / np.sqrt(max(a[free[i], free[i]], 1e-300))
    u = np.empty((count, count))
    moved = b - np.dot(a, x) if count < len(b) else b
    for i in range(count):
        row = a[free[i]]
        for k in range(i, count):
            u[i, k] = row[free[k]] * scale[i] * scale[k]
        u[i, i] += _TWINS
        right[i] = moved[free[i]] * scale[i]
    for first in range(0, count, _PANEL):
        last = min(first + _PANEL, count)
        for j in range(first, last):
            for i in range(j + 1, last):
                share = u[j, i] / u[j, j]
                for k in range(i, count):
                    u[i, k] -= share * u[j, k]
                right[i] -= share * right[j]
        if last - first < _PANEL:
            break
        # Four rows are taken out at once: each row below is read and written once for all of them.
        j, m, n, o = first, first + 1, first + 2, first + 3
        for i in range(last, count):
            p, q, r, s = u[j, i] / u[j, j], u[m, i] / u[m, m], u[n, i] / u[n, n], u[o, i] / u[o, o]
            for k in range(i, count):
                u[i, k] -= p * u[j, k] + q * u[m, k] + r * u[n, k] + s * u[o, k]
            right[i] -= p * right[j] + q * right[m] + r * right[n] + s * right[o]
    for j in range(count - 1, -1, -1):
        rest = right[j]
        for k in range(j + 1, count):
            rest -= u[j, k] * right[k]
        right[j] = rest / u[j, j]
    for i in range(count):
        x[free[i]] = right[i] * scale[i]
    return x


# Interpreted, the loops of the factorisation would be far slower than LAPACK.
_free_minimum = _free_minimum_compiled if compiles() else _free_minimum_plain
