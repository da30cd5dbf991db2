"""Where the frames of a closed chain come nearest to each other, whether or not they meet."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from phantom_dyn.loops.chain import ClosedChain
from phantom_dyn.loops.constraints import Constraints, error_and_slope

Array = np.ndarray

_LAST_STEP = 1e-11
"""Where the search ends [rad or m]."""


def nearest(
    chain: ClosedChain, at: Constraints, q: Float[Array, " nv"], z: Float[Array, " nz"]
) -> tuple[Float[Array, " nz"], Float[Array, " m"], Float[Array, "m nz"]]:
    """Unknowns at which the frames come nearest to each other (Levenberg-Marquardt), error and slope there."""
    S, nv = chain.linear_map, chain.nv
    fixed, damping = S[:, :nv] @ q + chain.offset, 1e-3

    def evaluate(unknowns: Array) -> tuple[Array, Array]:
        found, slope = error_and_slope(at, fixed + S[:, nv:] @ unknowns)
        return found, slope @ S[:, nv:]

    error, slope = evaluate(z)
    for _ in range(100):
        normal = slope.T @ slope
        step = np.linalg.solve(normal + damping * max(np.trace(normal), 1e-12) * np.eye(len(z)), -slope.T @ error)
        tried, tried_slope = evaluate(z + step)
        if tried @ tried < error @ error:
            z, error, slope, damping = z + step, tried, tried_slope, max(damping / 10, 1e-12)
        else:
            damping *= 10
        if np.abs(step).max() <= _LAST_STEP:
            break
    return z, error, slope
