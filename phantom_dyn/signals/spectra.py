"""Power density of sampled signals by Welch's method: the mean spectrum of segments that overlap by one half.

`scipy.signal` has the same function, and tests compare with it. It is not used here: its import loads all of
`scipy.stats` and takes half a second, as long as all other imports of a command. Source: Welch, IEEE Transactions on
Audio and Electroacoustics 15 (1967) 70-73.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from phantom_dyn.array_types import Array, Float

Window = Literal["hann", "blackman", "blackmanharris"]

_COSINES: dict[Window, tuple[float, ...]] = {
    "hann": (0.5, 0.5),
    "blackman": (0.42, 0.5, 0.08),
    "blackmanharris": (0.35875, 0.48829, 0.14128, 0.01168),
}
_BLOCK = 1 << 18  # samples that are transformed together, 2 MB


def power_density(
    x: Array, rate_hz: float, length: int, *, window: Window = "hann", linear: bool = False
) -> tuple[Float[Array, " F"], Array]:
    """Frequencies [Hz] and one-sided power density [unit^2/Hz] of a series, or of each column.

    Args:
        x: Samples at a uniform rate, shape ``(N,)`` or ``(N, k)``.
        rate_hz: Samples per second.
        length: Samples of a segment.
        window: Window function of each segment.
        linear: True to subtract a straight line from each segment instead of its mean.

    Returns:
        Frequencies, shape ``(F,)`` with ``F = length // 2 + 1``, and densities, shape ``(F,)`` or ``(F, k)``.
    """
    columns = x.reshape(len(x), -1)
    densities = [np.real(_density(column, column, rate_hz, length, window, linear)) for column in columns.T]
    return np.fft.rfftfreq(length, 1 / rate_hz), np.stack(densities, axis=-1).reshape(-1, *x.shape[1:])


def cross_density(
    x: Float[Array, " N"], y: Float[Array, " N"], rate_hz: float, length: int
) -> tuple[Float[Array, " F"], Float[Array, " F"]]:
    """Frequencies [Hz] and complex one-sided cross power density of two series; arguments as in `power_density`."""
    return np.fft.rfftfreq(length, 1 / rate_hz), _density(x, y, rate_hz, length, "hann", False)


def _density(x: Array, y: Array, rate_hz: float, length: int, window: Window, linear: bool) -> Array:
    """Complex one-sided cross power density of two series."""
    shape = _window(window, length)
    total, segments = np.zeros(length // 2 + 1, dtype=complex), 0
    for of_x, of_y in zip(_pieces(x, length), _pieces(y, length), strict=True):
        total += np.sum(_transformed(of_x, shape, linear).conj() * _transformed(of_y, shape, linear), axis=0)
        segments += len(of_x)
    density = total / (segments * rate_hz * np.sum(shape**2))
    # One-sided: the power of negative frequencies is added to that of positive ones, except at 0 and half the rate.
    density[1 : (length + 1) // 2] *= 2
    return density


def _pieces(x: Float[Array, " N"], length: int) -> Iterator[Float[Array, "s length"]]:
    """Half-overlapping segments of a series, some at a time."""
    segments = sliding_window_view(x, length)[:: length - length // 2]
    count = max(_BLOCK // length, 1)
    for start in range(0, len(segments), count):
        yield segments[start : start + count]


def _transformed(segments: Float[Array, "s length"], shape: Float[Array, " length"], linear: bool) -> Array:
    """Fourier transforms of windowed segments without their means or, if ``linear``, their straight lines."""
    centred = segments - segments.mean(axis=1, keepdims=True)
    if linear:
        line = np.arange(len(shape)) - 0.5 * (len(shape) - 1)
        centred -= np.outer(centred @ line / max(line @ line, 1.0), line)
    return np.fft.rfft(centred * shape, axis=1)


def _window(name: Window, length: int) -> Float[Array, " length"]:
    """A window of cosines, periodic: the sample after the last one would equal the first."""
    phase = 2 * np.pi * np.arange(length) / length
    return np.sum([(-1) ** k * a * np.cos(k * phase) for k, a in enumerate(_COSINES[name])], axis=0)
