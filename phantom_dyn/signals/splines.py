"""Sampled series at other times, by lines, and their derivatives, by splines with the ends of not-a-knot."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from phantom_dyn.array_types import Array, Float


def quintic_derivatives(x: Float[Array, "N k"], rate_hz: float) -> tuple[Float[Array, "N k"], Float[Array, "N k"]]:
    """First and second derivative [per s, per s^2] of the quintic spline through samples, one series a column."""
    t = np.arange(len(x)) / rate_hz
    spline = make_interp_spline(t, x, k=5)
    return spline(t, 1), spline(t, 2)


def interpolated(at: Float[Array, " n"], t: Float[Array, " N"], x: Float[Array, "N k"]) -> Float[Array, "n k"]:
    """Series at other times, linear between their samples, one a column; the ends hold beyond them."""
    return np.column_stack([np.interp(at, t, column) for column in x.T])
