"""Weighted linear least squares for base parameters, from equations in blocks or in whole arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from identification.regression.base_parameters import BaseParameters, base_parameters
from identification.regression.regressor import Regressor
from identification.regression.triangular import ROWS, absorb, one_blas_thread, triangular
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import IdentifiabilityError

_KEPT = 5_000_000
"""Largest number of entries of the base equations that are kept in memory (40 MB); larger ones are recomputed."""

_DEPENDENT = 1e-11  # a column is dependent if less than this share of its norm is independent of the columns before it


@dataclass(frozen=True)
class Solution:
    """Least-squares solution of the base equations.

    Attributes:
        theta: Base parameters, shape ``(r,)``.
        factor: Triangular factor of the weighted base regressor, shape ``(r, r)``.
        residual: Residual torque, not weighted, shape ``(N, nv)``.
        grams: Gram matrix ``(X_j R^-1)^T (X_j R^-1)`` of each joint, where ``X_j`` are its unweighted rows and ``R`` is
            ``factor``, shape ``(nv, r, r)``.
        rows: For each joint, the columns on which its torque can depend (`base_places`), transposed, ``(c, N)``; empty
            if they are too large to be kept in memory.
    """

    theta: Float[Array, " r"]
    factor: Float[Array, "r r"]
    residual: Float[Array, "N nv"]
    grams: Float[Array, "nv r r"]
    rows: tuple[Float[Array, "_ N"], ...] = ()


def base_of(regressor: Regressor) -> BaseParameters:
    """Base parameters of a regressor.

    Raises:
        IdentifiabilityError: If no column produces torque.
    """
    base = base_parameters(regressor)
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
        weights: Weight of each row, which is one over its noise.

    Raises:
        IdentifiabilityError: If the weighted equations do not determine the unknowns.
    """
    factor = _weighted_factor(regressor, base, weights)
    theta, square = solve_factor(factor)
    residual, rows = _residual_and_rows(regressor, base, theta)
    return Solution(theta, square, residual, joint_grams(regressor.reduction.rows(base.independent), square), rows)


def solve_factor(factor: Float[Array, "q q"]) -> tuple[Float[Array, " r"], Float[Array, "r r"]]:
    """Base parameters and the triangular factor of the base regressor.

    Args:
        factor: Triangular factor of ``[W y]``, ``(r + 1, r + 1)``.

    Raises:
        IdentifiabilityError: If the equations do not determine the unknowns.
    """
    r = len(factor) - 1
    square, right = factor[:r, :r], factor[:r, r]
    norms = np.linalg.norm(square, axis=0)
    # Rows of weight zero may make columns dependent.
    if (np.abs(np.diag(square)) < 1e-12 * norms).any() or not norms.all():
        raise IdentifiabilityError(
            f"The weighted equations do not determine the {r} base parameters: record more motion or leave effects out."
        )
    return solve_triangular(square, right), square


def joint_grams(rows: Sequence[Float[Array, "_ q"]], factor: Float[Array, "r r"]) -> Float[Array, "nv r r"]:
    """Gram matrix ``(X_j R^-1)^T (X_j R^-1)`` of each joint's base regressor ``X_j``.

    Args:
        rows: For each joint, few rows with the same Gram matrix as its base regressor; the last column is the torque.
        factor: Triangular factor ``R``.
    """
    white = [solve_triangular(factor, joint[:, :-1].T, trans=1) for joint in rows]
    return np.array([w @ w.T for w in white])


def base_blocks(regressor: Regressor, base: BaseParameters) -> Iterator[tuple[slice, Array]]:
    """Blocks of the base regressor, each with the slice of its samples.

    Args:
        regressor: The equations.
        base: Which columns are the unknowns.
    """
    start = 0
    for block in regressor.blocks(base.independent):
        yield slice(start, start + len(block)), block
        start += len(block)


def base_places(regressor: Regressor, base: BaseParameters) -> list[list[int]]:
    """For each joint, the indices of the base columns on which its torque can depend; the others are zero in its rows.

    Args:
        regressor: The equations.
        base: Which columns are the unknowns.
    """
    touched_columns = [set(columns) for columns in regressor.touched]
    return [[k for k, column in enumerate(base.independent) if column in touched] for touched in touched_columns]


def _residual_and_rows(regressor: Regressor, base: BaseParameters, theta: Array) -> tuple[Array, tuple[Array, ...]]:
    """The fields ``residual`` and ``rows`` of `Solution`."""
    places, y = base_places(regressor, base), regressor.y
    residual = np.empty_like(y)
    fit_in_memory = len(y) * sum(map(len, places)) <= _KEPT
    rows = tuple(np.empty((len(place), len(y))) for place in places) if fit_in_memory else ()
    for at, block in base_blocks(regressor, base):
        if fit_in_memory:
            for joint, place in enumerate(places):
                rows[joint][:, at] = block[:, joint, place].T
        else:
            np.subtract(y[at], block @ theta, out=residual[at])
    for joint, rows_of_joint in enumerate(rows):
        residual[:, joint] = y[:, joint] - theta[places[joint]] @ rows_of_joint
    return residual, rows


def _weighted_factor(regressor: Regressor, base: BaseParameters, weights: Array) -> Array:
    """Triangular factor of the weighted base regressor and torque."""
    reduction = regressor.reduction
    columns = base.independent
    if (weights == weights[:1]).all():  # with constant weights the samples are not needed
        return triangular(np.concatenate(reduction.weighted(weights[0]).rows(columns)))
    r = len(columns)
    places = base_places(regressor, base)
    factors = [np.zeros((len(place) + 1, len(place) + 1), order="F") for place in places]
    with one_blas_thread():
        for at, block in base_blocks(regressor, base):
            for first in range(0, len(block), ROWS):
                part = block[first : first + ROWS]
                at_part = slice(at.start + first, at.start + first + len(part))
                for joint, place in enumerate(places):
                    rows = np.empty((len(part), len(place) + 1), order="F")
                    rows[:, :-1] = part[:, joint, place]
                    rows[:, -1] = regressor.y[at_part, joint]
                    rows *= weights[at_part, joint, None]
                    absorb(factors[joint], rows)
    wide = [np.zeros((len(factor), r + 1)) for factor in factors]
    for rows, place, factor in zip(wide, places, factors, strict=True):
        rows[:, [*place, r]] = factor
    return triangular(np.concatenate(wide))


def base_rows(regressor: Regressor, base: BaseParameters) -> Float[Array, "N nv r"]:
    """The base regressor as one array.

    Args:
        regressor: The equations.
        base: Which columns are the unknowns.
    """
    kept = list(base.independent)
    empty = np.zeros((0, regressor.robot.nv, len(kept)))
    return np.concatenate([empty, *(block[:, :, kept] for block in regressor.blocks())])


def factor_of(rows: Float[Array, "N nv r"], weights: Float[Array, " nv"]) -> Float[Array, "r r"]:
    """Triangular factor of weighted rows.

    Args:
        rows: Regressor of the unknowns.
        weights: One over the noise of each joint.

    Raises:
        IdentifiabilityError: If the rows do not determine the unknowns.
    """
    r = rows.shape[2]
    factor = np.asarray(np.linalg.qr((rows * weights[:, None]).reshape(-1, r), mode="r"))
    norms = np.linalg.norm(factor, axis=0)
    if len(factor) < r or not norms.all() or (np.abs(np.diag(factor)) < _DEPENDENT * norms).any():
        raise IdentifiabilityError(
            f"The simulated motion does not determine the {r} base parameters: record more motion or leave effects out."
        )
    return factor


def least_squares(
    rows: Float[Array, "N nv r"], target: Float[Array, "N nv"], weights: Float[Array, " nv"]
) -> tuple[Float[Array, " r"], Float[Array, "r r"]]:
    """Solution of weighted equations and their triangular factor.

    Args:
        rows: Regressor of the unknowns.
        target: Right-hand side.
        weights: One over the noise of each joint.

    Raises:
        IdentifiabilityError: If the rows do not determine the unknowns.
    """
    factor = factor_of(rows, weights)
    right = np.einsum("njr,nj->r", rows, target * weights**2, optimize=True)
    return solve_triangular(factor, solve_triangular(factor, right, trans=1)), factor


def influence_of(
    rows: Float[Array, "N nv r"], factor: Float[Array, "r r"], weights: Float[Array, " nv"]
) -> Float[Array, "N nv r"]:
    """Derivative of each least-squares estimate by the torque of each joint at each sample, shape ``(N, nv, r)``.

    Args:
        rows: Regressor of the unknowns.
        factor: Triangular factor of the weighted rows.
        weights: One over the noise of each joint.
    """
    flat = (rows * weights[:, None] ** 2).reshape(-1, rows.shape[2]).T
    return solve_triangular(factor, solve_triangular(factor, flat, trans=1)).T.reshape(rows.shape)
