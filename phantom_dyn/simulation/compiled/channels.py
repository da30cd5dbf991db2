"""Channels of a machine at one instant, inside compiled steps: what its encoders read and what is asked of a drive."""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.compiled_laws import reading_of

Array = np.ndarray


@jit
def read(codes: Array, rows: Array, numbers: Array, j: int, q: float) -> float:
    """Reading of encoder ``j`` at position ``q``."""
    for k in range(len(codes)):
        if rows[k] == j:
            q = reading_of(codes[k], numbers[k, 0], numbers[k, 1], numbers[k, 2], q)
    return q


@jit
def place_in(times: Array, cursor: Array, t: float) -> float:
    """Share of the way from the table's row ``cursor[0]`` to the next at time ``t``; the ends hold beyond it."""
    k = cursor[0]
    while k + 2 < len(times) and t >= times[k + 1]:
        k += 1
    while k > 0 and t < times[k]:
        k -= 1
    cursor[0] = k
    return min(max(float((t - times[k]) / (times[k + 1] - times[k])), 0.0), 1.0)


@jit
def tracking(tables: Array, limit: float, k: int, share: float, j: int, q: float, v: float) -> float:
    """Torque that a tracking law asks of drive ``j``, see `phantom_dyn.simulation.control`."""
    a, b = tables[k, j], tables[k + 1, j]
    rest = 1.0 - share
    forward, wanted, speed = rest * a[0] + share * b[0], rest * a[1] + share * b[1], rest * a[2] + share * b[2]
    kp, kd, added = rest * a[3] + share * b[3], rest * a[4] + share * b[4], rest * a[5] + share * b[5]
    asked = forward + kp * (wanted - q) + kd * (speed - v)
    return min(max(asked, -limit), limit) + added
