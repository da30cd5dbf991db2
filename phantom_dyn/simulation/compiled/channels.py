"""Encoder readings, commanded torques and effect torques at one instant, for compiled steps.

The number of an effect's law is an identifier and not an index into a list, see `phantom_dyn.effects.compiled_laws`.
"""

from __future__ import annotations

from phantom_dyn._kernels.jit import inlined_jit
from phantom_dyn.array_types import Array
from phantom_dyn.effects.compiled_laws import DELAY, command_of, delay_law, reading_of, torque_of


@inlined_jit
def read(codes: Array, rows: Array, numbers: Array, j: int, q: float) -> float:
    """Reading of encoder ``j`` at position ``q``."""
    for k in range(len(codes)):
        if rows[k] == j:
            q = reading_of(codes[k], numbers[k, 0], numbers[k, 1], numbers[k, 2], q)
    return q


@inlined_jit
def place_in(times: Array, cursor: Array, t: float) -> float:
    """Set ``cursor[0]`` to the table row before ``t``; return the share of the interval to the next row at ``t``."""
    k = cursor[0]
    while k + 2 < len(times) and t >= times[k + 1]:
        k += 1
    while k > 0 and t < times[k]:
        k -= 1
    cursor[0] = k
    return min(max(float((t - times[k]) / (times[k + 1] - times[k])), 0.0), 1.0)


@inlined_jit
def tracking(tables: Array, limit: float, k: int, share: float, j: int, q: float, v: float) -> float:
    """Torque that a tracking law commands from drive ``j``, see `phantom_dyn.simulation.control`."""
    # Linear interpolation between rows k and n of each table.
    rest, n = 1.0 - share, k + 1
    forward = rest * tables[k, j, 0] + share * tables[n, j, 0]
    wanted, speed = rest * tables[k, j, 1] + share * tables[n, j, 1], rest * tables[k, j, 2] + share * tables[n, j, 2]
    kp, kd = rest * tables[k, j, 3] + share * tables[n, j, 3], rest * tables[k, j, 4] + share * tables[n, j, 4]
    added = rest * tables[k, j, 5] + share * tables[n, j, 5]
    commanded = forward + kp * (wanted - q) + kd * (speed - v)
    return min(max(commanded, -limit), limit) + added


@inlined_jit
def delivered_by_drive(
    codes: Array, numbers: Array, state: Array, rings: Array, ends: Array, i: int, h: float, commanded: float
) -> float:
    """Output of command law ``i`` for the input ``commanded`` during ``h`` seconds; updates the law's state.

    Args:
        codes: Code of each law, see `Laws`.
        numbers: Parameters of the laws, see `Laws`.
        state: State of the laws, see `Laws`; changed.
        rings: Delayed values, see `Lines`; changed.
        ends: Ends of each ring, see `Lines`; changed.
        i: Index of the law.
        h: Length of the step [s].
        commanded: Commanded torque before the law.
    """
    if codes[i] == DELAY:
        ends[i, 0], ends[i, 1], delivered = delay_law(rings[i], ends[i, 0], ends[i, 1], numbers[i, 0], h, commanded)
        return delivered
    state[i, 0], delivered = command_of(codes[i], numbers[i, 0], state[i, 0], h, commanded)
    return delivered


@inlined_jit
def effect_torque(codes: Array, numbers: Array, state: Array, i: int, q: float, v: float, load: float) -> float:
    """Torque of law ``i`` at a position, a velocity and a transmitted load; updates the law's state."""
    state[i, 0], state[i, 1], state[i, 2], torque = torque_of(
        codes[i], numbers[i, 0], numbers[i, 1], numbers[i, 2], numbers[i, 3],
        state[i, 0], state[i, 1], state[i, 2], q, v, load,
    )  # fmt: skip
    return torque
