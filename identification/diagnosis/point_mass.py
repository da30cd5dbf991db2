"""A point mass as inertial parameters, linearised about an estimate."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

Array = np.ndarray


def point_mass_map(start: Float[Array, " 4"]) -> tuple[Float[Array, "10 4"], Float[Array, " 10"]]:
    """Ten inertial parameters of a point mass from mass and first moments ``(m, h)``, linearised: ``J x + c``.

    The inertia is ``(h.h 1 - h h^T) / m``. Without a positive mass at the start it is left out.
    """
    jacobian = np.zeros((10, 4))
    jacobian[:4] = np.eye(4)
    offset = np.zeros(10)
    m, h = start[0], start[1:]
    if m <= 1e-9:
        return jacobian, offset
    entries = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
    for k, (i, j) in enumerate(entries):
        value = ((h @ h) * (i == j) - h[i] * h[j]) / m
        slope = np.zeros(4)
        slope[0] = -value / m
        for axis in range(3):
            slope[1 + axis] = (2 * h[axis] * (i == j) - (axis == i) * h[j] - h[i] * (axis == j)) / m
        jacobian[4 + k] = slope
        offset[4 + k] = value - slope @ start
    return jacobian, offset
