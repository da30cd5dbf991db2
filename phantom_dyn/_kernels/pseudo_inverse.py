"""Compiled pseudo-inverse by one-sided Jacobi rotations (Hestenes, 1958), for matrices of a few rows and columns."""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn.array_types import Array

# Largest number of sweeps of Jacobi rotations; about five are usual.
_SWEEPS = 40
# Cosine of the angle between two columns below which they count as orthogonal; about the size of rounding errors.
_ORTHOGONAL = 1e-15


@fused
def pseudo_inverse(matrix: Array, singular: float, inverse: Array) -> bool:
    """Write the pseudo-inverse of a matrix with no more columns than rows, by one-sided Jacobi rotations.

    Args:
        matrix: The matrix, ``(m, n)``.
        singular: Ratio of smallest to largest singular value below which the matrix counts as singular.
        inverse: Output: the pseudo-inverse, ``(n, m)``.

    Returns:
        False if the matrix is singular or has more columns than rows.
    """
    m, n = matrix.shape
    if m < n:
        return False
    U, V, squares = matrix.copy(), np.eye(n), np.zeros(n)
    for _ in range(_SWEEPS):
        turned_any = False
        for i in range(n):
            for j in range(i + 1, n):
                if made_orthogonal(U, V, i, j):
                    turned_any = True
        if not turned_any:
            break
    for i in range(n):
        for r in range(m):
            squares[i] += U[r, i] * U[r, i]
    # The negated comparison is true for NaN, too, so that a matrix with NaN counts as singular.
    if not np.sqrt(squares.min()) > singular * np.sqrt(squares.max()):
        return False
    for i in range(n):
        for r in range(m):
            inverse[i, r] = 0.0
            for k in range(n):
                inverse[i, r] += V[i, k] * U[r, k] / squares[k]
    return True


@inlined
def made_orthogonal(U: Array, V: Array, i: int, j: int) -> bool:
    """Rotate columns ``i`` and ``j`` of ``U`` and ``V`` so that those of ``U`` become orthogonal.

    Returns:
        False if they were orthogonal before, so that nothing was changed.
    """
    a = b = both = 0.0
    for r in range(len(U)):
        a, b, both = a + U[r, i] * U[r, i], b + U[r, j] * U[r, j], both + U[r, i] * U[r, j]
    if not abs(both) > _ORTHOGONAL * np.sqrt(a * b):
        return False
    zeta = (b - a) / (2 * both)
    t = (1.0 if zeta >= 0 else -1.0) / (abs(zeta) + np.sqrt(1 + zeta * zeta))
    c = 1 / np.sqrt(1 + t * t)
    s = c * t
    for r in range(len(U)):
        U[r, i], U[r, j] = c * U[r, i] - s * U[r, j], s * U[r, i] + c * U[r, j]
    for r in range(len(V)):
        V[r, i], V[r, j] = c * V[r, i] - s * V[r, j], s * V[r, i] + c * V[r, j]
    return True
