"""One or two devices in a sampled loop, compiled: encoder edges between samples, velocity estimate, held forces."""

from __future__ import annotations

import numpy as np

from phantom_dyn.haptics.encoder_kernel import count_through
from phantom_dyn.haptics.velocity_kernel import EDGES_KEPT, READINGS_KEPT, next_velocity
from phantom_dyn.kernels.jit import jit

_FORCES_KEPT = 4096


@jit
def run_loop(
    transition, push, output, direct, x, hand, substeps, late, period, step, spacing, kind, parameters,
    gain, damping, one_sided, far, positions, readings, velocities, forces,
):  # fmt: skip
    """Fill the four traces, shape ``(N, d)``, of d devices; returns the samples done before one is beyond `far`.

    One device: ``u = -(gain x + damping v)``, if `one_sided` only where x > 0. Two: the same of the difference between
    a device and the other. `transition`, `push`: exact over a substep, shapes ``(d, n, n)`` and ``(d, n)``; `late`:
    substeps between a sample and its force; `hand`: force of the hand at each sample, shape ``(N, d)``; `x`: states,
    shape ``(d, n)``, overwritten.
    """
    samples, devices = positions.shape
    order = x.shape[1]
    dt = period / substeps
    rings = np.zeros((devices, READINGS_KEPT))
    memories = np.zeros((devices, READINGS_KEPT + 2))
    times, directions = np.full((devices, EDGES_KEPT), -1.0), np.zeros((devices, EDGES_KEPT))
    edges, counts = np.zeros(devices, np.int64), np.zeros(devices, np.int64)
    place, speed, following = np.zeros(devices), np.zeros(devices), np.zeros(order)
    commands = np.zeros((devices, _FORCES_KEPT))
    for i in range(devices):
        for j in range(order):
            place[i] += output[i, j] * x[i, j]
        counts[i] = int(np.floor(place[i] / step + 0.5))
    for k in range(samples):
        for i in range(devices):
            rings[i, k % READINGS_KEPT] = counts[i] * step
            speed[i] = next_velocity(
                kind, parameters, k, period, rings[i], memories[i], times[i], directions[i], edges[i]
            )
        for i in range(devices):
            error, rate = counts[i] * step, speed[i]
            if devices == 2:
                error, rate = error - counts[1 - i] * step, rate - speed[1 - i]
            u = -(gain * error + damping * rate)
            if one_sided and error <= 0.0:
                u = 0.0
            commands[i, k % _FORCES_KEPT] = u
            positions[k, i], readings[k, i] = place[i], counts[i] * step
            velocities[k, i], forces[k, i] = speed[i], u
            if abs(place[i]) > far:
                return k
        for s in range(substeps):
            at = (k * substeps + s - late) // substeps
            for i in range(devices):
                u = hand[k, i] + (commands[i, at % _FORCES_KEPT] if at >= 0 else 0.0)
                for row in range(order):
                    following[row] = push[i, row] * u
                    for j in range(order):
                        following[row] += transition[i, row, j] * x[i, j]
                new = direct[i] * u
                for j in range(order):
                    x[i, j] = following[j]
                    new += output[i, j] * following[j]
                if not abs(new) <= far:
                    # Far within a sample: counting the edges on the way there would take for ever.
                    return k + 1
                start = k * period + s * dt
                counts[i], edges[i] = count_through(
                    counts[i], start, place[i], start + dt, new, step, spacing, times[i], directions[i], edges[i]
                )
                place[i] = new
    return samples
