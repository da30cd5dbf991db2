"""Vectors of three as scalars, for compiled loops: every function here disappears into its caller."""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import inlined

Array = np.ndarray
Vector = tuple[float, float, float]


@inlined
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Vector:
    """Cross product of a and b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def dot(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Scalar product of a and b."""
    return ax * bx + ay * by + az * bz


@inlined
def turned(R: Array, i: int, x: float, y: float, z: float) -> Vector:
    """``R[i]`` times a vector."""
    return (
        R[i, 0, 0] * x + R[i, 0, 1] * y + R[i, 0, 2] * z,
        R[i, 1, 0] * x + R[i, 1, 1] * y + R[i, 1, 2] * z,
        R[i, 2, 0] * x + R[i, 2, 1] * y + R[i, 2, 2] * z,
    )


@inlined
def turned_back(R: Array, i: int, x: float, y: float, z: float) -> Vector:
    """``R[i]`` transposed times a vector."""
    return (
        R[i, 0, 0] * x + R[i, 1, 0] * y + R[i, 2, 0] * z,
        R[i, 0, 1] * x + R[i, 1, 1] * y + R[i, 2, 1] * z,
        R[i, 0, 2] * x + R[i, 1, 2] * y + R[i, 2, 2] * z,
    )
