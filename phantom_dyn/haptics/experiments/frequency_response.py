r"""Empirical transfer function of a device, with its coherence and confidence.

The position of a device that floats freely wanders, and a spectrum of what wanders is a spectrum of its ends. So
spectra are those of the second difference :math:`y_{k+1} - 2 y_k + y_{k-1}`, which does not; it is
:math:`-4 \sin^2(\omega T/2)` times the position at every frequency, without lag, and that is divided out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.number_checks import require_columns, require_positive
from phantom_dyn.motion import read_only
from phantom_dyn.signals.spectra import cross_density, power_density

_OVERLAP = 1.0 + 2.0 / 36.0
"""Loss of independence of Hann windows at half overlap: correlation of neighbouring segments, 1/6, enters squared."""
_SHARED = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)
"""Data that neighbouring frequencies share through the Hann window: correlation 2/3 and 1/6, squared."""
_MOST_COHERENT = 1.0 - 1e-9
"""Coherence is kept off one, where the deviations would vanish."""
_QUANTILE_95 = 1.959963984540054
"""Standard normal quantile of a two-sided interval of 95 %."""


@dataclass(frozen=True)
class FrequencyResponse:
    """Position over force, as measured.

    Attributes:
        period: Sampling period of the recording [s].
        frequency: [rad/s], shape ``(k,)``.
        response: Position over force [m/N or rad/(N m)], shape ``(k,)``.
        coherence: Between force and position, 0 to 1, shape ``(k,)``.
        deviation: One standard deviation of the response relative to its size, which is also that of its phase [rad],
            shape ``(k,)``.
        averages: Independent segments that the estimate rests on.
        shared: How often neighbouring frequencies count the same data: 1.94 with the Hann windows of
            `estimate_frequency_response`, 1 for whole periods of a sweep.
    """

    period: float
    frequency: Float[Array, " k"]
    response: Complex[Array, " k"]
    coherence: Float[Array, " k"]
    deviation: Float[Array, " k"]
    averages: float
    shared: float = _SHARED

    def __post_init__(self):
        for name in ("frequency", "coherence", "deviation"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "response", read_only(self.response, complex))

    @property
    def decibels(self) -> Float[Array, " k"]:
        """Magnitude [dB]."""
        return 20.0 * np.log10(np.abs(self.response))

    @property
    def interval(self) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Limits of the magnitude [dB] at 95 %; the lower one is minus infinity where it reaches zero."""
        reach = _QUANTILE_95 * self.deviation
        with np.errstate(divide="ignore"):
            low, high = (20.0 * np.log10(np.maximum(1.0 + sign * reach, 0.0)) for sign in (-1, 1))
        return self.decibels + low, self.decibels + high

    def between(self, low: float, high: float) -> FrequencyResponse:
        """Only the frequencies from ``low`` to ``high`` [rad/s]."""
        kept = (self.frequency >= low) & (self.frequency <= high)
        w, response, coherence, deviation = (
            part[kept] for part in (self.frequency, self.response, self.coherence, self.deviation)
        )
        return FrequencyResponse(self.period, w, response, coherence, deviation, self.averages, self.shared)


def estimate_frequency_response(
    force: Float[Array, " N"], position: Float[Array, " N"], *, period: float, segment: float
) -> FrequencyResponse:
    """Cross spectrum of force and position over the spectrum of the force, averaged over half-overlapping segments.

    Args:
        force: [N or N m], at the instants of the positions, or held from them on: whichever, the model must say so.
        position: [m or rad].
        period: Sampling period [s].
        segment: Length of a segment [s]: the frequencies are one over it apart, so it must be several times the decay
            of the slowest vibration; more and shorter segments give less scatter.

    Returns:
        Frequencies from the third line on (force and leakage share the first two) to under the Nyquist frequency.

    Raises:
        ParameterError: If the recording is shorter than two segments, a segment is under 16 samples, force or position
            are constant, or hold what is no number.
    """
    require_positive(period=period, segment=segment)
    length = round(min(segment / period, 1e9))
    if len(force) != len(position) or length < 16 or len(force) < 2 * length + 2:
        raise ParameterError(
            f"{len(force)} forces and {len(position)} positions were given for segments of {length} samples: "
            "give as many of both, at least two segments of at least 16 samples."
        )
    require_columns(len(force), force=force, position=position)
    if np.ptp(force) == 0:
        raise ParameterError("The force never changes: record the device while its motor is driven by white noise.")
    bent = position[2:] - 2.0 * position[1:-1] + position[:-2]
    if not bent.any():
        raise ParameterError("The position never answers the force: record the device while it is free to move.")
    # Both over their largest value: squares of very small numbers would be zero.
    largest, strongest = float(np.abs(bent).max()), float(np.abs(force).max())
    bent, driven = bent / largest, force[1:-1] / strongest
    rate = 1.0 / period
    f, drive = power_density(driven, rate, length)
    _, answer = power_density(bent, rate, length)
    _, cross = cross_density(driven, bent, rate, length)
    inside = slice(3, (length + 1) // 2)
    w = 2 * np.pi * f[inside]
    response = (largest / strongest) * cross[inside] / drive[inside] / (-4.0 * np.sin(0.5 * w * period) ** 2)
    coherence = np.clip(np.abs(cross[inside]) ** 2 / (drive[inside] * answer[inside]), 0.0, _MOST_COHERENT)
    segments = (len(driven) - length // 2) // (length - length // 2)
    averages = segments / _OVERLAP if segments > 1 else 1.0
    deviation = np.sqrt((1.0 - coherence) / (2.0 * averages * np.maximum(coherence, math.ulp(1.0))))
    return FrequencyResponse(period, w, response, coherence, deviation, averages)
