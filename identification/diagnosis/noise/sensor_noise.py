"""Estimates the noise of torque readings from their spectrum above the band of the motion.

The band of the motion contains the frequencies at which the robot moves noticeably. Its edge is that of the band to
which the recording is filtered. The power density of a noise is its power per hertz.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from phantom_dyn.array_types import Array, Float
from phantom_dyn.signals.spectra import cross_density, power_density

_PARTS = 4  # number of parts of the band above the motion
_UPPER_HALF = 2  # index of the first part of the upper half of this band, in which the noise has to be white
_LEAST_BINS = 4  # smallest number of bins of a spectrum in each part; with fewer the noise is unknown
# Smallest number of half-overlapping segments over which a spectrum is averaged. With fewer it is too uncertain.
_SEGMENTS = 16
# Lowest frequency used, as a multiple of the edge of the band of the motion: hardly any motion is above it.
ABOVE_MOTION = 1.5
# Highest frequency used, as a share of the sample rate. Above it, aligning a held torque attenuates too much.
_HIGHEST_FREQUENCY = 0.4


@dataclass(frozen=True)
class Density:
    """Power density of white noise [(N m)^2/Hz], measured above the band of the motion.

    Attributes:
        value: Estimate.
        low, high: Interval of the estimate.
        only_high_known: True if only ``high`` is known. Then ``value`` is a guess between zero and ``high``.
        rises: True if the density rises towards the band of the motion, so that the noise is not white.
        limit_if_rising: Upper limit of the mean density in the judged band if the density rises there, too.
    """

    value: float
    low: float
    high: float
    only_high_known: bool = False
    rises: bool = False
    limit_if_rising: float = 0.0


def torque_noise(logs: tuple[Log, ...], row: int, *, held: bool) -> Density | None:
    """Power density of the noise in a joint's torque readings; None if the band above the motion does not show it.

    Torque that is coherent with the readings of the joint's position is subtracted: a controller responds to the noise
    and the steps of its encoder, and this torque is real. The remaining spectrum has to be flat in the upper half of
    the band, where steps of friction and of references add least power. If the recorder has smoothed the torque, the
    spectrum falls there, and does not show the noise at lower frequencies. Interpolation between uneven samples removes
    power; this known loss is corrected.

    Args:
        logs: Recordings at the full rate.
        row: Index of the joint.
        held: True if `align_held_torque` was applied to the torque, which attenuates high frequencies.
    """
    parts = [part for log in logs if (part := _densities_above_motion(log, row, held=held)) is not None]
    if not parts:
        return None
    weights = np.array([weight for _, weight in parts])
    levels, centres = np.average([part for part, _ in parts], axis=0, weights=weights)[:, _UPPER_HALF:]
    if not levels.min() > 0:
        return None
    slope = float(np.log(levels[-1] / levels[0]) / np.log(centres[-1] / centres[0]))
    if abs(slope) > rules.FLAT_NOISE:
        return None
    return Density(float(np.exp(np.log(levels).mean())), float(levels.min()), float(levels.max()))


def _densities_above_motion(log: Log, row: int, *, held: bool) -> tuple[Float[Array, "2 b"], float] | None:
    """Mean power density and centre [Hz] of each part of the band above the motion, and the number of samples."""
    rate, tau = log.band.rate_hz, log.tau[:, row]
    low, high = ABOVE_MOTION * log.band.cutoff_hz, _HIGHEST_FREQUENCY * rate
    length = min(1024, len(tau) // (_SEGMENTS // 2))
    if high < 2.0 * low:
        return None
    f, power = power_density(tau, rate, length)
    if log.raw_q is not None and np.ptp(log.raw_q[:, row]) > 0:
        q = log.raw_q[:, row]
        _, own = power_density(q, rate, length)
        _, both = cross_density(tau, q, rate, length)
        segments = max(2 * len(tau) // length - 1, 2)
        # With n segments, independent series are coherent by chance in a share 1/n of their power. This is corrected.
        power = np.maximum(power - np.abs(both) ** 2 / np.maximum(own, 1e-300), 0.0) * segments / (segments - 1)
    power = power / log.noise_gain(f)
    if held:
        power = power / _alignment(f / rate) ** 2
    edges = low * (high / low) ** (np.arange(_PARTS + 1) / _PARTS)
    inside = [(f >= a) & (f < b) for a, b in pairwise(edges)]
    if min(int(part.sum()) for part in inside) < _LEAST_BINS:
        return None
    levels = [power[part].mean() for part in inside]
    return np.array([levels, np.sqrt(edges[:-1] * edges[1:])]), float(len(tau))


def _alignment(f: Float[Array, " k"]) -> Float[Array, " k"]:
    """Gain of `align_held_torque` at frequencies given as shares of the rate."""
    return np.abs(26.0 * np.cos(np.pi * f) - 2.0 * np.cos(3.0 * np.pi * f)) / 24.0
