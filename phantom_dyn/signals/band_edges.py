"""Frequencies up to which motion and torque are more than noise, by their power spectra."""

from __future__ import annotations

import itertools

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.signals.spectra import Window, power_density

_BINS_PER_OCTAVE = 6
# White noise of a position rises with the fourth power of frequency in the acceleration's spectrum; motion does not.
_RISE = 2.5
# Power of the peak of an acceleration's spectrum over that of its floor: five times the amplitude that its edge has.
_PEAK = 250.0
# Power of noise over that of a slow motion, at most: an inertia comes out a hundredth too small.
_QUIET = 0.01
# Below this share of the modelled torque's power, what moves a joint is not its drive.
_DRIVEN = 0.5


def _welch(x: Float[Array, " N"], rate_hz: float, window: Window = "blackman") -> tuple[Array, Array, int]:
    """Frequencies [Hz] and power of a series, and how many samples a segment has: 4 s, a fifth of it, or 256."""
    length = min(len(x), max(256, min(int(4 * rate_hz), len(x) // 5)))
    f, power = power_density(x, rate_hz, length, window=window)
    return f, power, length


def acceleration_edge(q: Float[Array, " N"], rate_hz: float) -> float | None:
    """Frequency [Hz] up to which the acceleration of ``q`` stands 10 dB above its noise floor; None if it never does.

    A joint whose acceleration peak is not five times its floor is at rest, unless it moves in ramps, see
    `_edge_above_encoder_noise`.
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
    """Spectrum of the second derivative of ``q``, by second differences less what these take off near half the rate."""
    f, power, length = _welch(np.diff(q, 2) * rate_hz**2, rate_hz, window)
    w = np.pi * f / rate_hz
    return f, power * np.where(f > 0, (w / np.maximum(np.sin(w), 1e-12)) ** 4, 1.0), length


def _sixth_octaves(
    f: Float[Array, " n"], power: Float[Array, " n"], low: float, high: float
) -> tuple[Float[Array, " b"], Float[Array, " b"]]:
    """Middles [Hz] of the sixth-octave bins from ``low`` up to ``high`` that hold a line, and their mean power."""
    edges = low * 2.0 ** (np.arange(int(np.log2(high / low) * _BINS_PER_OCTAVE) + 1) / _BINS_PER_OCTAVE)
    bins = [(np.sqrt(a * b), (f >= a) & (f < b)) for a, b in itertools.pairwise(edges)]
    kept = [(centre, power[inside].mean()) for centre, inside in bins if inside.any()]
    centres, levels = np.array(kept).reshape(-1, 2).T
    return centres, levels


def _edge_above_floor(centre: Float[Array, " b"], level: Float[Array, " b"]) -> float | None:
    """Frequency [Hz] up to which a spectrum stands 10 dB above its floor; None where its peak is not 24 dB above it.

    The spectrum, under an envelope of a third of an octave to either side, is followed upwards from the peak of the
    velocity's; the floor is its minimum before it rises by 13 dB for good, as the noise of a differentiated encoder
    does.
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
    if level[start : lowest + 1].max() < _PEAK * envelope[lowest]:
        return None
    edge = next(k for k in range(start, lowest + 1) if envelope[k] <= 10 * envelope[lowest])
    return float(centre[edge])


def _edge_above_encoder_noise(centre: Float[Array, " b"], level: Float[Array, " b"], rate_hz: float) -> float | None:
    """Frequency up to which an acceleration spectrum stands 10 dB above white noise of the position; None if nowhere.

    Ramps leave steps of velocity, whose acceleration is too flat to show a peak and a floor. The noise of the encoder
    is then read where nothing else can be, above a tenth of the rate: there are three bins at least, or no slope.
    """
    high = centre > 0.1 * rate_hz
    if high.sum() < 3 or np.polyfit(np.log(centre[high]), np.log(np.maximum(level[high], 1e-300)), 1)[0] < _RISE:
        return None
    noise = float(np.median(level[high] / centre[high] ** 4)) * centre**4
    # Half of the bins above a tenth of the rate are no more than noise, so that there is a first one.
    last = int(np.argmax(level < 10 * noise))
    # Three bins are half an octave: less is a line or a chance peak, not motion.
    return float(centre[last - 1]) if last >= 3 else None


def slow_motion_edge(q: Float[Array, " N"], rate_hz: float) -> float | None:
    """Frequency [Hz] up to which noise is a hundredth of the power of a slow motion's acceleration; None without one.

    A slow motion lies below the frequencies that the spectrum of a recording of some seconds resolves, so that
    `acceleration_edge` does not see it. Where the spectrum is least, the motion ends and noise begins.
    """
    f, power, length = _acceleration_spectrum(q, rate_hz, "blackmanharris")
    resolved = f >= 4 * rate_hz / length
    motion, rest = power[~resolved].sum(), power[resolved & (f < 0.4 * rate_hz)]
    if not len(rest):
        return None
    least = int(np.argmin(rest))
    quiet = np.cumsum(rest[least:]) <= _QUIET * motion
    if quiet.all() or not quiet[0]:
        return None
    return float(f[resolved][least + int(np.argmin(quiet)) - 1])


def torque_edge(tau: Float[Array, " N"], rate_hz: float) -> float:
    """Frequency [Hz] above which ``tau`` carries less than 1 % of its amplitude; half the rate if it always does."""
    f, power, _ = _welch(tau, rate_hz)
    total = power.sum()
    if total == 0:
        return 0.0
    above = np.cumsum(power[::-1])[::-1] / total
    below = np.flatnonzero(above < 1e-4)
    return float(f[below[0]]) if len(below) else 0.5 * rate_hz


def driven_edge(tau: Float[Array, " N"], model: Float[Array, " N"], rate_hz: float, highest_hz: float) -> float:
    """Frequency [Hz] above which the modelled torque of a motion is more than twice as strong as the measured one.

    Followed downwards from ``highest_hz`` in third-octave bins, at least 2 Hz; infinite if it never is at the top.
    """
    f, drive, _ = _welch(tau, rate_hz)
    _, needed, _ = _welch(model, rate_hz)
    edge = np.inf
    top = highest_hz
    while top > 2.0:
        inside = (f > top / 2 ** (1 / 3)) & (f <= top)
        if inside.any() and drive[inside].sum() > _DRIVEN * needed[inside].sum():
            break
        if inside.any():
            edge = top / 2 ** (1 / 3)
        top /= 2 ** (1 / 3)
    return float(edge)
