"""Velocity and acceleration from positions after a low pass, whose edge is lower where the encoder is coarse.

If a joint passes only few steps of its encoder in a period of the low pass, the filtered motion still has stairs: its
velocity is zero between the steps and large at them. Friction then has no sign, and accelerations are many times too
large. The readings only say that the true motion is within half a step of them. The smoothest such motion is taken.
"""

from __future__ import annotations

import numpy as np

from identification.data.log import Band, Log
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.signals.recursive import low_passed
from phantom_dyn.signals.splines import quintic_derivatives

# Ratio of the cut-off of the positions' low pass to the edge of the band: attenuation at the edge is 0.1 %.
MOTION_BAND = 2.5
# Ratio of each lower edge that is tried to the one before; the first one before is the edge of the band.
_FINER = 2.0**-0.25
# The signal that a low pass removes is compared with what it would remove of rounding alone. An edge is accepted if it
# exceeds this by at most the first share; from the second ratio on no lower edge is tried.
_MORE, _FAR_MORE = 0.01, 1.5
# Largest difference of motion and readings, in steps; rounding alone makes half a step.
_FARTHEST = 1.0
# Rounding errors below this many steps count as none.
_LEAST = 1e-6
# Periods in a recording of the slowest motion that is looked for.
_SLOWEST = 4.0


def differentiate(
    q: Float[Array, "N nv"], rate_hz: float, cutoff_hz: float | Float[Array, " nv"]
) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration [per s, per s^2] of ``q`` low-passed without delay at ``cutoff_hz``.

    Derivatives are those of a quintic spline through the filtered samples, exact to 0.5 % up to a sixth of the rate
    (central differences lose 17 % there).

    Args:
        q: Samples at a uniform rate.
        rate_hz: Samples per second.
        cutoff_hz: One edge for all joints, or one for each.
    """
    edges = np.broadcast_to(cutoff_hz, q.shape[1])
    smooth = np.array(q, dtype=float)
    for edge in np.unique(edges[edges < 0.4 * rate_hz]):
        which = edges == edge
        smooth[:, which] = low_passed(q[:, which], edge, rate_hz, order=4, padding=int(3 * rate_hz / edge))
    return smooth, *quintic_derivatives(smooth, rate_hz)


def motion_edge(band: Band) -> float:
    """Frequency [Hz] up to which the positions are kept: far above the band, so that it leaves no trace inside."""
    return min(MOTION_BAND * band.cutoff_hz, 0.4 * band.rate_hz)


def position_edges(log: Log) -> float | Float[Array, " nv"]:
    """Edge [Hz] of the low pass of each joint's positions: the usual one, or a lower one for coarse readings."""
    return motion_edge(log.band) if log.position_edges is None else log.position_edges


def edges_of_readings(
    q: Float[Array, "N nv"], steps: tuple[float | None, ...], valid: Bool[Array, " N"], band: Band
) -> Float[Array, " nv"]:
    """Edge [Hz] of each joint's low pass: that of the band, and lower where the steps of the encoder would remain.

    Edges below the edge of the band are tried: stairs above the band are removed by the band's own filter. The lowest
    edge that fits the readings is taken (the discrepancy principle: Morozov, Dokl. Akad. Nauk SSSR 167, 1966). An edge
    fits if two conditions hold. The low pass removes no more from the readings than from its own result, rounded to the
    same steps. And no reading is more than a step away from the result. Readings with noise of many steps keep the
    usual edge.

    Args:
        q: Positions at a uniform rate.
        steps: Step of each joint's readings [rad or m]; None where they are on no lattice.
        valid: Samples that count.
        band: Band of the torques.
    """
    rate, edges = band.rate_hz, np.full(q.shape[1], motion_edge(band))
    for j, step in enumerate(steps):
        if not step or not valid.any():
            continue
        lower = band.cutoff_hz * _FINER
        while lower > _SLOWEST * rate / len(q):
            removed = _removed(q[:, j], rate, lower)
            lattice = q[0, j] + step * np.round((q[:, j] - removed - q[0, j]) / step)
            times = removed[valid].std() / max(_removed(lattice, rate, lower)[valid].std(), _LEAST * step)
            if times > _FAR_MORE or np.abs(removed[valid]).max() > _FARTHEST * step:
                break
            if times <= 1.0 + _MORE:
                edges[j] = lower
            lower *= _FINER
    return edges


def _removed(q: Float[Array, " N"], rate_hz: float, cutoff_hz: float) -> Float[Array, " N"]:
    """The part of a joint's positions that a low pass removes."""
    if cutoff_hz >= 0.4 * rate_hz:
        return np.zeros_like(q)
    return q - low_passed(q, cutoff_hz, rate_hz, order=4, padding=int(3 * rate_hz / cutoff_hz))
