"""Velocities and accelerations from low-passed positions; the low pass is lower for joints with coarse encoders.

If a joint moves by only a few encoder steps during one period of the low pass, the filtered position is still a
staircase: its velocity is zero between the steps and large at them. The direction of motion, and with it the sign of
friction, is then unknown, and accelerations are many times too large. Encoder readings only say that the true position
is within half a step. So this module takes the smoothest motion that agrees with the readings.
"""

from __future__ import annotations

import numpy as np

from identification.data.log import Band, Log
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.signals.recursive import low_passed
from phantom_dyn.signals.splines import quintic_derivatives

# Ratio of the cut-off of the positions' low pass to the edge of the band: attenuation at the edge is 0.1 %.
MOTION_BAND = 2.5
# Ratio between consecutive edges that are tried; the first is this ratio times the edge of the band.
_EDGE_RATIO = 2.0**-0.25
# Two rms values are compared for each edge: of the part that the low pass removes from the readings, and of the part
# that it removes from its own result after rounding to encoder steps (rounding errors alone). The edge is accepted if
# the first is at most 1 + `_TOLERANCE` times the second. Above `_STOP_RATIO` times, no lower edge is tried.
_TOLERANCE, _STOP_RATIO = 0.01, 1.5
# Largest difference between low-passed positions and readings, in encoder steps; rounding alone makes half a step.
_LARGEST_DIFFERENCE = 1.0
# Lower limit of the second rms value, in encoder steps, so that the ratio is finite.
_LEAST_ROUNDING = 1e-6
# No edge is tried that has fewer periods in the recording.
_FEWEST_PERIODS = 4.0


def differentiate(
    q: Float[Array, "N nv"], rate_hz: float, cutoff_hz: float | Float[Array, " nv"]
) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration [per s, per s^2] of ``q`` low-passed without delay at ``cutoff_hz``.

    Derivatives are those of a quintic spline through the filtered samples, exact to 0.5 % up to a sixth of the rate
    (central differences lose 17 % there).

    Args:
        q: Samples at a uniform rate.
        rate_hz: Samples per second.
        cutoff_hz: Edge of the low pass, one for all joints or one for each joint.
    """
    edges = np.broadcast_to(cutoff_hz, q.shape[1])
    smooth = np.array(q, dtype=float)
    for edge in np.unique(edges):
        which = edges == edge
        smooth[:, which] = zero_phase(q[:, which], rate_hz, edge)
    return smooth, *quintic_derivatives(smooth, rate_hz)


def motion_edge(band: Band) -> float:
    """Edge [Hz] of the positions' low pass: far above the band, so that the filter changes nothing inside the band."""
    return min(MOTION_BAND * band.cutoff_hz, 0.4 * band.rate_hz)


def position_edges(log: Log) -> float | Float[Array, " nv"]:
    """Edge [Hz] of the low pass of each joint's positions: `motion_edge`, or lower for coarse encoders."""
    return motion_edge(log.band) if log.position_edges is None else log.position_edges


def edges_of_readings(
    q: Float[Array, "N nv"], steps: tuple[float | None, ...], valid: Bool[Array, " N"], band: Band
) -> Float[Array, " nv"]:
    """Edge [Hz] of the low pass of each joint's positions: `motion_edge`, or lower if encoder steps would remain.

    Only edges below the edge of the band are tried, because the band's own filter removes everything above its edge.
    The lowest edge that agrees with the readings is taken (the discrepancy principle: Morozov, Dokl. Akad. Nauk SSSR
    167, 1966). An edge agrees if two conditions hold. First, the low pass removes no more from the readings than it
    removes from its own result after rounding to encoder steps. Second, no reading differs from the result by more than
    a step. If the noise of the readings is many steps, no edge agrees, and the result is `motion_edge`.

    Args:
        q: Positions at a uniform rate.
        steps: Encoder step of each joint [rad or m]; None if its readings have no common step.
        valid: True for samples that are compared.
        band: Band of the torques.
    """
    rate, edges = band.rate_hz, np.full(q.shape[1], motion_edge(band))
    for j, step in enumerate(steps):
        if not step or not valid.any():
            continue
        lower = band.cutoff_hz * _EDGE_RATIO
        while lower > _FEWEST_PERIODS * rate / len(q):
            removed = _removed(q[:, j], rate, lower)
            rounded = q[0, j] + step * np.round((q[:, j] - removed - q[0, j]) / step)
            ratio = removed[valid].std() / max(_removed(rounded, rate, lower)[valid].std(), _LEAST_ROUNDING * step)
            if ratio > _STOP_RATIO or np.abs(removed[valid]).max() > _LARGEST_DIFFERENCE * step:
                break
            if ratio <= 1.0 + _TOLERANCE:
                edges[j] = lower
            lower *= _EDGE_RATIO
    return edges


def _removed(q: Float[Array, " N"], rate_hz: float, cutoff_hz: float) -> Float[Array, " N"]:
    """The part of a joint's positions that a low pass removes."""
    return q - zero_phase(q, rate_hz, cutoff_hz)


def zero_phase(x: Float[Array, "N ..."], rate_hz: float, cutoff_hz: float) -> Float[Array, "N ..."]:
    """``x`` low-passed without delay at ``cutoff_hz``; unchanged if the cut-off is above 0.4 times the sample rate."""
    if cutoff_hz >= 0.4 * rate_hz:
        return x
    return low_passed(x, cutoff_hz, rate_hz, order=4, padding=int(3 * rate_hz / cutoff_hz))
