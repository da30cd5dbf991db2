"""Mobility of a machine, and the impulses of dry friction on it, inside compiled steps."""

from __future__ import annotations

import numpy as np

from phantom_dyn.kernels.jit import jit

Array = np.ndarray

# Sweeps of the friction solver; it stops when no impulse moves by more than 1e-10 of its limit.
_SWEEPS = 200
_STILL = 1e-10


@jit
def invert(matrix: Array) -> None:
    """Overwrite a symmetric positive definite matrix by its inverse: Gauss and Jordan, symmetric, no pivots."""
    n = len(matrix)
    for k in range(n):
        share = 1.0 / matrix[k, k]
        for i in range(n):
            if i != k:
                # The column is needed as it was: it is scaled behind the loop.
                scaled = matrix[i, k] * share
                for j in range(n):
                    if j != k:
                        matrix[i, j] -= scaled * matrix[k, j]
        for i in range(n):
            if i != k:
                matrix[i, k] *= -share
                matrix[k, i] *= share
        matrix[k, k] = share


@jit
def rub(mobility: Array, speed: Array, drives: Array, friction: Array, most: Array, h: float) -> None:
    """Coulomb friction of at most ``most`` on each drive: it stops its motor if it can, else opposes it.

    Args:
        mobility: Speed per impulse, ``(n, n)``.
        speed: Without friction, ``(n,)``; with it afterwards.
        drives: Place of each joint's motor, ``(nv,)``.
        friction: Torque that it had in the step before, where the search begins; that of this one afterwards.
        most: Limits of the torque, ``(nv,)``; none where it is zero.
        h: Length of the step [s].
    """
    n = len(speed)
    for j in range(len(drives)):
        if most[j] > 0.0:
            impulse = h * friction[j]
            for i in range(n):
                speed[i] += mobility[i, drives[j]] * impulse
    for _ in range(_SWEEPS):
        largest = 0.0
        for j in range(len(drives)):
            if most[j] > 0.0:
                at = drives[j]
                wanted = min(max(friction[j] - speed[at] / (mobility[at, at] * h), -most[j]), most[j])
                change = wanted - friction[j]
                if change != 0.0:
                    for i in range(n):
                        speed[i] += mobility[i, at] * (change * h)
                    friction[j] = wanted
                    largest = max(largest, abs(change) / most[j])
        if largest <= _STILL:
            break
    for j in range(len(drives)):
        if abs(friction[j]) < most[j]:
            speed[drives[j]] = 0.0
