"""Samples that say little about friction: joints at standstill are left out, reversals are weighed down.

At standstill static friction may hold any torque, so no fit may use it. At a reversal a law lets friction jump, while a
real joint sticks for some milliseconds, or bends before it slides, so that friction passes through zero earlier or
later. Where noise is small, that residual looks like torque that comes too late.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from phantom_dyn.dynamics.dynamics import modelled_friction
from phantom_dyn.effects.operation import Operation

Array = np.ndarray


def moving_joints(log: Log) -> Bool[Array, " nv"]:
    """False for joints whose whole motion is rounding: less than a millionth of a radian or metre."""
    return np.ptp(log.motion.q, axis=0) > 1e-6


def standing_still(log: Log) -> Bool[Array, "N nv"]:
    """True where a joint is at standstill: its speed is within noise, so static friction may hold any torque.

    The threshold is three sigmas of what a short moving average takes off the velocity in the quietest fifth of the
    record, where the motion itself adds nothing, and at least a thousandth of the joint's top speed. What shakes on its
    way, as a drive with play may all the time, is judged by that average.
    """
    width = max(3, int(log.band.rate_hz / log.band.cutoff_hz))
    kernel = np.ones(width) / width
    out = np.empty(log.motion.v.shape, dtype=bool)
    for j, moves in enumerate(moving_joints(log)):
        q, v = log.motion.q[:, j], log.motion.v[:, j]
        sigma = _noise(v, kernel)
        noise_only = bool(np.percentile(np.abs(v), 95) < 5 * sigma)
        if noise_only and moves and _travels(q, kernel):
            v = np.convolve(v, kernel, mode="same")
            sigma, noise_only = _noise(v, kernel), False
        slow = np.abs(v) < max(3 * sigma, 1e-3 * np.percentile(np.abs(v), 99))
        # Passing through zero is no standstill: the joint has to be slow for a whole period of the band's edge.
        at_standstill = np.convolve(slow, kernel, mode="same") > 0.999
        # A joint whose fastest speeds are noise too is held all the time.
        held = not moves or noise_only
        out[:, j] = (np.convolve(at_standstill, np.ones(width), mode="same") > 0.5) | held
    return out


def _noise(v: Float[Array, " N"], kernel: Float[Array, " w"]) -> float:
    """Root mean square of a series less its moving average, over its quietest fifth."""
    width = len(kernel)
    rough = v - np.convolve(v, kernel, mode="same")
    windows = rough[: len(rough) // width * width].reshape(-1, width)
    return float(np.percentile(np.sqrt(np.mean(windows**2, axis=1)), 20)) if len(windows) else 0.0


def _travels(q: Float[Array, " N"], kernel: Float[Array, " w"]) -> bool:
    """True if a joint goes much further than it shakes."""
    if len(q) < 4 * len(kernel):
        return False
    smooth = np.convolve(q, kernel, mode="valid")
    rough = q[len(kernel) // 2 :][: len(smooth)] - smooth
    return bool(np.ptp(smooth) > rules.TRAVELS * rough.std())


def usable_samples(log: Log) -> Bool[Array, "n nv"]:
    """In-band samples whose kernel touches nothing excluded and hardly any standstill of the joint."""
    at_standstill = standing_still(log)
    half, at = log.band.half, log.samples
    count = np.vstack([np.zeros(at_standstill.shape[1], dtype=int), np.cumsum(at_standstill, axis=0)])
    share = (count[at + half + 1] - count[at - half]) / (2 * half + 1)
    return (share < 0.25) & log.valid_in_band[:, None]


def reversal_doubt(operation: Operation) -> Float[Array, "N nv"]:
    """Standard deviation of the modelled torque near reversals, from the rate of its Coulomb friction.

    It has the sign of the change, so that filters make of it what they make of the torque.
    """
    friction = operation.own_friction
    # Viscous friction doubles with the velocity, Coulomb friction does not.
    coulomb = 2.0 * friction - modelled_friction(operation.robot, replace(operation, v=2.0 * operation.v))
    return rules.REVERSAL_TIME * np.gradient(coulomb, operation.dt, axis=0)
