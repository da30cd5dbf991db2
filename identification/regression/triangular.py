"""Triangular (QR) factors, updated with blocks of rows, and the columns of a factor that depend on the others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from threadpoolctl import ThreadpoolController

from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.errors import ParameterError

ROWS = 1024
"""Number of rows that are added at once: with 70 columns they take 0.6 MB, which fits into the second cache."""

_PANEL = 8  # columns that are eliminated together before the others follow as one product of matrices


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """One thread in the linear algebra: sums come in one order, and at 50 columns threads cost more than they save."""
    # SciPy has a linear algebra library of its own. Its threads are limited only if it is loaded before.
    import scipy.linalg  # noqa: F401

    with ThreadpoolController().limit(limits=1, user_api="blas"):
        yield


def absorb(factor: Float[Array, "p p"], rows: Float[Array, "m p"]) -> None:
    """Replace an upper triangular ``R`` by that of ``R`` on top of more rows, in place.

    Householder reflections on the rows (LAPACK's ``tpqrt``), so that the condition number is not squared as in a Gram
    matrix. Diagonal entries may be negative.

    Args:
        factor: Fortran order; zeros at the start. Receives the result.
        rows: Fortran order; overwritten.
    """
    from scipy.linalg import get_lapack_funcs

    if not rows.size:
        return
    (tpqrt,) = get_lapack_funcs(("tpqrt",), (factor,))
    tpqrt(0, min(_PANEL, len(factor)), factor, rows, overwrite_a=1, overwrite_b=1)


def triangular(rows: Float[Array, "m p"]) -> Float[Array, "p p"]:
    """Upper triangular ``R`` with ``R^T R = W^T W`` for rows ``W``, ``(p, p)`` also where there are fewer rows.

    Args:
        rows: Rows ``W``; they are not changed.
    """
    factor = np.zeros((rows.shape[1], rows.shape[1]), order="F")
    for start in range(0, len(rows), ROWS):
        absorb(factor, np.array(rows[start : start + ROWS], dtype=float, order="F"))
    return factor


def r_factor(blocks: Iterable[Float[Array, "... p"]]) -> Float[Array, "k p"]:
    """Triangular factor ``R`` with ``R^T R = W^T W`` of a regressor that comes in blocks, which are not kept.

    Args:
        blocks: Each ``(n, nv, p)`` or rows, ``(m, p)``.

    Returns:
        Shape ``(min(rows, p), p)``.

    Raises:
        ParameterError: If there is no block.
    """
    factor: Array | None = None
    first: list[Array] = []  # rows so far; while these are fewer than the columns, the factor has as few rows
    for block in blocks:
        rows = np.asarray(block).reshape(-1, block.shape[-1])
        if factor is None:
            first.append(rows)
            if sum(map(len, first)) < rows.shape[1]:
                continue
            rows = np.concatenate(first)
            factor = np.zeros((rows.shape[1], rows.shape[1]), order="F")
        for start in range(0, len(rows), ROWS):
            absorb(factor, np.array(rows[start : start + ROWS], dtype=float, order="F"))
    if factor is not None:
        return factor
    if not first:
        raise ParameterError("No block of the regressor was given: give at least one.")
    few = np.concatenate(first)
    return np.asarray(np.linalg.qr(few, mode="r")) if few.size else few


def dependent_columns(
    factor: Float[Array, "k p"], units: Sequence[str], tolerance: float
) -> tuple[Int[Array, " r"], Int[Array, " d"], Float[Array, "r d"], Float[Array, " p"]]:
    """Independent and dependent columns, the grouping, and the scale of each column.

    Columns are tested in their order. One is kept if its part outside the span of the kept columns is larger than
    ``tolerance`` times its scale.

    Args:
        factor: Triangular factor of a regressor, or the regressor itself.
        units: Units of the columns.
        tolerance: Share of the scale.

    Returns:
        Kept columns, ascending; the others; ``grouping`` with ``W[:, others] == W[:, kept] @ grouping``; and the norm
        of the largest column of the same unit (1 where all are zero), of each column.
    """
    p = factor.shape[1]
    norms = np.linalg.norm(factor, axis=0)
    scale = np.array([max(norms[k] for k in range(p) if units[k] == unit) for unit in units])
    basis = np.empty((len(factor), min(factor.shape)), order="F")
    kept: list[int] = []
    for k in range(p):
        if len(kept) == basis.shape[1]:
            break
        rest, so_far = factor[:, k], basis[:, : len(kept)]
        for _ in range(2):  # twice, as after one pass rounding errors leave a part along the basis
            rest = rest - so_far @ (so_far.T @ rest)
        size = np.linalg.norm(rest)
        if size > tolerance * scale[k]:
            basis[:, len(kept)] = rest / size
            kept.append(k)
    independent = np.array(kept, dtype=int)
    dependent = np.setdiff1d(np.arange(p), independent)
    # Coordinates in the orthonormal basis of the kept columns; those of the kept columns are triangular.
    coordinates = basis[:, : len(kept)].T @ factor
    grouping = np.linalg.solve(coordinates[:, independent], coordinates[:, dependent])
    return independent, dependent, grouping, np.where(scale > 0, scale, 1.0)
