"""States of friction laws with memory along a recorded path: bristles that bend and elements that slip."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from phantom_dyn.array_types import Array, Float


def bristle(x: Float[Array, " N"], reach: float) -> Float[Array, " N"]:
    """State of a bristle between -1 and 1: ``dz/dx = (1 - z sign(dx)) / reach``, from rest at the start.

    Args:
        x: Positions [rad or m].
        reach: Displacement over which the bristle bends, in the unit of ``x``.
    """
    return _along(x, lambda start, direction, moved: direction + (start - direction) * np.exp(-moved / reach))


def slip(x: Float[Array, " N"], reach: float) -> Float[Array, " N"]:
    """State of an elastic element that slides at -1 and 1, from rest at the start.

    Args:
        x: Positions [rad or m].
        reach: Displacement from rest at which the element begins to slide, in the unit of ``x``.
    """
    return _along(x, lambda start, direction, moved: np.clip(start + direction * moved / reach, -1.0, 1.0))


def _along(x: Float[Array, " N"], law: Callable[[float, float, Array], Array]) -> Float[Array, " N"]:
    """A state along a path, piece by piece between its reversals.

    Args:
        x: Positions [rad or m].
        law: Gives the states within a piece from the state at its start, its direction, and the distances from there.
    """
    direction = np.sign(np.diff(x, prepend=x[:1]))
    turns = np.flatnonzero(direction[1:] != direction[:-1]) + 1
    edges = [0, *turns.tolist(), len(x)]
    out, z, at = np.zeros(len(x)), 0.0, x[0]
    for begin, end in pairwise(edges):
        if direction[begin] == 0.0:
            out[begin:end] = z
        else:
            out[begin:end] = law(z, direction[begin], np.abs(x[begin:end] - at))
        z, at = out[end - 1], x[end - 1]
    return out
