"""Gaussian elimination of a positive definite matrix in compiled loops, for minimisations that call it many times."""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import inlined

Array = np.ndarray

# Number of rows that are eliminated at a time.
_PANEL = 4


@inlined
def eliminate(u: Array, count: int | np.int64) -> None:
    """Overwrite the upper triangle of a matrix with the ``U`` of its factorisation ``U^T D^-1 U``.

    ``D`` is the diagonal of ``U``. No rows are exchanged: a positive definite matrix does not need it.

    Args:
        u: A matrix whose first ``count`` rows and columns are positive definite; overwritten.
        count: Number of rows and columns to factorise.
    """
    for first in range(0, count, _PANEL):
        last = min(first + _PANEL, count)
        for j in range(first, last):
            for i in range(j + 1, last):
                share = u[j, i] / u[j, j]
                for k in range(i, count):
                    u[i, k] -= share * u[j, k]
        if last - first < _PANEL:
            break
        # Four rows are eliminated together, so that each row below is read and written once for all of them.
        j, m, n, o = first, first + 1, first + 2, first + 3
        for i in range(last, count):
            p, q, r, s = u[j, i] / u[j, j], u[m, i] / u[m, m], u[n, i] / u[n, n], u[o, i] / u[o, o]
            # Products of joints on different limbs are zero.
            if p == 0.0 and q == 0.0 and r == 0.0 and s == 0.0:
                continue
            for k in range(i, count):
                u[i, k] -= p * u[j, k] + q * u[m, k] + r * u[n, k] + s * u[o, k]


@inlined
def solve_eliminated(u: Array, right: Array, count: int | np.int64) -> None:
    """Overwrite the first ``count`` entries of a right side with the solution; ``u`` is the result of `eliminate`."""
    for j in range(count):
        share = right[j] / u[j, j]
        for k in range(j + 1, count):
            right[k] -= share * u[j, k]
    for j in range(count - 1, -1, -1):
        rest = right[j]
        for k in range(j + 1, count):
            rest -= u[j, k] * right[k]
        right[j] = rest / u[j, j]
