"""Noise of the torque readings, measured in the band above the motion where the recorder has not smoothed it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from phantom_dyn.array_types import Array, Float
from phantom_dyn.signals.spectra import cross_density, power_density

_BANDS = 4  # parts of the band above
_TAIL = 2  # the first part of the upper half, in which the noise has to be white
_LEAST_BINS = 4  # of a spectrum in each part
_SEGMENTS = 16  # of a recording at least: fewer make the spectrum too rough to judge
_MARGIN = 1.5  # times the edge of the filter's band: from here on nothing of the motion is left
_TOP = 0.4  # of the rate: above, the alignment of a held torque takes too much off


@dataclass(frozen=True)
class Density:
    """Power density of white noise [(N m)^2/Hz]: mean, smallest and largest over parts of the band above the motion."""

    value: float
    low: float
    high: float


def torque_noise(logs: tuple[Log, ...], row: int, *, held: bool) -> Density | None:
    """Power density of the noise in a joint's torque readings; None where the band above does not show it.

    Torque that is coherent with the readings of the joint's position is left out: a controller answers the noise and
    the steps of its encoder, and that torque is real. The rest has to be flat in the upper half of the band above, into
    which steps of friction and of references reach least: a recorder that smooths leaves less and less there, and then
    nothing follows for lower frequencies. The power that interpolation between uneven samples removes is known, and
    added again.

    Args:
        logs: Recordings at the full rate.
        row: Which joint.
        held: True if the torque was aligned as one that is held between samples.
    """
    parts = [part for log in logs if (part := _above(log, row, held=held)) is not None]
    if not parts:
        return None
    weights = np.array([weight for _, weight in parts])
    levels, centres = (np.average([part[k] for part, _ in parts], axis=0, weights=weights)[_TAIL:] for k in (0, 1))
    if not levels.min() > 0:
        return None
    slope = float(np.log(levels[-1] / levels[0]) / np.log(centres[-1] / centres[0]))
    if abs(slope) > rules.FLAT_NOISE:
        return None
    return Density(float(np.exp(np.log(levels).mean())), float(levels.min()), float(levels.max()))


def _above(log: Log, row: int, *, held: bool) -> tuple[Float[Array, "2 b"], float] | None:
    """Mean power density and middle [Hz] of each part of the band above the motion of one recording, and its length."""
    rate, tau = log.band.rate_hz, log.tau[:, row]
    low, high = _MARGIN * log.band.cutoff_hz, _TOP * rate
    length = min(1024, len(tau) // (_SEGMENTS // 2))
    if high < 2.0 * low:
        return None
    f, power = power_density(tau, rate, length)
    if log.raw_q is not None and np.ptp(log.raw_q[:, row]) > 0:
        q = log.raw_q[:, row]
        _, own = power_density(q, rate, length)
        _, both = cross_density(tau, q, rate, length)
        segments = max(2 * len(tau) // length - 1, 2)
        # Over n segments, a share 1/n of the power of independent series is coherent by chance.
        power = np.maximum(power - np.abs(both) ** 2 / np.maximum(own, 1e-300), 0.0) * segments / (segments - 1)
    power = power / log.noise_gain(f)
    if held:
        power = power / _alignment(f / rate) ** 2
    edges = low * (high / low) ** (np.arange(_BANDS + 1) / _BANDS)
    inside = [(f >= a) & (f < b) for a, b in pairwise(edges)]
    if min(int(part.sum()) for part in inside) < _LEAST_BINS:
        return None
    levels = [power[part].mean() for part in inside]
    return np.array([levels, np.sqrt(edges[:-1] * edges[1:])]), float(len(tau))


def _alignment(f: Float[Array, " k"]) -> Float[Array, " k"]:
    """Gain by which `align_held_torque` weakens a frequency, given as a share of the rate."""
    return np.abs(26.0 * np.cos(np.pi * f) - 2.0 * np.cos(3.0 * np.pi * f)) / 24.0
