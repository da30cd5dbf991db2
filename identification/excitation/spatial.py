"""Spatial vectors of many samples at once: linear part first, about the origin of a body frame, components first.

A vector is an array ``(3, ..., N)`` and a spatial vector ``(6, ..., N)``: components first keeps each of them in one
stretch of memory, which NumPy goes through faster than through ``(N, ..., 3)``.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

Array = np.ndarray


def cross(a: Float[Array, "3 ..."], b: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
    """Vector product, broadcast over all axes but the first."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def motion_cross(x: Float[Array, "6 ..."], y: Float[Array, "6 ..."]) -> Float[Array, "6 ..."]:
    """How the motion ``y`` changes when it is carried along by the motion ``x``."""
    linear = cross(x[3:], y[:3]) + cross(x[:3], y[3:])
    return np.concatenate([linear, cross(x[3:], y[3:])])


def force_cross(x: Float[Array, "6 ..."], f: Float[Array, "6 ..."]) -> Float[Array, "6 ..."]:
    """How the force ``f`` changes when ``x`` carries it along: its power on y is minus that of f on x cross y."""
    moment = cross(x[3:], f[3:]) + cross(x[:3], f[:3])
    return np.concatenate([cross(x[3:], f[:3]), moment])


def inner(x: Float[Array, "6 ..."], f: Float[Array, "6 ..."]) -> Float[Array, "..."]:
    """Power of a force on a motion."""
    return (x * f).sum(axis=0)


def momentum(pi: Float[Array, "10 ..."], x: Float[Array, "6 ..."]) -> Float[Array, "6 ..."]:
    """Inertia times motion, of bodies with the parameters ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``."""
    h, v, w = pi[1:4], x[:3], x[3:]
    out = np.empty((6, *np.broadcast_shapes(pi.shape[1:], x.shape[1:])))
    out[:3] = pi[0] * v - cross(h, w)
    out[3:] = cross(h, v)
    out[3] += pi[4] * w[0] + pi[5] * w[1] + pi[7] * w[2]
    out[4] += pi[5] * w[0] + pi[6] * w[1] + pi[8] * w[2]
    out[5] += pi[7] * w[0] + pi[8] * w[1] + pi[9] * w[2]
    return out


def into_child(R: Float[Array, "3 3 N"], p: Float[Array, "3 N"], x: Float[Array, "6 n N"]) -> Float[Array, "6 n N"]:
    """Motions of the parent's frame as seen from a child at ``p``, whose axes are the columns of ``R``."""
    at_child = np.stack([x[:3] - cross(p[:, None], x[3:]), x[3:]])
    out = np.empty_like(x)
    for k in range(3):
        turned = R[0, k] * at_child[:, 0] + R[1, k] * at_child[:, 1] + R[2, k] * at_child[:, 2]
        out[k], out[3 + k] = turned
    return out
