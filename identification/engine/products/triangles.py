"""Symmetric matrices stored as their lower triangles, row by row, to halve the memory."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float, Int


def place(i: Int[Array, "..."], j: Int[Array, "..."]) -> Int[Array, "..."]:
    """Positions of the entries ``(i, j)`` in a stored triangle; the order of ``i`` and ``j`` does not matter."""
    line = np.maximum(i, j)
    return line * (line + 1) // 2 + np.minimum(i, j)


def places_in(width: int, size: int) -> Int[Array, " n"]:
    """Positions of a lower triangle of ``size`` rows in a flattened square matrix of ``width`` rows."""
    lines, columns = np.tril_indices(size)
    return lines * width + columns


def triangle(square: Float[Array, "... k k"], places: Int[Array, " n"]) -> Float[Array, "... n"]:
    """The lower triangle of a symmetric matrix.

    Args:
        square: Symmetric matrices.
        places: Result of `places_in`.
    """
    return square.reshape(*square.shape[:-2], -1).take(places, axis=-1)


def square(triangle: Float[Array, "... n"], chosen: Int[Array, " m"] | None = None) -> Float[Array, "... m m"]:
    """The full matrix of a stored triangle, or only the ``chosen`` rows and columns of it."""
    if chosen is None:
        chosen = np.arange(int(np.sqrt(2 * triangle.shape[-1])))
    return triangle.take(place(chosen[:, None], chosen), axis=-1)


def diagonal(triangle: Float[Array, "... n"], chosen: Int[Array, " m"]) -> Float[Array, "... m"]:
    """Chosen diagonal entries of a stored triangle."""
    return triangle.take(place(chosen, chosen), axis=-1)
