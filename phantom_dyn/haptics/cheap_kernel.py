"""One cycle a sample of a cheap axis, compiled; `phantom_dyn.haptics.cheap_hardware` says what it computes."""

from __future__ import annotations

import numpy as np

from phantom_dyn.effects.cogging import cogging_torque
from phantom_dyn.effects.presliding_friction import stick_law
from phantom_dyn.effects.torque_saturation import held_within
from phantom_dyn.haptics.cheap_axis import CheapAxis
from phantom_dyn.haptics.gap_switch import GAP_DAMPING, coupling_force, side_of
from phantom_dyn.haptics.virtual_mass import WINDOW, low_passed, mass_step
from phantom_dyn.kernels.jit import jit

Array = np.ndarray

_clipped, _cogging = jit(held_within), jit(cogging_torque)
# Places in the state of an axis; the last forces of the coupling are behind them.
LAST, RAW, SPEED, MASS_X, MASS_V, STUCK, ANCHOR, COUNT = range(8)
FORCES = 8
# Columns of what is rendered.
FORCE, COUPLING, SIDE, X, V, PROBE_SPEED, STICKS = range(7)
COLUMNS = 7


def axis_numbers(axis: CheapAxis) -> tuple[Array, Array, Array, Array]:
    """An axis as arrays for the compiled loop: ten numbers, and the waves of its cogging."""
    mass, friction, waves = axis.mass, axis.friction, axis.cogging
    numbers = [0.0] * 3 if mass is None else [mass.inertia, mass.stiffness, mass.damping]
    numbers += [axis.gap, axis.limit]
    if friction is None:
        numbers += [0.0] * 4
    else:
        numbers += [friction.torque, friction.displacement, friction.static_ratio, friction.stick_velocity]
    numbers.append(axis.cutoff_hz)
    table = ((), (), ()) if waves is None else (waves.order, waves.amplitude, waves.phase)
    orders, amplitudes, phases = (np.array(values, dtype=float) for values in table)
    return np.array(numbers, dtype=float), orders, amplitudes, phases


@jit
def along(
    numbers: Array,
    orders: Array,
    amplitudes: Array,
    phases: Array,
    state: Array,
    steps: Array,
    positions: Array,
    asked: Array,
    out: Array,
) -> None:
    """One cycle a sample; ``state`` moves on, ``out`` is filled."""
    mass, stiffness, damping, gap, limit = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    cutoff = numbers[9]
    slip, displacement, ratio, stick_velocity = numbers[5], numbers[6], numbers[7], numbers[8]
    for k in range(len(steps)):
        x, dt, last = positions[k], steps[k], state[LAST]
        if np.isnan(last):
            state[MASS_X] = x
        elif dt > 0.0:
            raw = (x - last) / dt
            state[SPEED] = raw if cutoff == np.inf else low_passed(state[SPEED], state[RAW], raw, dt, cutoff)
            state[RAW] = raw
        speed = state[SPEED]

        side, coupling = 1.0, 0.0
        if mass > 0.0:
            x_mass, v_mass = state[MASS_X], state[MASS_V]
            if not np.isnan(last):
                side = side_of(last - x_mass, gap)
                held, drag = (stiffness, damping) if side != 0.0 else (0.0, GAP_DAMPING * damping)
                middle = 0.5 * (last + x) - 0.5 * side * gap
                state[MASS_X], state[MASS_V] = mass_step(x_mass, v_mass, dt, mass, middle, held, drag, speed)
            apart = x - state[MASS_X]
            side = side_of(apart, gap)
            # A difference of positions is the velocity half a step ago, so the mass's is taken there too.
            rate = speed - 0.5 * (v_mass + state[MASS_V])
            coupling = coupling_force(apart, rate, side, gap, stiffness, damping)
        else:
            state[MASS_X], state[MASS_V] = x, speed
        state[FORCES + int(state[COUNT]) % WINDOW] = coupling
        state[COUNT] += 1.0

        friction = 0.0
        if slip > 0.0:
            state[STUCK], state[ANCHOR], friction = stick_law(
                last, state[STUCK], state[ANCHOR], x, speed, slip, displacement, ratio, stick_velocity
            )
        direct = _clipped(asked[k], limit) + friction
        if len(orders) > 0:
            direct += _cogging(x, orders, amplitudes, phases)
        if side == 0.0:
            direct = 0.0
        if mass > 0.0:
            direct += np.sum(state[FORCES:]) / WINDOW
        out[k, FORCE], out[k, COUPLING], out[k, SIDE] = direct, coupling, side
        out[k, X], out[k, V], out[k, PROBE_SPEED] = state[MASS_X], state[MASS_V], speed
        out[k, STICKS] = state[STUCK]
        state[LAST] = x
