"""Weighted least squares on whole arrays of base equations, for estimators that go over the equations several times."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from identification.estimators.linear.scatter import autocorrelation, correlation_factor, joint_noise, scatter_of_rows
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from phantom_dyn.errors import IdentifiabilityError

Array = np.ndarray

_LEAST = 1e-11  # a column that adds less than this share of its norm to those before it is lost in rounding


def base_rows(regressor: Regressor, base: BaseParameters) -> Float[Array, "N nv r"]:
    """Rows of the base parameters.

    Args:
        regressor: The equations.
        base: Which columns are the unknowns.
    """
    kept = list(base.independent)
    empty = np.zeros((0, regressor.robot.nv, len(kept)))
    return np.concatenate([empty, *(block[:, :, kept] for block in regressor.blocks())])


def factor_of(rows: Float[Array, "N nv r"], weights: Float[Array, " nv"]) -> Float[Array, "r r"]:
    """Triangular factor of rows that count by the weights of their joints.

    Args:
        rows: Of the unknowns.
        weights: One over the noise of each joint.

    Raises:
        IdentifiabilityError: If the rows do not determine the unknowns.
    """
    r = rows.shape[2]
    factor = np.asarray(np.linalg.qr((rows * weights[:, None]).reshape(-1, r), mode="r"))
    norms = np.linalg.norm(factor, axis=0)
    if len(factor) < r or not norms.all() or (np.abs(np.diag(factor)) < _LEAST * norms).any():
        raise IdentifiabilityError(
            f"The simulated motion does not determine the {r} base parameters: record more motion or leave effects out."
        )
    return factor


def least_squares(
    rows: Float[Array, "N nv r"], target: Float[Array, "N nv"], weights: Float[Array, " nv"]
) -> tuple[Float[Array, " r"], Float[Array, "r r"]]:
    """Solution of weighted equations and their triangular factor.

    Args:
        rows: Of the unknowns.
        target: Right-hand side.
        weights: One over the noise of each joint.

    Raises:
        IdentifiabilityError: If the rows do not determine the unknowns.
    """
    factor = factor_of(rows, weights)
    right = np.einsum("njr,nj->r", rows, target * weights**2, optimize=True)
    return solve_triangular(factor, solve_triangular(factor, right, trans=1)), factor


def covariances(
    influence: Float[Array, "N nv r"],
    residual: Float[Array, "N nv"],
    sigma: Float[Array, " nv"],
    starts: tuple[int, ...],
) -> tuple[Float[Array, "r r"], Float[Array, "r r"], Float[Array, " nv"]]:
    """Covariance with the memory of the noise, without it, and samples per independent sample of each joint.

    Args:
        influence: Change of each estimate per noise of each joint at each sample, shape ``(N, nv, r)``.
        residual: Noise of each joint at each sample, as the estimate leaves it.
        sigma: Standard deviation of each joint's noise.
        starts: First sample of each recording, and N.
    """
    rho = [autocorrelation(column, starts) for column in residual.T]
    r = influence.shape[2]
    cov, white = np.zeros((r, r)), np.zeros((r, r))
    for start, stop in pairwise(starts):
        rows = influence[start:stop]
        if len(rows):
            cov += scatter_of_rows(rows, sigma**2, rho)
            white += np.einsum("j,njk,njl->kl", sigma**2, rows, rows, optimize=True)
    return 0.5 * (cov + cov.T), white, np.array([correlation_factor(lags) for lags in rho])


def influence_of(
    rows: Float[Array, "N nv r"], factor: Float[Array, "r r"], weights: Float[Array, " nv"]
) -> Float[Array, "N nv r"]:
    """Change of each least-squares estimate per noise of each joint at each sample, shape ``(N, nv, r)``.

    Args:
        rows: Of the unknowns.
        factor: Their triangular factor.
        weights: One over the noise of each joint.
    """
    flat = (rows * weights[:, None] ** 2).reshape(-1, rows.shape[2]).T
    return solve_triangular(factor, solve_triangular(factor, flat, trans=1)).T.reshape(rows.shape)


def residual_noise(
    rows: Float[Array, "N nv r"], influence: Float[Array, "N nv r"], residual: Float[Array, "N nv"]
) -> Float[Array, " nv"]:
    """Standard deviation of each joint's noise, see `joint_noise`.

    Args:
        rows: Of the unknowns.
        influence: Change of each estimate per noise of each joint at each sample, shape ``(N, nv, r)``.
        residual: Torque that the estimates leave.
    """
    return joint_noise(residual, np.einsum("njk,njk->j", influence, rows, optimize=True))
