"""Linear filters with memory: first and second order, delay, and Laguerre's basis for any decaying response.

Laguerre's basis is a low pass followed by equal all-passes. Source: Wahlberg, IEEE Transactions on Automatic Control 36
(1991) 551-562.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float
from phantom_dyn.signals.recursive import lagging, recursive_filter


def resonator(x: Float[Array, " N"], dt: float, hz: float, damping: float) -> Float[Array, "N 2"]:
    """State ``y, y'/w`` of ``y'' + 2 d w y' + w^2 y = w^2 x``, which is at rest at the start.

    The input is constant between samples (zero-order hold), so the result is exact.

    Args:
        x: Input of the filter.
        dt: Sampling time [s].
        hz: Frequency ``w / 2 pi`` [Hz].
        damping: Ratio ``d``, below 1.
    """
    w = 2 * np.pi * hz
    root = np.sqrt(1.0 - damping**2)
    decay, angle = np.exp(-damping * w * dt), w * root * dt
    cosine, sine = decay * np.cos(angle), decay * np.sin(angle) / root
    a = (1.0, -2 * cosine, decay**2)
    y = recursive_filter((1.0 - cosine - damping * sine, decay**2 + damping * sine - cosine), a, x[:, None])
    rate = recursive_filter((sine, -sine), a, x[:, None]) - x[0]
    return np.column_stack([y, rate])


def delayed(x: Float[Array, " N"], t: Float[Array, " N"], late: float) -> Float[Array, " N"]:
    """A series delayed by a time [s]; before its start it has its first value."""
    return np.interp(t - late, t, x)


def laguerre(x: Float[Array, " N"], dt: float, hz: float, order: int) -> Float[Array, "N order"]:
    """A series after a first-order low pass, and after the low pass and 1 to ``order - 1`` all-passes of its corner.

    Args:
        x: Input of the filter.
        dt: Sampling time [s].
        hz: Corner frequency [Hz].
        order: Number of series.
    """
    pole = float(np.exp(-2 * np.pi * hz * dt))
    out = [recursive_filter((1.0 - pole,), (1.0, -pole), x[:, None])]
    for _ in range(order - 1):
        out.append(recursive_filter((-pole, 1.0), (1.0, -pole), out[-1]))
    return np.column_stack(out)


def laguerre_gains(at_hz: Float[Array, " F"], dt: float, hz: float, order: int) -> Complex[Array, "F order"]:
    """Complex gains of the series of `laguerre` at given frequencies."""
    pole = float(np.exp(-2 * np.pi * hz * dt))
    delay = np.exp(-2j * np.pi * at_hz * dt)  # of one sample
    low, all_pass = (1.0 - pole) / (1.0 - pole * delay), (delay - pole) / (1.0 - pole * delay)
    return low[:, None] * all_pass[:, None] ** np.arange(order)


def lagged(x: Float[Array, " N"], dt: float, lag: float) -> Float[Array, " N"]:
    """Output of a first-order lag [s] for a series as input; the series itself if the lag is zero."""
    return lagging(x, dt, lag) if lag else x
