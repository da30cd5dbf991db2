"""Links of a closed chain whose passive joints are linear in the active ones, inside compiled steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn.kernels.jit import jit
from phantom_dyn.kernels.simulation_links import links

Array = np.ndarray


class Chain(NamedTuple):
    """How the tree follows the active joints; of a plain robot all arrays are empty.

    Attributes:
        slope: ``G``, shape ``(nt, nv)``.
        offset: Positions of the tree where the active joints are at zero, ``(nt,)``.
        viscous: Coefficients of the passive joints, zero at active ones, ``(nt,)``.
        coulomb: Torques of the passive joints, the same.
        q: Room for positions of the tree, ``(nt,)``.
        v: Room for its velocities.
        mass: Room for its mass matrix, ``(nt, nt)``.
        bias: Room for its torque.
    """

    slope: Array
    offset: Array
    viscous: Array
    coulomb: Array
    q: Array
    v: Array
    mass: Array
    bias: Array


def chain_of(slope: Array, offset: Array, viscous: Array, coulomb: Array) -> Chain:
    """The chain with its room; arguments as the attributes."""
    count = len(offset)
    given = (np.array(part, dtype=float) for part in (slope, offset, viscous, coulomb))
    return Chain._make((*given, *np.zeros((2, count)), np.zeros((count, count)), np.zeros(count)))


@jit
def chained_links(
    numbers: Array, places: Array, moving: Array, slope: Array, offset: Array, viscous: Array, coulomb: Array,
    x: Array, u: Array, heavy: Array, weight: Array, q: Array, v: Array, mass: Array, bias: Array,
) -> None:  # fmt: skip
    """As `simulation_links.links`, for the active joints; friction of the passive ones is part of ``bias``.

    Args:
        numbers: As of `simulation_links.links`, with the next two.
        places: .
        moving: .
        slope: As in `Chain`, with the next three.
        offset: .
        viscous: .
        coulomb: .
        x: Room of the chain, with the next three.
        u: .
        heavy: .
        weight: .
        q: Positions of the active joints first.
        v: Their velocities.
        mass: Receives the mass matrix in its first rows and columns.
        bias: Receives the torque.
    """
    nt, nv = slope.shape
    for i in range(nt):
        x[i], u[i] = offset[i], 0.0
        for j in range(nv):
            x[i] += slope[i, j] * q[j]
            u[i] += slope[i, j] * v[j]
        for k in range(nt):
            heavy[i, k] = 0.0
    links(numbers, places, moving, x, u, heavy, weight)
    for j in range(nv):
        bias[j] = 0.0
        for i in range(nv):
            mass[i, j] = 0.0
    for i in range(nt):
        weight[i] += viscous[i] * u[i] + coulomb[i] * np.sign(u[i])
        for j in range(nv):
            bias[j] += slope[i, j] * weight[i]
            carried = 0.0
            for k in range(nt):
                carried += heavy[i, k] * slope[k, j]
            for k in range(nv):
                mass[k, j] += slope[i, k] * carried
