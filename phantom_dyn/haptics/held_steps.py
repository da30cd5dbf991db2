"""Loops over the samples of a device behind hold and delay, compiled; unannotated, as numba takes what arrives."""

import numpy as np

from phantom_dyn.kernels.jit import jit


@jit
def _read(C, x):
    """Position in a state."""
    y = 0.0
    for i in range(len(x)):
        y += C[i] * x[i]
    return y


@jit
def _advance(transition, newer, older, steps, given, k, x, following):
    """Write the state after sample ``k`` into ``following``; before the first sample no force was given."""
    new = given[k - steps] if k >= steps else 0.0
    old = given[k - steps - 1] if k > steps else 0.0
    for i in range(len(x)):
        following[i] = newer[i] * new + older[i] * old
        for j in range(len(x)):
            following[i] += transition[i, j] * x[j]


@jit
def relay_loop(transition, newer, older, C, steps, state, force, count):
    """Forces of a relay that are given, and positions that are read, from a state at rest."""
    given = np.zeros(count)
    position = np.zeros(count)
    x = state.copy()
    following = np.zeros(len(state))
    for k in range(count):
        position[k] = _read(C, x)
        given[k] = force if position[k] < 0.0 else -force
        _advance(transition, newer, older, steps, given, k, x, following)
        x, following = following, x
    return given, position


@jit
def held_forces(transition, newer, older, C, steps, state, forces):
    """Positions that are read while the forces are given one after the other, held and delayed."""
    position = np.zeros(len(forces))
    x = state.copy()
    following = np.zeros(len(state))
    for k in range(len(forces)):
        position[k] = _read(C, x)
        _advance(transition, newer, older, steps, forces, k, x, following)
        x, following = following, x
    return position
