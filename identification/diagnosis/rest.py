"""Joints at rest: static friction may hold any torque there, so no fit may use it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool

from identification.log import Log

Array = np.ndarray


def moving_joints(log: Log) -> Bool[Array, " nv"]:
    """False for joints whose whole motion is rounding: less than a millionth of a radian or metre."""
    return np.ptp(log.motion.q, axis=0) > 1e-6


def standing_still(log: Log) -> Bool[Array, "N nv"]:
    """True where a joint rests: its speed is within noise, so static friction may hold any torque.

    The threshold is three sigmas of what a short moving average takes off the velocity in the quietest fifth of the
    record, where the motion itself adds nothing, and at least a thousandth of the joint's top speed.
    """
    v = log.motion.v
    width = max(3, int(log.band.rate_hz / log.band.cutoff_hz))
    kernel = np.ones(width) / width
    out = np.empty(v.shape, dtype=bool)
    for j, moves in enumerate(moving_joints(log)):
        rough = v[:, j] - np.convolve(v[:, j], kernel, mode="same")
        windows = rough[: len(rough) // width * width].reshape(-1, width)
        sigma = float(np.percentile(np.sqrt(np.mean(windows**2, axis=1)), 20)) if len(windows) else 0.0
        slow = np.abs(v[:, j]) < max(3 * sigma, 1e-3 * np.percentile(np.abs(v[:, j]), 99))
        # Passing through zero is no rest: the joint has to be slow for a whole period of the band's edge.
        resting = np.convolve(slow, kernel, mode="same") > 0.999
        # A joint whose fastest speeds are noise too is held all the time.
        held = not moves or np.percentile(np.abs(v[:, j]), 95) < 5 * sigma
        out[:, j] = (np.convolve(resting, np.ones(width), mode="same") > 0.5) | held
    return out


def usable_samples(log: Log) -> Bool[Array, "n nv"]:
    """In-band samples whose kernel touches nothing excluded and hardly any rest of the joint."""
    resting = standing_still(log)
    half, at = log.band.half, log.samples
    count = np.vstack([np.zeros(resting.shape[1], dtype=int), np.cumsum(resting, axis=0)])
    share = (count[at + half + 1] - count[at - half]) / (2 * half + 1)
    return (share < 0.25) & log.valid_in_band[:, None]
