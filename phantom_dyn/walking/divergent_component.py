r"""Closed-form motion of the linear inverted pendulum, whose zero moment point moves linearly and then stays.

Let :math:`p` be the zero moment point, :math:`z` the height of the centre of mass, and :math:`\omega = \sqrt{g/z}`. The
pendulum :math:`\ddot x = \omega^2 (x - p)` consists of two first-order systems. Its divergent component
:math:`\xi = x + \dot x / \omega` (the capture point) moves away from p, :math:`\dot \xi = \omega (\xi - p)`. The centre
of mass follows the divergent component, :math:`\dot x = \omega (\xi - x)`. A walking plan chooses :math:`p` so that
:math:`\xi` stays bounded. All equations are linear in points on the ground, so the same scalar weights apply to x and
y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class Profile:
    """Timing of a phase [s]: the zero moment point moves during ``ramp`` and then stays until ``duration``."""

    ramp: float
    duration: float


def forward_weights(profile: Profile, omega: float) -> tuple[float, float, float]:
    r"""Weights E, F0, F1 of :math:`\xi(T) = E \xi(0) + F_0 p_0 + F_1 p_1` for a ramp from p0 to p1; their sum is 1."""
    k = 1.0 / (omega * profile.ramp)
    # Growth of the divergent component during the ramp, and after it.
    in_ramp = np.exp(omega * profile.ramp)
    after = np.exp(omega * (profile.duration - profile.ramp))
    first = after * (k * (in_ramp - 1.0) - in_ramp)
    last = (1.0 - after) + after * (1.0 - k * (in_ramp - 1.0))
    return float(after * in_ramp), float(first), float(last)


def entry(points: Float[Array, "n 2"], profiles: tuple[Profile, ...], omega: float) -> tuple[float, Float[Array, " 2"]]:
    r"""Divergent component at the start of a sequence of phases after which the pendulum rests over the last point.

    Args:
        points: Zero moment point after the ramp of each phase [m], shape ``(n, 2)``.
        profiles: Timing of each phase.
        omega: :math:`\omega` [1/s].

    Returns:
        ``alpha`` and ``beta``: the component is ``alpha p + beta`` if the first ramp starts at the point ``p``.
    """
    xi = points[-1]
    for k in range(len(points) - 1, 0, -1):
        grow, first, last = forward_weights(profiles[k], omega)
        xi = (xi - first * points[k - 1] - last * points[k]) / grow
    grow, first, last = forward_weights(profiles[0], omega)
    return -first / grow, (xi - last * points[0]) / grow


def holding_point(
    xi: Float[Array, " 2"],
    start: Float[Array, " 2"],
    profile: Profile,
    onward: tuple[float, Float[Array, " 2"]],
    omega: float,
) -> Float[Array, " 2"]:
    r"""Point to which the zero moment point must move in a phase, so that the next phases begin as `entry` requires.

    Args:
        xi: Divergent component at the start of the phase [m].
        start: Zero moment point at the start of the phase [m].
        profile: Timing of the phase.
        onward: Result of `entry` for the phases after this one.
        omega: :math:`\omega` [1/s].
    """
    grow, first, last = forward_weights(profile, omega)
    alpha, beta = onward
    return (beta - grow * xi - first * start) / (last - alpha)


@dataclass(frozen=True)
class PendulumState:
    """Horizontal motion of a pendulum in metres and seconds.

    Attributes:
        zmp: Zero moment point.
        dcm: Divergent component.
        com: Centre of mass.
        velocity: Velocity of the centre of mass.
        acceleration: Acceleration of the centre of mass.
    """

    zmp: Float[Array, "N 2"]
    dcm: Float[Array, "N 2"]
    com: Float[Array, "N 2"]
    velocity: Float[Array, "N 2"]
    acceleration: Float[Array, "N 2"]


def pendulum(
    t: Float[Array, " N"],
    profile: Profile,
    points: tuple[Float[Array, " 2"], Float[Array, " 2"]],
    xi: Float[Array, " 2"],
    com: Float[Array, " 2"],
    omega: float,
) -> PendulumState:
    r"""Motion of the pendulum within one phase.

    Args:
        t: Times since the start of the phase [s], shape ``(N,)``.
        profile: Timing of the phase.
        points: Zero moment point at the start and after the ramp [m].
        xi: Divergent component at the start [m].
        com: Centre of mass at the start [m].
        omega: :math:`\omega` [1/s].
    """
    start, hold = points
    slope = (hold - start) / profile.ramp
    ramp = _linear(np.minimum(t, profile.ramp), start, slope, xi, com, omega)
    end = _linear(np.array([profile.ramp]), start, slope, xi, com, omega)
    after_ramp = _linear(np.maximum(t - profile.ramp, 0.0), hold, 0 * slope, end.dcm[0], end.com[0], omega)
    late = (t > profile.ramp)[:, None]
    names = ("zmp", "dcm", "com", "velocity", "acceleration")
    return PendulumState(*(np.where(late, getattr(after_ramp, name), getattr(ramp, name)) for name in names))


def _linear(t: Array, p: Array, slope: Array, xi: Array, com: Array, omega: float) -> PendulumState:
    """Motion while the zero moment point p has constant speed: x = p + A exp(omega t) + B exp(-omega t)."""
    t = t[:, None]
    grow, decay = np.exp(omega * t), np.exp(-omega * t)
    a = (xi - p - slope / omega) / 2
    b = com - p - a
    zmp = p + slope * t
    x = zmp + a * grow + b * decay
    velocity = slope + omega * (a * grow - b * decay)
    return PendulumState(zmp, x + velocity / omega, x, velocity, omega**2 * (x - zmp))
