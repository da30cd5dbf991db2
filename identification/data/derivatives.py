"""Velocity and acceleration from positions: low-passed far above the band, or as low as coarse readings ask for.

A joint that passes few steps of its encoder in a period of the low pass keeps stairs as its motion: velocities of zero
between the steps and bursts at them, so that friction has no sign and accelerations are many times too large. All that
its readings say is that the true motion is within half a step of them. The smoothest such motion is taken.
"""

from __future__ import annotations

import numpy as np

from identification.data.log import Band, Log
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.signals.recursive import low_passed
from phantom_dyn.signals.splines import quintic_derivatives

# Ratio of the cut-off of the positions' low pass to the edge of the band: attenuation at the edge is 0.1 %.
MOTION_BAND = 2.5
# Lower edges that are tried, each as a part of the one before, from that of the band on.
_FINER = 2.0**-0.25
# Share by which a low pass may take away more than rounding of the remaining motion explains, and times as much from
# which on no lower edge is tried.
_MORE, _FAR_MORE = 0.01, 1.5
# Steps by which a motion may differ from its readings at most; rounding alone makes half a step.
_FARTHEST = 1.0
# Steps of rounding errors below which the motion is not rounded at all.
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
    """Edge [Hz] of the low pass of each joint's positions: that of its band, or what coarse readings ask for."""
    return motion_edge(log.band) if log.position_edges is None else log.position_edges


def edges_of_readings(
    q: Float[Array, "N nv"], steps: tuple[float | None, ...], valid: Bool[Array, " N"], band: Band
) -> Float[Array, " nv"]:
    """Edge [Hz] of each joint's low pass: that of the band, and lower where it leaves stairs of the encoder's steps.

    Of the edges below that of the band, whose own filter takes away the stairs above it, the lowest is taken that fits
    the readings (the discrepancy principle: Morozov, Dokl. Akad. Nauk SSSR 167, 1966): the low pass takes away no more
    than it takes from the remaining motion once that is rounded to the same steps, and no reading is more than a step
    away from the motion. Readings with noise of many steps keep their edge.

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
            away = _taken_away(q[:, j], rate, lower)
            lattice = q[0, j] + step * np.round((q[:, j] - away - q[0, j]) / step)
            times = away[valid].std() / max(_taken_away(lattice, rate, lower)[valid].std(), _LEAST * step)
            if times > _FAR_MORE or np.abs(away[valid]).max() > _FARTHEST * step:
                break
            if times <= 1.0 + _MORE:
                edges[j] = lower
            lower *= _FINER
    return edges


def _taken_away(q: Float[Array, " N"], rate_hz: float, cutoff_hz: float) -> Float[Array, " N"]:
    """What a low pass takes away from the positions of a joint."""
    if cutoff_hz >= 0.4 * rate_hz:
        return np.zeros_like(q)
    return q - low_passed(q, cutoff_hz, rate_hz, order=4, padding=int(3 * rate_hz / cutoff_hz))
