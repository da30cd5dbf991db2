"""Interpolates sampled series linearly, and differentiates them with quintic splines (not-a-knot ends)."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from phantom_dyn.array_types import Array, Float


def quintic_derivatives(x: Float[Array, "N k"], rate_hz: float) -> tuple[Float[Array, "N k"], Float[Array, "N k"]]:
    """First and second derivative [per s, per s^2] of the quintic spline through samples; each column is a series."""
    t = np.arange(len(x)) / rate_hz
    spline = make_interp_spline(t, x, k=5)
    return spline(t, 1), spline(t, 2)


def interpolated(at: Float[Array, " n"], t: Float[Array, " N"], x: Float[Array, "N k"]) -> Float[Array, "n k"]:
    """Interpolate series linearly at the times ``at``; each column is a series, constant before and after its ends."""
    return np.column_stack([np.interp(at, t, column) for column in x.T])
