"""Covariance of all fitted parameters: by the noise model, or by the scatter between blocks if that is larger."""

from __future__ import annotations

import numpy as np

from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float, Int

# Parameters that are equal but for this share of their variance count as separated by it.
_SINGULAR = 1e-12


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
    repeated: Float[Array, "p p"],
    together: tuple[slice, ...] = (),
) -> Float[Array, "p p"]:
    """Covariance by the noise model, enlarged to the scatter between blocks where that is larger.

    The scatter is a sum of three covariances: that of the block jackknife (the fit repeated without each block), that
    of the prior, and ``repeated``. The jackknife excludes parameters with an active bound: they do not change when a
    block is left out.

    Single parameters keep the correlations of the noise model. These are false for parameters that a recording hardly
    separates: blocks may shift a bristle's torque and the Coulomb torque by the same, and their sum by nothing. So the
    parameters that are listed in ``together`` are enlarged in the directions in which the scatter is larger.

    Args:
        a: Products of slopes of each block.
        b: Products of slopes and residual of each block.
        precision: Prior precision of each parameter.
        x: The parameters.
        free: Indices of the parameters without an active bound.
        repeated: Covariance from model errors that repeat whenever the robot is in the same state. The jackknife does
            not show these errors.
        together: Groups of few parameters that are enlarged together.
    """
    total = a.sum(axis=0) + np.diag(precision)
    inverse = solve(total, np.eye(len(x)))
    count = len(a)
    gradient = b.sum(axis=0) - precision * x
    changes = np.zeros((count, len(x)))
    for k in range(count):
        changes[k, free] = solve((total - a[k])[np.ix_(free, free)], (gradient - b[k])[free])
    changes -= changes.mean(axis=0)
    scatter = (count - 1) / count * changes.T @ changes + inverse @ np.diag(precision) @ inverse + repeated
    larger = np.diag(np.sqrt(np.maximum(1.0, np.diag(scatter) / np.maximum(np.diag(inverse), 1e-300))))
    for own in together:
        larger[own, own] = _enlargement(inverse[own, own], scatter[own, own])
    return larger @ inverse @ larger.T


def _enlargement(noise: Float[Array, "k k"], scatter: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """Matrix ``E`` such that ``E noise E^T`` is the larger of two covariances in each of their common directions.

    In these directions, the eigenvectors of the scatter relative to the noise, neither covariance has correlations.
    """
    std = np.sqrt(np.maximum(np.diag(noise), 1e-300))
    squares, axes = np.linalg.eigh(noise / np.outer(std, std))
    root = std[:, None] * axes * np.sqrt(np.maximum(squares, _SINGULAR))
    inverse_root = (axes / np.sqrt(np.maximum(squares, _SINGULAR))).T / std
    relative, directions = np.linalg.eigh(inverse_root @ scatter @ inverse_root.T)
    back = root @ directions
    return (back * np.sqrt(np.maximum(1.0, relative))) @ directions.T @ inverse_root
