"""Covariance of all fitted parameters: by the noise model, or by the scatter between blocks if that is larger."""

from __future__ import annotations

import numpy as np

from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float, Int


def free_parameters(
    b: Float[Array, "B p"],
    precision: Float[Array, " p"],
    x: Float[Array, " p"],
    bounds: tuple[Float[Array, " p"], Float[Array, " p"]],
) -> Int[Array, " f"]:
    """Indices of the parameters without an active bound.

    A bound is active if the parameter is at the bound and the gradient points beyond it.

    Args:
        b: Products of slopes and residual of each block.
        precision: Prior precision of each parameter.
        x: The parameters.
        bounds: Lower and upper bounds.
    """
    gradient = b.sum(axis=0) - precision * x
    lower, upper = bounds
    return np.flatnonzero(~(((x <= lower) & (gradient < 0.0)) | ((x >= upper) & (gradient > 0.0))))


def covariance(
    a: Float[Array, "B p p"],
    b: Float[Array, "B p"],
    precision: Float[Array, " p"],
    x: Float[Array, " p"],
    free: Int[Array, " f"],
    repeated: Float[Array, " p"],
) -> Float[Array, "p p"]:
    """Covariance by the noise model, with standard deviations enlarged to the scatter between blocks if that is larger.

    The scatter is a sum of three variances: that of the block jackknife (the fit repeated without each block), that of
    the prior, and ``repeated``. The jackknife excludes parameters with an active bound: they do not change when a block
    is left out.

    Args:
        a: Products of slopes of each block.
        b: Products of slopes and residual of each block.
        precision: Prior precision of each parameter.
        x: The parameters.
        free: Indices of the parameters without an active bound.
        repeated: Variance of each parameter from model errors that repeat whenever the robot is in the same state. The
            jackknife does not show these errors.
    """
    total = a.sum(axis=0) + np.diag(precision)
    inverse = solve(total, np.eye(len(x)))
    count = len(a)
    gradient = b.sum(axis=0) - precision * x
    changes = np.zeros((count, len(x)))
    for k in range(count):
        changes[k, free] = solve((total - a[k])[np.ix_(free, free)], (gradient - b[k])[free])
    changes -= changes.mean(axis=0)
    scatter = (count - 1) / count * changes.T @ changes + inverse @ np.diag(precision) @ inverse
    larger = np.sqrt(np.maximum(1.0, (np.diag(scatter) + repeated) / np.maximum(np.diag(inverse), 1e-300)))
    return inverse * np.outer(larger, larger)
