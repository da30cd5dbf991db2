"""One sample of each velocity estimator, compiled: the same steps serve recordings and closed loops."""

from __future__ import annotations

import math

import numpy as np

from phantom_dyn._kernels.jit import jit

AVERAGED_DIFFERENCE, ADAPTIVE_WINDOW, KALMAN, PERIOD_MEASUREMENT = 0, 1, 2, 3
READINGS_KEPT = 512
EDGES_KEPT = 1024


@jit
def next_velocity(kind, parameters, k, period, readings, memory, edge_time, edge_direction, edges):
    """Velocity estimate at sample k.

    `readings` is a ring of `READINGS_KEPT` positions with that of sample k written at k modulo its length; `memory` is
    the estimator's own, of the same length plus two, zero at the start and written here; the edge rings hold the
    `edges` edges counted so far.
    """
    if kind == 0:
        return averaged_difference(int(parameters[0]), k, period, readings)
    if kind == 1:
        return adaptive_window(int(parameters[0]), parameters[1], k, period, readings)
    if kind == 2:
        return kalman(parameters[0], parameters[1], k, period, readings, memory)
    raw = period_velocity(parameters, k, period, edge_time, edge_direction, edges)
    return moving_average(raw, int(parameters[4]), k, memory)


@jit
def averaged_difference(samples, k, period, readings):
    """(x[k] - x[k - n]) / (n T); before n samples have passed, over those there are."""
    n = min(samples, k)
    if n == 0:
        return 0.0
    return (readings[k % readings.size] - readings[(k - n) % readings.size]) / (n * period)


@jit
def adaptive_window(longest, bound, k, period, readings):
    """Slope over the longest window whose chord stays within `bound` of every reading in it."""
    size = readings.size
    last = readings[k % size]
    slope = 0.0
    for n in range(1, min(longest, k) + 1):
        candidate = (last - readings[(k - n) % size]) / n
        for i in range(1, n):
            if abs(last - i * candidate - readings[(k - i) % size]) > bound:
                return slope / period
        slope = candidate
    return slope / period


@jit
def kalman(position_gain, velocity_gain, k, period, readings, memory):
    """Predict with constant velocity, correct with the stationary gains; the state lives in the last two of memory."""
    reading = readings[k % readings.size]
    if k == 0:
        memory[-2] = reading
        memory[-1] = 0.0
        return 0.0
    predicted = memory[-2] + period * memory[-1]
    innovation = reading - predicted
    memory[-2] = predicted + position_gain * innovation
    memory[-1] = memory[-1] + velocity_gain * innovation
    return memory[-1]


@jit
def period_velocity(parameters, k, period, edge_time, edge_direction, edges):
    """Steps over the clock ticks that the last edges took; parameters: step, clock, counter size, edges, _, wraps."""
    step, clock, counter = parameters[0], parameters[1], parameters[2]
    wanted, wraps = int(parameters[3]), parameters[5] > 0.5
    size = edge_time.size
    if edges < 2:
        return 0.0
    direction = edge_direction[(edges - 1) % size]
    ticks, used = 0.0, 0
    while used < wanted and edges - used >= 2 and used < size - 2:
        new, old = (edges - 1 - used) % size, (edges - 2 - used) % size
        if edge_direction[old] != direction:  # the same edge passed twice: no step lies between
            break
        ticks += period_ticks(edge_time[old], edge_time[new], clock, counter, wraps, period)
        used += 1
    if used == 0 or ticks == 0.0:
        return 0.0
    speed = used * step * clock / ticks
    if not wraps:
        # No edge since: the speed is below one step over the time that the controller has waited.
        waited = (k - math.ceil(edge_time[(edges - 1) % size] / period)) * period
        if waited * speed > step:
            speed = step / waited
    return direction * speed


@jit
def period_ticks(start, end, clock, counter, wraps, period):
    """Ticks between two edges as the counter gives them; past its end it wraps, or the controller's samples count."""
    ticks = np.floor(end * clock) - np.floor(start * clock)
    if ticks < counter:
        return max(ticks, 1.0)
    if wraps:
        return max(ticks % counter, 1.0)
    return max((np.floor(end / period) - np.floor(start / period)) * period * clock, counter)


@jit
def moving_average(value, samples, k, memory):
    """Mean of the last n values; memory keeps them in a ring of its length less two."""
    size = memory.size - 2
    memory[k % size] = value
    n = min(samples, k + 1)
    total = 0.0
    for i in range(n):
        total += memory[(k - i) % size]
    return total / n


@jit
def velocities_of_record(kind, parameters, period, readings, edge_time, edge_direction, ring, memory, velocities):
    """Fill `velocities` from readings and edges in time; `ring` and `memory` as in `next_velocity`, zero at first."""
    edges = 0
    for k in range(readings.size):
        while edges < edge_time.size and edge_time[edges] <= k * period:
            edges += 1
        ring[k % ring.size] = readings[k]
        velocities[k] = next_velocity(kind, parameters, k, period, ring, memory, edge_time, edge_direction, edges)
