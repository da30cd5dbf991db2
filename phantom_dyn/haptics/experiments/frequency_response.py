r"""Estimates the frequency response of a device with its coherence, and fits the two-mass model to the response.

The position of a free device drifts, and the spectrum of a drifting signal depends mainly on the difference between its
ends. So spectra are computed from the second difference :math:`y_{k+1} - 2 y_k + y_{k-1}`, which does not drift. At
every frequency the second difference is :math:`-4 \sin^2(\omega T/2)` times the position, without lag; the result is
divided by this factor.

The six parameters of the model are estimated with their covariance. The measured response is compared with that of the
*sampled* model with hold and delay, so that hold and delay do not bias the fit. The weight of a frequency follows from
its coherence. Resonance and anti-resonance and their standard deviations follow from the parameters.

References:
    Section 4.2 of [Gil]_ (`phantom_dyn.haptics.device.axis`): white noise, empirical transfer function, least squares
    of the theoretical transfer function "with six independent variables".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float, ReadOnlyArrays
from phantom_dyn.errors import EstimationError, ParameterError
from phantom_dyn.haptics.device.axis import TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.number_checks import require_columns, require_positive
from phantom_dyn.signals.spectra import cross_density, power_density

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

# Variance of a mean over half-overlapping Hann windows, over the variance for independent windows: neighbours have the
# correlation 1/6.
_OVERLAP = 1.0 + 2.0 / 36.0
# Sum of squared correlations of a spectral line with all lines under a Hann window: 2/3 with the next line on each
# side, 1/6 with the second.
_INFLATION = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)
MOST_COHERENT = 1.0 - 1e-9
"""Upper limit of the coherence: at one, the standard deviation of the response would be zero."""
# Standard normal quantile of a two-sided interval of 95 %.
_QUANTILE_95 = 1.959963984540054


@dataclass(frozen=True)
class FrequencyResponse(ReadOnlyArrays):
    """Measured position over force.

    Attributes:
        period: Sampling period of the recording [s].
        frequency: Frequencies [rad/s], shape ``(k,)``.
        response: Position over force [m/N or rad/(N m)], shape ``(k,)``.
        coherence: Coherence of force and position, 0 to 1, shape ``(k,)``.
        deviation: Standard deviation of the response relative to its size, which is also that of its phase [rad], shape
            ``(k,)``.
        averages: Effective number of independent segments that were averaged.
        inflation: Sum of squared correlations of a line with all lines: the factor by which a fit's covariance exceeds
            that of independent lines. It is 1.94 with the Hann windows of `estimate_frequency_response`, and 1 for
            whole periods of a sweep.
    """

    period: float
    frequency: Float[Array, " k"]
    response: Complex[Array, " k"]
    coherence: Float[Array, " k"]
    deviation: Float[Array, " k"]
    averages: float
    inflation: float = _INFLATION

    @property
    def decibels(self) -> Float[Array, " k"]:
        """Magnitude [dB]."""
        return 20.0 * np.log10(np.abs(self.response))

    @property
    def interval(self) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Limits of the magnitude [dB] at 95 %; the lower limit is minus infinity if it includes zero."""
        reach = _QUANTILE_95 * self.deviation
        with np.errstate(divide="ignore"):
            low, high = (20.0 * np.log10(np.maximum(1.0 + sign * reach, 0.0)) for sign in (-1, 1))
        return self.decibels + low, self.decibels + high

    def between(self, low: float, high: float) -> FrequencyResponse:
        """The response at frequencies from ``low`` to ``high`` [rad/s]."""
        kept = (self.frequency >= low) & (self.frequency <= high)
        arrays = ("frequency", "response", "coherence", "deviation")
        return replace(self, **{name: getattr(self, name)[kept] for name in arrays})


def estimate_frequency_response(
    force: Float[Array, " N"], position: Float[Array, " N"], *, period: float, segment: float
) -> FrequencyResponse:
    """Cross spectrum of force and position over the spectrum of the force, averaged over half-overlapping segments.

    Args:
        force: Force [N or N m], shape ``(N,)``: the force when positions were read (fit it by
            `fit_continuous_two_mass`), or the force from this time on until the next sample (`fit_two_mass`).
        position: Position [m or rad], shape ``(N,)``.
        period: Sampling period [s].
        segment: Length of a segment [s]. Its inverse is the distance between frequencies, so that a segment must be
            several times as long as the slowest vibration takes to decay. More and shorter segments give less scatter.

    Returns:
        Response at the lines from the third one (leakage disturbs the first two) to below the Nyquist frequency.

    Raises:
        ParameterError: If the recording is shorter than two segments, a segment has fewer than 16 samples, or force or
            position is constant or not finite.
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
    second = position[2:] - 2.0 * position[1:-1] + position[:-2]
    if not second.any():
        raise ParameterError("The position never answers the force: record the device while it is free to move.")
    # Both are scaled by their largest value, because squares of very small numbers would be zero.
    largest, strongest = float(np.abs(second).max()), float(np.abs(force).max())
    second, driven = second / largest, force[1:-1] / strongest
    rate = 1.0 / period
    f, drive = power_density(driven, rate, length)
    _, answer = power_density(second, rate, length)
    _, cross = cross_density(driven, second, rate, length)
    inside = slice(3, (length + 1) // 2)
    w = 2 * np.pi * f[inside]
    response = (largest / strongest) * cross[inside] / drive[inside] / (-4.0 * np.sin(0.5 * w * period) ** 2)
    coherence = np.clip(np.abs(cross[inside]) ** 2 / (drive[inside] * answer[inside]), 0.0, MOST_COHERENT)
    segments = (len(driven) - length // 2) // (length - length // 2)
    averages = segments / _OVERLAP if segments > 1 else 1.0
    deviation = np.sqrt((1.0 - coherence) / (2.0 * averages * np.maximum(coherence, math.ulp(1.0))))
    return FrequencyResponse(period, w, response, coherence, deviation, averages)


NAMES = ("motor_mass", "body_mass", "motor_damping", "body_damping", "cable_stiffness", "cable_damping")
"""The six parameters in the order of the arrays, named as the fields of `TwoMassAxis`."""

# Masses and stiffness are fitted as logarithms, and dampings directly, because a damping may be zero.
_IN_LOG = np.array([True, True, False, False, True, False])
# Smallest coherence of a frequency that is used in the first stage of the fit.
_LEAST_COHERENCE = 0.3
# Number of frequencies on either side over which deviations are averaged.
_NEIGHBOURS = 7
# Damping ratios of the cable from which the search starts.
_STARTS = (0.01, 0.05, 0.2)
# Mean square of the residuals in standard deviations above which the model does not fit the data.
_MISFIT = 4.0
# A second mass is certain if both masses and the stiffness are larger than this number of their standard deviations.
_SURE = 3.0


@dataclass(frozen=True)
class TwoMassFit(ReadOnlyArrays):
    """Two-mass model fitted to a measured response.

    Attributes:
        values: The six parameters in the order of `NAMES`, SI units, shape ``(6,)``.
        covariance: Covariance of the parameters, shape ``(6, 6)``.
        response: The measured response.
        model: Response of the fitted model at the same frequencies, shape ``(k,)``.
        misfit: Mean square of the residuals in standard deviations; about one if the model is right.
    """

    values: Float[Array, "6"]
    covariance: Float[Array, "6 6"]
    response: FrequencyResponse
    model: Complex[Array, " k"]
    misfit: float

    @property
    def axis(self) -> TwoMassAxis:
        """The fitted model."""
        return TwoMassAxis(*self.values.tolist())

    @property
    def deviations(self) -> Float[Array, "6"]:
        """Standard deviations of the parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def interval(self) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
        """Limits of the parameters at 95 %; a damping's lower limit may be below zero."""
        reach = _QUANTILE_95 * self.deviations
        return self.values - reach, self.values + reach

    @property
    def resonance(self) -> tuple[float, float]:
        """Free frequency of the two masses on the cable and its standard deviation [rad/s]."""
        motor, body, k = self.values[[0, 1, 4]]
        w = self.axis.free_frequency
        slope = np.zeros(6)
        slope[[0, 1, 4]] = 0.5 / w * np.array([-k / motor**2, -k / body**2, 1 / motor + 1 / body])
        return w, float(np.sqrt(slope @ self.covariance @ slope))

    @property
    def anti_resonance(self) -> tuple[float, float]:
        """Frequency of the body on the cable while the motor is at rest, and its standard deviation [rad/s]."""
        w = self.axis.blocked_frequency
        slope = np.zeros(6)
        slope[[1, 4]] = 0.5 * w * np.array([-1 / self.values[1], 1 / self.values[4]])
        return w, float(np.sqrt(slope @ self.covariance @ slope))


def fit_two_mass(response: FrequencyResponse, *, delay: float = 0.0) -> TwoMassFit:
    """Two-mass model behind a zero-order hold and a known delay, fitted to a response.

    Args:
        response: Response to the force as the computer gives it. It must show anti-resonance and resonance.
        delay: Delay of the loop in addition to the hold [s].

    Raises:
        EstimationError: If the band shows no vibration, or the device has another structure.
    """

    def model(axis: TwoMassAxis, w: Float[Array, " k"]) -> Complex[Array, " k"]:
        return discretise(axis, period=response.period, delay=delay).response(w)

    return _fit(response, model)


def fit_continuous_two_mass(response: FrequencyResponse) -> TwoMassFit:
    """Two-mass model in continuous time, without hold and delay, fitted to a response.

    Args:
        response: Response to the force that acted when positions were read.
    """
    return _fit(response, lambda axis, w: axis.transfer_function.response(w))


def _fit(response: FrequencyResponse, model: Callable[[TwoMassAxis, Array], Array]) -> TwoMassFit:
    """Two-mass model fitted to a response; ``model`` computes the response of an axis at frequencies [rad/s]."""
    # Imported here: scipy.optimize takes longer to import than the rest of haptics.
    from scipy.optimize import least_squares

    good = response.coherence >= _LEAST_COHERENCE
    if good.sum() < 2 * len(NAMES):
        raise EstimationError(
            f"Force and position agree at {int(good.sum())} frequencies only: drive the motor with more white noise, "
            "or take shorter segments."
        )
    w, measured = response.frequency, response.response
    weight = 1.0 / response.deviation[good]
    # Deviations that are estimated from few data vary by chance, so that neighbours are averaged.
    error = np.sqrt(_running_mean((response.deviation * np.abs(measured)) ** 2))
    lower = np.where(_IN_LOG, -np.inf, 0.0)

    def axis_of(x: Array, unit: Array) -> TwoMassAxis:
        return TwoMassAxis(*np.where(_IN_LOG, np.exp(np.where(_IN_LOG, x, 0.0)), x * unit).tolist())

    def search(start: Array) -> tuple[OptimizeResult, Array]:
        """Result of the search from one start, with logarithms and with dampings over a unit, and this unit."""
        unit = np.where(_IN_LOG, 1.0, start)

        def by_ratio(x: Array) -> Array:
            ratio = np.log(measured[good] / model(axis_of(x, unit), w[good]))
            return np.concatenate([np.real(ratio) * weight, np.imag(ratio) * weight])

        def by_difference(x: Array) -> Array:
            difference = (measured - model(axis_of(x, unit), w)) / error
            return np.concatenate([np.real(difference), np.imag(difference)])

        # The first fit, of ratios, converges from a poor start. The second fit, of differences, has no bias, because
        # their errors do not depend on the measured value.
        x = np.where(_IN_LOG, np.log(start), 1.0)
        near = least_squares(by_ratio, x, bounds=(lower, np.inf), loss="soft_l1", f_scale=3.0, max_nfev=60)
        return least_squares(by_difference, near.x, bounds=(lower, np.inf), max_nfev=100), unit

    tried: list[tuple[OptimizeResult, Array]] = []
    for damping in _STARTS:
        tried.append(search(_start(response, good, damping)))
        if tried[-1][0].cost < _MISFIT * len(w):
            break
    best, unit = min(tried, key=lambda one: one[0].cost)
    axis = axis_of(best.x, unit)
    misfit = 2.0 * best.cost / (2 * len(w) - len(NAMES))
    if misfit > _MISFIT:
        raise EstimationError(
            f"No two-mass model fits the response: the residuals are {math.sqrt(misfit):.1f} standard deviations. Look "
            "at the response: it must show one anti-resonance and one resonance, and segments must be longer than the "
            "vibration lasts."
        )
    values = np.array([getattr(axis, name) for name in NAMES])
    slope = np.where(_IN_LOG, values, unit)
    information = best.jac.T @ best.jac / response.inflation
    covariance = slope[:, None] * np.linalg.pinv(information, rcond=1e-14, hermitian=True) * slope
    covariance = max(misfit, 1.0) * covariance
    unsure = np.sqrt(np.diag(covariance)[_IN_LOG]) > values[_IN_LOG] / _SURE
    if np.any(unsure) or axis.free_frequency > w[-1]:
        raise EstimationError(
            "The response cannot distinguish a vibration from none: the best resonance is "
            f"{axis.free_frequency:.3g} rad/s, the band ends at {w[-1]:.3g} rad/s. The device is rigid, or "
            "the band does not contain its vibration."
        )
    return TwoMassFit(values, covariance, response, model(axis, w), misfit)


def _running_mean(values: Array) -> Array:
    """Mean of each value and its `_NEIGHBOURS` on either side; beyond the ends the values are mirrored."""
    padded = np.pad(values, _NEIGHBOURS, mode="reflect")
    return np.convolve(padded, np.full(2 * _NEIGHBOURS + 1, 1.0 / (2 * _NEIGHBOURS + 1)), mode="valid")


def _start(response: FrequencyResponse, good: Array, damping: float) -> Float[Array, "6"]:
    """First guess of the parameters, from the mass at low frequency and the dip and peak of acceleration over force."""
    w = response.frequency[good]
    size = np.abs(response.response[good]) * w**2
    smooth = np.exp(np.convolve(np.pad(np.log(size), 2, mode="edge"), np.ones(5) / 5, mode="valid"))
    # The peak is the point that is highest relative to the lowest point before it.
    drop = np.log(smooth) - np.minimum.accumulate(np.log(smooth))
    top = int(np.argmax(drop))
    dip = int(np.argmin(smooth[: top + 1]))
    if top == 0 or dip == 0:
        raise EstimationError(
            f"The response shows no resonance after an anti-resonance between {w[0]:.3g} and {w[-1]:.3g} rad/s: "
            "the device is rigid, or the band does not contain its vibration."
        )
    total = 1.0 / float(np.median(size[: max(dip // 2, 1)]))
    motor = total * min((w[dip] / w[top]) ** 2, 0.9)
    body = total - motor
    stiffness = w[dip] ** 2 * body
    reduced = motor * body / total
    to_ground = 0.1 * total * w[0]
    return np.array([motor, body, to_ground, to_ground, stiffness, 2.0 * damping * reduced * w[top]])
