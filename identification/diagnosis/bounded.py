"""Small quadratic minima within bounds."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

Array = np.ndarray


def solve(a: Float[Array, "k k"], b: Float[Array, "k ..."]) -> Float[Array, "k ..."]:
    """Solution of ``a x = b`` for a positive definite ``a`` whose rows may differ by many orders of magnitude."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
    scaled = a * scale[:, None] * scale[None, :]
    # A relative 1e-12 is below what any of these products is known to, and keeps exact twins solvable.
    scaled.flat[:: len(scaled) + 1] += 1e-12
    right = b * (scale if b.ndim == 1 else scale[:, None])
    x = np.linalg.solve(scaled, right)
    return x * (scale if b.ndim == 1 else scale[:, None])


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
        near: Minimum of a similar problem; the bounds that bind there are tried first.
    """
    fixed = np.zeros(len(b), dtype=bool)
    value = np.zeros(len(b))
    if near is not None:
        fixed = (near <= lower) | (near >= upper)
        value[fixed] = near[fixed]
    x = _free_minimum(a, b, fixed, value)
    for sweep in range(72):
        gradient = a @ x - b
        below, above = (x < lower) & ~fixed, (x > upper) & ~fixed
        wrong = fixed & (((x <= lower) & (gradient < -1e-9)) | ((x >= upper) & (gradient > 1e-9)))
        if not (below.any() or above.any() or wrong.any()):
            break
        if sweep < 12:
            fixed &= ~wrong
        elif not (below.any() or above.any()):
            fixed[np.argmax(np.where(wrong, np.abs(gradient), -1.0))] = False
        value[below], value[above] = lower[below], upper[above]
        fixed |= below | above
        x = _free_minimum(a, b, fixed, value)
    return np.clip(x, lower, upper)


def _free_minimum(
    a: Float[Array, "k k"], b: Float[Array, " k"], fixed: Bool[Array, " k"], value: Float[Array, " k"]
) -> Float[Array, " k"]:
    """Minimum with some coefficients fixed at their values."""
    if not fixed.any():
        return solve(a, b)
    free = ~fixed
    x = np.where(fixed, value, 0.0)
    x[free] = solve(a[np.ix_(free, free)], b[free] - a[np.ix_(free, fixed)] @ value[fixed])
    return x
