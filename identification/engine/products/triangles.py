"""Symmetric matrices kept as their lower triangles, line by line: half the memory."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float, Int


def place(i: Int[Array, "..."], j: Int[Array, "..."]) -> Int[Array, "..."]:
    """Where the entries ``(i, j)``, which are those at ``(j, i)`` too, stand in a triangle."""
    line = np.maximum(i, j)
    return line * (line + 1) // 2 + np.minimum(i, j)


def places_in(width: int, size: int) -> Int[Array, " n"]:
    """Where the triangle of the first ``size`` lines stands in a square of ``width`` lines, written line after line."""
    lines, columns = np.tril_indices(size)
    return lines * width + columns


def triangle(square: Float[Array, "... k k"], places: Int[Array, " n"]) -> Float[Array, "... n"]:
    """The lower triangle of a symmetric matrix, by the places of its entries (see `places_in`)."""
    return square.reshape(*square.shape[:-2], -1).take(places, axis=-1)


def square(triangle: Float[Array, "... n"], chosen: Int[Array, " m"] | None = None) -> Float[Array, "... m m"]:
    """A triangle written out, or some of its lines and columns."""
    if chosen is None:
        chosen = np.arange(int(np.sqrt(2 * triangle.shape[-1])))
    return triangle.take(place(chosen[:, None], chosen), axis=-1)


def diagonal(triangle: Float[Array, "... n"], chosen: Int[Array, " m"]) -> Float[Array, "... m"]:
    """Some entries of the diagonal."""
    return triangle.take(place(chosen, chosen), axis=-1)
