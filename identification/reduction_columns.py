"""Which columns of a triangular factor the others make up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

Array = np.ndarray


def dependent_columns(
    factor: Float[Array, "k p"], units: Sequence[str], tolerance: float
) -> tuple[Int[Array, " r"], Int[Array, " d"], Float[Array, "r d"], Float[Array, " p"]]:
    """Independent and dependent columns, the grouping, and the scale of each column.

    Columns are taken in their order, and one is kept if it adds more than ``tolerance`` of its scale to those before.

    Args:
        factor: Triangular factor of a regressor, or the regressor itself.
        units: Of the columns.
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
        for _ in range(2):  # once more, so that rounding does not leave a part along the basis
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
