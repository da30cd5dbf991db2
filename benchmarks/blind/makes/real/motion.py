"""Filters a run at uniform times, and computes its derivatives and the direction in which each joint moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.makes.real.recordings import Run

Array = np.ndarray
FEIGNED = 3.0  # standard deviations of the position noise by which a joint must move back to have reversed


@dataclass(frozen=True)
class Grid:
    """Motion and torque of one run below a frequency.

    Attributes:
        t: Uniform times [s], shape ``(M,)``.
        q, v, a: Positions and their derivatives, shape ``(M, n)``.
        tau: Torques [N m or N], shape ``(M, n)``.
        side: Direction of motion, 1 or -1, shape ``(M, n)``; at rest the direction of the motion before.
        back: Distance by which a joint must move back to have reversed [rad or m], shape ``(n,)``.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    side: Array
    back: Array

    @property
    def step(self) -> float:
        """Time step [s]."""
        return float(self.t[1] - self.t[0])


def low_passed(x: Array, step: float, high: float) -> Array:
    """Low pass at ``high`` [Hz], forwards and backwards so that it causes no delay."""
    return sosfiltfilt(butter(4, high, fs=1.0 / step, output="sos"), x, axis=0)


def directions(q: Array, back: Array) -> Array:
    """Direction of each joint's motion, 1 or -1, shape ``(M, n)``.

    A joint has reversed if it has moved back from its farthest position by more than noise could. The time of the
    reversal is the last sample near the farthest position. So a joint that rests keeps its direction until it moves
    away in the other direction.

    Args:
        q: Positions [rad or m], shape ``(M, n)``.
        back: Smallest distance of a reversal [rad or m], shape ``(n,)``.
    """
    out = np.empty_like(q)
    for j, (place, least) in enumerate(zip(q.T, back, strict=True)):
        gone = np.flatnonzero(np.abs(place - place[0]) > least)
        way = float(np.sign(place[gone[0]] - place[0])) if len(gone) else 1.0
        since, far = 0, 0
        for k in range(len(place)):
            if way * (place[k] - place[far]) > 0.0:
                far = k
            elif way * (place[far] - place[k]) > least:
                there = far + np.flatnonzero(np.abs(place[far:k] - place[far]) <= 0.5 * least)[-1] + 1
                out[since:there, j] = way
                since, far, way = int(there), k, -way
        out[since:, j] = way
    return out


def even(run: Run, high: float) -> Grid:
    """A run at uniform times of its median rate, after a low pass at ``high`` [Hz]."""
    step = float(np.median(np.diff(run.t)))
    t = np.arange(int((run.t[-1] - run.t[0]) / step) + 1) * step + run.t[0]
    read = CubicSpline(run.t, run.q)(t)
    q = low_passed(read, step, high)
    v = np.gradient(q, step, axis=0)
    tau = low_passed(CubicSpline(run.t, run.tau)(t), step, high)
    # In differences of neighbouring samples, the motion above the low pass is small compared with encoder noise.
    back = FEIGNED * np.std(np.diff(read - q, axis=0), axis=0) / np.sqrt(2.0)
    return Grid(t, q, v, np.gradient(v, step, axis=0), tau, directions(q, back), back)


def at_rows(run: Run, grid: Grid, values: Array) -> Array:
    """Values on the grid at the times of the log, shape ``(N, n)``."""
    return np.column_stack([np.interp(run.t, grid.t, one) for one in values.T])
