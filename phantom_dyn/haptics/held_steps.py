"""Loops over the samples of a device behind hold and delay, compiled; unannotated, as numba takes what arrives."""

import numpy as np

from phantom_dyn.kernels.jit import jit


@jit
def relay_loop(transition, newer, older, C, steps, state, force, count):
    """Forces of a relay that are given, and positions that are read, from a state at rest; before it no force."""
    n = len(state)
    given = np.zeros(count)
    position = np.zeros(count)
    x = state.copy()
    following = np.zeros(n)
    for k in range(count):
        y = 0.0
        for i in range(n):
            y += C[i] * x[i]
        position[k] = y
        given[k] = force if y < 0.0 else -force
        new = given[k - steps] if k >= steps else 0.0
        old = given[k - steps - 1] if k > steps else 0.0
        for i in range(n):
            following[i] = newer[i] * new + older[i] * old
            for j in range(n):
                following[i] += transition[i, j] * x[j]
        x, following = following, x
    return given, position


@jit
def held_forces(transition, newer, older, C, steps, state, forces):
    """Positions that are read while the forces are given one after the other, held and delayed."""
    n = len(state)
    position = np.zeros(len(forces))
    x = state.copy()
    following = np.zeros(n)
    for k in range(len(forces)):
        for i in range(n):
            position[k] += C[i] * x[i]
        new = forces[k - steps] if k >= steps else 0.0
        old = forces[k - steps - 1] if k > steps else 0.0
        for i in range(n):
            following[i] = newer[i] * new + older[i] * old
            for j in range(n):
                following[i] += transition[i, j] * x[j]
        x, following = following, x
    return position
