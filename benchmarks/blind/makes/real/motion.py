"""A run on an even grid, low-passed, with its derivatives and the direction in which each joint moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.makes.real.recordings import Run

Array = np.ndarray
FEIGNED = 3.0  # deviations of the positions' noise: a joint that comes back by less has not turned


@dataclass(frozen=True)
class Grid:
    """Motion and torque of one run below a frequency.

    Attributes:
        t: Even times [s], shape ``(M,)``.
        q: Positions, shape ``(M, n)``; ``v`` and ``a`` their derivatives; ``tau`` the torques.
        side: Direction of motion, 1 or -1, shape ``(M, n)``: at rest that of the motion before, until the next begins.
        back: Way by which a joint has to come back to have turned [rad or m], shape ``(n,)``.
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
        """Of the grid [s]."""
        return float(self.t[1] - self.t[0])


def low_passed(x: Array, step: float, high: float) -> Array:
    """Without what is faster than ``high`` [Hz], forwards and backwards, so that nothing comes late."""
    return sosfiltfilt(butter(4, high, fs=1.0 / step, output="sos"), x, axis=0)


def directions(q: Array, back: Array) -> Array:
    """Direction of each joint's motion, 1 or -1, shape ``(M, n)``.

    A joint has turned once it has come back from its farthest place by more than what noise feigns; it turned when it
    was there last. A joint that rests so keeps the direction in which it came until it leaves the other way.

    Args:
        q: Positions [rad or m], shape ``(M, n)``.
        back: Way that counts as coming back [rad or m], shape ``(n,)``.
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
    """A run at its own median rate, without what is faster than ``high`` [Hz]."""
    step = float(np.median(np.diff(run.t)))
    t = np.arange(int((run.t[-1] - run.t[0]) / step) + 1) * step + run.t[0]
    read = CubicSpline(run.t, run.q)(t)
    q = low_passed(read, step, high)
    v = np.gradient(q, step, axis=0)
    tau = low_passed(CubicSpline(run.t, run.tau)(t), step, high)
    # Differences of neighbours: what is left of the motion in them is small beside the noise of any encoder.
    back = FEIGNED * np.std(np.diff(read - q, axis=0), axis=0) / np.sqrt(2.0)
    return Grid(t, q, v, np.gradient(v, step, axis=0), tau, directions(q, back), back)


def at_rows(run: Run, grid: Grid, values: Array) -> Array:
    """Values on the grid at the times of the log, shape ``(N, n)``."""
    return np.column_stack([np.interp(run.t, grid.t, one) for one in values.T])
