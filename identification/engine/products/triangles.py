"""Symmetric matrices stored as their lower triangles, row by row: half the memory."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float, Int


def place(i: Int[Array, "..."], j: Int[Array, "..."]) -> Int[Array, "..."]:
    """Places of the entries ``(i, j)``, or ``(j, i)``, in a triangle."""
    line = np.maximum(i, j)
    return line * (line + 1) // 2 + np.minimum(i, j)


def places_in(width: int, size: int) -> Int[Array, " n"]:
    """Places of the triangle of the first ``size`` rows in a square of ``width`` rows that is stored row by row."""
    lines, columns = np.tril_indices(size)
    return lines * width + columns


def triangle(square: Float[Array, "... k k"], places: Int[Array, " n"]) -> Float[Array, "... n"]:
    """The lower triangle of a symmetric matrix, by the places of its entries (see `places_in`)."""
    return square.reshape(*square.shape[:-2], -1).take(places, axis=-1)


def square(triangle: Float[Array, "... n"], chosen: Int[Array, " m"] | None = None) -> Float[Array, "... m m"]:
    """The full matrix of a triangle, or some of its rows and columns."""
    if chosen is None:
        chosen = np.arange(int(np.sqrt(2 * triangle.shape[-1])))
    return triangle.take(place(chosen[:, None], chosen), axis=-1)


def diagonal(triangle: Float[Array, "... n"], chosen: Int[Array, " m"]) -> Float[Array, "... m"]:
    """Chosen entries of the diagonal."""
    return triangle.take(place(chosen, chosen), axis=-1)
