"""Finds the frequency up to which a motion or a torque exceeds its noise, from power spectra."""

from __future__ import annotations

import itertools

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.signals.spectra import Window, power_density

_BINS_PER_OCTAVE = 6
# Smallest exponent with which an acceleration spectrum of noise rises with frequency: white noise of the position has
# 4, motion has less.
_LEAST_NOISE_EXPONENT = 2.5
# Smallest ratio of the power at the peak of an acceleration spectrum to the power of its floor.
_LEAST_PEAK = 250.0
# Largest ratio of the power of noise to that of a slow motion. An identified inertia is then one per cent too small.
_LARGEST_NOISE = 0.01
# If the power of the measured torque is less than this share of that of the modelled torque, the drive does not move
# the joint.
_LEAST_DRIVE = 0.5


def _welch(x: Float[Array, " N"], rate_hz: float, window: Window = "blackman") -> tuple[Array, Array, int]:
    """Frequencies [Hz], power density, and number of samples in a segment.

    A segment is 4 s long, but at most a fifth of the series, and at least 256 samples.
    """
    length = min(len(x), max(256, min(int(4 * rate_hz), len(x) // 5)))
    f, power = power_density(x, rate_hz, length, window=window)
    return f, power, length


def acceleration_edge(q: Float[Array, " N"], rate_hz: float) -> float | None:
    """Frequency [Hz] up to which the acceleration of ``q`` is 10 dB above its noise floor; None for a joint at rest.

    A joint without a clear peak in the spectrum is at rest, unless it moves in ramps, see `_edge_above_encoder_noise`.
    """
    f, power, length = _acceleration_spectrum(q, rate_hz)
    low, high = 3 * rate_hz / length, 0.4 * rate_hz
    if not power.any() or low >= high:
        return None
    centre, level = _sixth_octaves(f, power, low, high)
    if not len(centre):
        return None
    edge = _edge_above_floor(centre, level)
    return _edge_above_encoder_noise(centre, level, rate_hz) if edge is None else edge


def _acceleration_spectrum(
    q: Float[Array, " N"], rate_hz: float, window: Window = "blackman"
) -> tuple[Array, Array, int]:
    """Spectrum of second differences of ``q``, corrected for their smaller gain at high frequencies."""
    f, power, length = _welch(np.diff(q, 2) * rate_hz**2, rate_hz, window)
    w = np.pi * f / rate_hz
    return f, power * np.where(f > 0, (w / np.maximum(np.sin(w), 1e-12)) ** 4, 1.0), length


def _sixth_octaves(
    f: Float[Array, " n"], power: Float[Array, " n"], low: float, high: float
) -> tuple[Float[Array, " b"], Float[Array, " b"]]:
    """Centres [Hz] and mean power of the sixth-octave bins from ``low`` to ``high``, without empty bins."""
    edges = low * 2.0 ** (np.arange(int(np.log2(high / low) * _BINS_PER_OCTAVE) + 1) / _BINS_PER_OCTAVE)
    bins = [(np.sqrt(a * b), (f >= a) & (f < b)) for a, b in itertools.pairwise(edges)]
    kept = [(centre, power[inside].mean()) for centre, inside in bins if inside.any()]
    centres, levels = np.array(kept).reshape(-1, 2).T
    return centres, levels


def _edge_above_floor(centre: Float[Array, " b"], level: Float[Array, " b"]) -> float | None:
    """Frequency [Hz] up to which a spectrum is 10 dB above its floor; None if its peak is not 24 dB above the floor.

    The search starts at the peak of the velocity's spectrum and goes to higher frequencies. It uses an envelope: the
    maximum over a third of an octave to either side. The floor is the minimum of the envelope before it rises by 13 dB;
    such a rise is the noise of a differentiated encoder.
    """
    reach = 2.0 ** (1 / 3)
    envelope = np.array([level[(centre >= c / reach) & (centre <= c * reach)].max() for c in centre])
    start = int(np.argmax(level / centre**2))
    lowest = start
    for k in range(start, len(centre)):
        if envelope[k] < envelope[lowest]:
            lowest = k
        elif envelope[k] > 20 * envelope[lowest]:
            break
    if level[start : lowest + 1].max() < _LEAST_PEAK * envelope[lowest]:
        return None
    edge = next(k for k in range(start, lowest + 1) if envelope[k] <= 10 * envelope[lowest])
    return float(centre[edge])


def _edge_above_encoder_noise(centre: Float[Array, " b"], level: Float[Array, " b"], rate_hz: float) -> float | None:
    """Frequency [Hz] up to which an acceleration spectrum is 10 dB above white noise of the position, or None.

    This is for motion in ramps: their velocity has steps, so that their acceleration spectrum is flat, without a clear
    peak. The level of the encoder noise is estimated at frequencies above a tenth of the rate, if there are at least
    three bins and their slope is that of noise.
    """
    high = centre > 0.1 * rate_hz
    if high.sum() < 3:
        return None
    exponent = np.polyfit(np.log(centre[high]), np.log(np.maximum(level[high], 1e-300)), 1)[0]
    if exponent < _LEAST_NOISE_EXPONENT:
        return None
    noise = float(np.median(level[high] / centre[high] ** 4)) * centre**4
    # The noise is a median, so at least one bin is below 10 times the noise.
    last = int(np.argmax(level < 10 * noise))
    # Three bins are half an octave; a narrower peak is not motion.
    return float(centre[last - 1]) if last >= 3 else None


def slow_motion_edge(q: Float[Array, " N"], rate_hz: float) -> float | None:
    """Frequency [Hz] up to which noise has one per cent of the power of a slow motion's acceleration, or None.

    The frequencies of a slow motion are below those that the spectrum of a short recording resolves, so
    `acceleration_edge` does not find it. Above the minimum of the spectrum there is only noise.
    """
    f, power, length = _acceleration_spectrum(q, rate_hz, "blackmanharris")
    resolved = f >= 4 * rate_hz / length
    motion, higher = power[~resolved].sum(), power[resolved & (f < 0.4 * rate_hz)]
    if not len(higher):
        return None
    least = int(np.argmin(higher))
    quiet = np.cumsum(higher[least:]) <= _LARGEST_NOISE * motion
    if quiet.all() or not quiet[0]:
        return None
    return float(f[resolved][least + int(np.argmin(quiet)) - 1])


def torque_edge(tau: Float[Array, " N"], rate_hz: float) -> float:
    """Frequency [Hz] above which ``tau`` has less than 1 % of its RMS; half the rate if there is no such frequency."""
    f, power, _ = _welch(tau, rate_hz)
    total = power.sum()
    if total == 0:
        return 0.0
    above = np.cumsum(power[::-1])[::-1] / total
    below = np.flatnonzero(above < 1e-4)
    return float(f[below[0]]) if len(below) else 0.5 * rate_hz


def driven_edge(tau: Float[Array, " N"], model: Float[Array, " N"], rate_hz: float, highest_hz: float) -> float:
    """Frequency [Hz] above which the modelled torque of a motion has more than twice the power of the measured torque.

    The search goes from ``highest_hz`` down to 2 Hz in third-octave bins. The result is infinite if the modelled torque
    is not stronger in the highest bin.
    """
    f, drive, _ = _welch(tau, rate_hz)
    _, needed, _ = _welch(model, rate_hz)
    edge = np.inf
    top = highest_hz
    while top > 2.0:
        inside = (f > top / 2 ** (1 / 3)) & (f <= top)
        if inside.any() and drive[inside].sum() > _LEAST_DRIVE * needed[inside].sum():
            break
        if inside.any():
            edge = top / 2 ** (1 / 3)
        top /= 2 ** (1 / 3)
    return float(edge)
