"""Makes a low-passed copy of a recording on a uniform time grid; the checks use it, the diagnosis does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.data.derivatives import differentiate, zero_phase
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.motion import Motion
from phantom_dyn.signals.band_edges import acceleration_edge
from phantom_dyn.signals.splines import interpolated

_FEWEST = 100  # samples that a spectrum needs


@dataclass(frozen=True)
class SmoothedRecording:
    """Motion and torque on a uniform grid, through the same low pass without delay.

    Attributes:
        t: Time [s], shape ``(N,)``.
        step: Sampling time of the grid [s].
        cutoff_hz: Cut-off frequency of the low pass.
        q, v, a: Positions [rad or m], velocities and accelerations, shape ``(N, nv)`` each.
        sign: Low-passed sign of the velocity, shape ``(N, nv)``: Coulomb friction in a smoothed torque is proportional
            to it.
        tau: Smoothed torque [N m or N], shape ``(N, nv)``; None if the recording has no torque.
        v_measured: Smoothed measured velocity, shape ``(N, nv)``; None if no velocity was measured.
        inside: False at the ends of the record, where the filter settles, and in excluded intervals; shape ``(N,)``.
    """

    t: Float[Array, " N"]
    step: float
    cutoff_hz: float
    q: Float[Array, "N nv"]
    v: Float[Array, "N nv"]
    a: Float[Array, "N nv"]
    sign: Float[Array, "N nv"]
    tau: Float[Array, "N nv"] | None
    v_measured: Float[Array, "N nv"] | None
    inside: Array

    def motion(self, rows: Array) -> Motion:
        """Motion in the given rows."""
        return Motion(self.t[rows], self.q[rows], self.v[rows], self.a[rows])

    def rows(self, largest: int) -> Array:
        """Indices of at most ``largest`` rows, evenly spread over the rows that are ``inside``."""
        inside = np.flatnonzero(self.inside)
        return inside[np.linspace(0, len(inside) - 1, min(largest, len(inside))).astype(int)]


def included(recording: Recording) -> Array:
    """True for samples outside every excluded interval, shape ``(N,)``."""
    kept = np.ones(len(recording.t), dtype=bool)
    for start, stop in recording.excluded:
        kept &= (recording.t < start) | (recording.t > stop)
    return kept


def smoothed(recording: Recording) -> SmoothedRecording | None:
    """The smoothed copy; None for a very short record, and for one with long gaps.

    The cut-off is the median of the frequencies above which the joints' accelerations are mostly noise.
    """
    t = recording.t
    step = float(np.median(np.diff(t)))
    # A gap of hours would be filled by interpolated samples, which may not fit into memory.
    if len(t) < _FEWEST or t[-1] - t[0] > 4 * len(t) * step:
        return None
    rate = 1 / step
    grid = np.arange(t[0], t[-1] + 1e-9 * step, step)

    q = interpolated(grid, t, recording.q)
    edges = [edge for column in q.T if (edge := acceleration_edge(column, rate)) is not None]
    cutoff = float(np.clip(np.median(edges) if edges else 0.1 * rate, 10 / (t[-1] - t[0]), 0.2 * rate))
    q, v, a = differentiate(q, rate, cutoff)
    tau, measured = (
        None if values is None else zero_phase(interpolated(grid, t, values), rate, cutoff)
        for values in (recording.tau, recording.v)
    )
    margin = int(min(2 * rate / cutoff, 0.1 * len(grid)))
    inside = np.interp(grid, t, included(recording)) > 0.999
    inside[:margin] = inside[len(grid) - margin :] = False
    return SmoothedRecording(
        t=grid,
        step=step,
        cutoff_hz=cutoff,
        q=q,
        v=v,
        a=a,
        sign=zero_phase(np.sign(v), rate, cutoff),
        tau=tau,
        v_measured=measured,
        inside=inside,
    )
