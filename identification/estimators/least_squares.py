"""Weighted linear least squares on streamed equations, shared by the estimators."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from identification.base_parameters import RANK_TOLERANCE, BaseParameters, base_parameters, r_factor
from identification.regressor import Regressor
from phantom_dyn.errors import IdentifiabilityError

Array = np.ndarray


@dataclass(frozen=True)
class Solution:
    """Least-squares solution of the base equations.

    Attributes:
        theta: Base parameters, shape ``(r,)``.
        factor: Triangular factor of the weighted base regressor, shape ``(r, r)``.
        residual: Torque that is left, not weighted, shape ``(N, nv)``.
        grams: Share of each joint in the information, ``(X_j R^-1)^T (X_j R^-1)`` with the unweighted rows of joint
            ``j`` and ``R`` the factor, shape ``(nv, r, r)``.
    """

    theta: Float[Array, " r"]
    factor: Float[Array, "r r"]
    residual: Float[Array, "N nv"]
    grams: Float[Array, "nv r r"]

    @property
    def condition(self) -> float:
        """Condition number of the weighted base regressor, each column divided by its norm."""
        scaled = np.linalg.svd(self.factor / np.linalg.norm(self.factor, axis=0), compute_uv=False)
        return float(scaled[0] / scaled[-1])


def base_of(regressor: Regressor, tolerance: float = RANK_TOLERANCE) -> BaseParameters:
    """Base parameters of a regressor that excites at least one.

    Raises:
        IdentifiabilityError: If no column produces torque.
    """
    base = base_parameters(regressor, tolerance=tolerance)
    if not base.rank:
        some = ", ".join(regressor.names[:3]) + (", ..." if len(regressor.names) > 3 else "")
        raise IdentifiabilityError(
            f"The recording excites none of the {len(regressor.names)} parameters ({some}): record a motion that "
            "moves the joints in question."
        )
    return base


def solve(regressor: Regressor, base: BaseParameters, weights: Float[Array, "N nv"]) -> Solution:
    """Base parameters that minimise the sum of squares of ``weights * (W theta - y)``.

    Args:
        regressor: The equations.
        base: Which columns are the unknowns.
        weights: Of each row; 1 over its noise.

    Raises:
        IdentifiabilityError: If the weights leave fewer independent rows than unknowns.
    """
    factor = r_factor(_augmented(regressor, base, weights))
    r = base.rank
    square, right = factor[:r, :r], factor[:r, r]
    norms = np.linalg.norm(square, axis=0)
    # Rows with weight zero can take a column away that the base set has counted on.
    if len(square) < r or np.abs(np.diag(square) / np.where(norms > 0, norms, 1.0)).min() < 1e-12:
        raise IdentifiabilityError(
            f"The weighted equations do not determine the {r} base parameters: record more motion or leave effects out."
        )
    theta = solve_triangular(square, right)
    residual = np.empty_like(regressor.y)
    grams = np.zeros((regressor.robot.nv, r, r))
    for at, block in base_blocks(regressor, base):
        residual[at] = regressor.y[at] - block @ theta
        white = whitened(square, block)
        grams += np.einsum("njk,njl->jkl", white, white, optimize=True)
    return Solution(theta, square, residual, grams)


def whitened(factor: Float[Array, "r r"], block: Float[Array, "n nv r"]) -> Float[Array, "n nv r"]:
    """``X R^-1``: rows of the base regressor in coordinates in which its information is the identity.

    Args:
        factor: Triangular factor ``R``.
        block: Rows of the base regressor.
    """
    return solve_triangular(factor, block.reshape(-1, block.shape[2]).T, trans=1).T.reshape(block.shape)


def base_blocks(regressor: Regressor, base: BaseParameters) -> Iterator[tuple[slice, Array]]:
    """Blocks of the base regressor with the samples they hold.

    Args:
        regressor: The equations.
        base: Which columns are the unknowns.
    """
    start = 0
    for block in regressor.blocks():
        yield slice(start, start + len(block)), block[:, :, list(base.independent)]
        start += len(block)


def _augmented(regressor: Regressor, base: BaseParameters, weights: Array) -> Iterator[Array]:
    for at, block in base_blocks(regressor, base):
        rows = np.concatenate([block, regressor.y[at][:, :, None]], axis=2)
        yield rows * weights[at][:, :, None]
