"""Triangular (QR) factors of matrices that are given in blocks of rows, and the dependent columns of a factor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from threadpoolctl import ThreadpoolController

from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.errors import ParameterError

ROWS = 1024
"""Number of rows that are added at once: with 70 columns they need 0.6 MB, which fits into the level 2 cache."""

_PANEL = 8  # number of columns in a block of LAPACK's algorithm


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context with one thread for linear algebra, which fixes the order of sums and is faster for small matrices."""
    # SciPy has its own linear algebra library. Only libraries that are already loaded are limited.
    import scipy.linalg  # noqa: F401

    with ThreadpoolController().limit(limits=1, user_api="blas"):
        yield


def absorb(factor: Float[Array, "p p"], rows: Float[Array, "m p"]) -> None:
    """Replace an upper triangular ``R``, in place, by the factor of ``R`` with more rows below it.

    The method is Householder reflections (LAPACK's ``tpqrt``), which do not square the condition number as a Gram
    matrix does. Diagonal entries may be negative.

    Args:
        factor: ``R`` in Fortran order, which is overwritten with the result; zeros at first.
        rows: Rows in Fortran order, which are overwritten.
    """
    from scipy.linalg import get_lapack_funcs

    if not rows.size:
        return
    (tpqrt,) = get_lapack_funcs(("tpqrt",), (factor,))
    tpqrt(0, min(_PANEL, len(factor)), factor, rows, overwrite_a=1, overwrite_b=1)


def triangular(rows: Float[Array, "m p"]) -> Float[Array, "p p"]:
    """Upper triangular ``R`` with ``R^T R = W^T W`` for rows ``W``, ``(p, p)`` even with fewer rows.

    Args:
        rows: Rows ``W``; they are not changed.
    """
    factor = np.zeros((rows.shape[1], rows.shape[1]), order="F")
    _absorb_copies(factor, rows)
    return factor


def _absorb_copies(factor: Float[Array, "p p"], rows: Float[Array, "m p"]) -> None:
    """Do as `absorb`, for rows in any order and number, which are not changed."""
    for start in range(0, len(rows), ROWS):
        absorb(factor, np.array(rows[start : start + ROWS], dtype=float, order="F"))


def r_factor(blocks: Iterable[Float[Array, "... p"]]) -> Float[Array, "k p"]:
    """Triangular factor ``R`` with ``R^T R = W^T W`` of a regressor ``W`` that is given in blocks.

    Args:
        blocks: Blocks ``(n, nv, p)``, or rows ``(m, p)``.

    Returns:
        Shape ``(min(rows, p), p)``.

    Raises:
        ParameterError: If there is no block.
    """
    factor: Array | None = None
    first: list[Array] = []  # rows so far, while there are fewer rows than columns
    for block in blocks:
        rows = np.asarray(block).reshape(-1, block.shape[-1])
        if factor is None:
            first.append(rows)
            if sum(map(len, first)) < rows.shape[1]:
                continue
            rows = np.concatenate(first)
            factor = np.zeros((rows.shape[1], rows.shape[1]), order="F")
        _absorb_copies(factor, rows)
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

    Columns are tested in their order. A column is kept if its part outside the span of the columns kept before is
    larger than ``tolerance`` times its scale.

    Args:
        factor: Triangular factor of a regressor, or the regressor itself.
        units: Units of the columns.
        tolerance: Share of the scale.

    Returns:
        Kept columns, ascending; the other columns; ``grouping`` with ``W[:, others] == W[:, kept] @ grouping``; and
        the scale of each column, which is the norm of the largest column of the same unit (1 if all are zero).
    """
    p = factor.shape[1]
    norms = np.linalg.norm(factor, axis=0)
    scale = np.array([max(norms[k] for k in range(p) if units[k] == unit) for unit in units])
    basis = np.empty((len(factor), min(factor.shape)), order="F")
    kept: list[int] = []
    for k in range(p):
        if len(kept) == basis.shape[1]:
            break
        outside, so_far = factor[:, k], basis[:, : len(kept)]
        for _ in range(2):  # the second pass removes rounding errors along the basis
            outside = outside - so_far @ (so_far.T @ outside)
        size = np.linalg.norm(outside)
        if size > tolerance * scale[k]:
            basis[:, len(kept)] = outside / size
            kept.append(k)
    independent = np.array(kept, dtype=int)
    dependent = np.setdiff1d(np.arange(p), independent)
    # Coordinates of the columns in the orthonormal basis of the kept columns.
    coordinates = basis[:, : len(kept)].T @ factor
    grouping = np.linalg.solve(coordinates[:, independent], coordinates[:, dependent])
    return independent, dependent, grouping, np.where(scale > 0, scale, 1.0)
