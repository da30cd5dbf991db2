"""A run on an even grid, low-passed, with its derivatives and the direction in which each joint moves."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.makes.real.recordings import Run

Array = np.ndarray
STILL = 0.02  # of its top speed: a joint that is slower keeps the direction in which it moved


@dataclass(frozen=True)
class Grid:
    """Motion and torque of one run below a frequency.

    Attributes:
        t: Even times [s], shape ``(M,)``.
        q: Positions, shape ``(M, n)``; ``v`` and ``a`` their derivatives; ``tau`` the torques.
        side: Direction of motion, 1 or -1, shape ``(M, n)``: at rest that of the motion before, until the next begins.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    side: Array

    @property
    def step(self) -> float:
        """Of the grid [s]."""
        return float(self.t[1] - self.t[0])


def low_passed(x: Array, step: float, high: float) -> Array:
    """Without what is faster than ``high`` [Hz], forwards and backwards, so that nothing comes late."""
    return sosfiltfilt(butter(4, high, fs=1.0 / step, output="sos"), x, axis=0)


def directions(v: Array) -> Array:
    """Direction of each joint's motion, 1 or -1, shape ``(M, n)``.

    A joint is at rest below a fiftieth of its top speed. Where it goes on the way it came it has never turned; where it
    does not, it turns at the last sample at which its speed changes sign.
    """
    out = np.empty_like(v)
    for j, speed in enumerate(v.T):
        moving = np.flatnonzero(np.abs(speed) > STILL * np.abs(speed).max())
        if not len(moving):
            out[:, j] = 1.0
            continue
        signs = np.sign(speed)
        out[: moving[0], j] = signs[moving[0]]
        out[moving[-1] :, j] = signs[moving[-1]]
        for first, end in pairwise(moving):
            before, after = signs[first], signs[end]
            against = np.flatnonzero(signs[first:end] != after) if before != after else np.zeros(0, dtype=int)
            out[first:end, j] = before
            if len(against):
                out[first + against[-1] + 1 : end, j] = after
    return out


def even(run: Run, high: float) -> Grid:
    """A run at its own median rate, without what is faster than ``high`` [Hz]."""
    step = float(np.median(np.diff(run.t)))
    t = np.arange(int((run.t[-1] - run.t[0]) / step) + 1) * step + run.t[0]
    q = low_passed(CubicSpline(run.t, run.q)(t), step, high)
    v = np.gradient(q, step, axis=0)
    tau = low_passed(CubicSpline(run.t, run.tau)(t), step, high)
    return Grid(t, q, v, np.gradient(v, step, axis=0), tau, directions(v))


def at_rows(run: Run, grid: Grid, values: Array) -> Array:
    """Values on the grid at the times of the log, shape ``(N, n)``."""
    return np.column_stack([np.interp(run.t, grid.t, one) for one in values.T])
