"""Spans of columns: an orthonormal basis, and the part of other columns that is orthogonal to it."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float


def orthonormal(matrix: Float[Array, "m k"], tolerance: float) -> Float[Array, "m r"]:
    """Orthonormal basis of the span of columns, which are first scaled to unit norm.

    Args:
        matrix: Matrix of the columns.
        tolerance: Directions with a singular value below this share of the largest one are left out.
    """
    norms = np.linalg.norm(matrix, axis=0)
    kept = matrix[:, norms > 0] / norms[norms > 0]
    if not kept.size:
        return np.zeros((len(matrix), 0))
    u, s, _ = np.linalg.svd(kept, full_matrices=False)
    return u[:, s > tolerance * s[0]]


def orthogonal_part(matrix: Array, basis: Float[Array, "m r"]) -> Array:
    """The part of columns that is orthogonal to the span of a basis; projecting twice removes rounding errors."""
    for _ in range(2):
        matrix = matrix - basis @ (basis.T @ matrix)
    return matrix
