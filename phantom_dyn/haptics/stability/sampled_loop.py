r"""Finds the gains for which a loop of a sampled device P and digital filters is stable.

The force is :math:`u = -(g\,S(z) + F(z))\,y` with a filter S, whose gain g is searched, and a fixed filter F. The loop
is at the limit of stability where :math:`g(\omega) = -(1/P + F)/S` is real and positive. The spectral radius of the
closed loop shows on which side of such a gain the loop is stable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from scipy.linalg import block_diag
from scipy.signal import tf2ss

from phantom_dyn.array_types import Array, Complex, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.discretisation import SampledAxis
from phantom_dyn.haptics.device.frequency_kernels import frequency_grid

# Tolerance of the spectral radius: a free device has an eigenvalue of one, which rounding changes by some 1e-9.
_MARGINAL = 1e-7
# Bisection steps in an interval of the grid; the frequency of a crossing is then exact to the last bits.
_HALVINGS = 50


@dataclass(frozen=True)
class DigitalFilter(ReadOnlyArrays):
    """Rational filter in powers of 1/z, as in `scipy.signal.lfilter`.

    Attributes:
        numerator: Coefficients of 1, 1/z, ..., shape ``(m,)``.
        denominator: Coefficients of 1, 1/z, ..., the first not zero, shape ``(n,)``.
    """

    numerator: Float[Array, " m"]
    denominator: Float[Array, " n"]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("numerator", "denominator"):
            values = getattr(self, name)
            if not (len(values) and np.isfinite(values).all()):
                raise ParameterError(f"The {name} of the filter is {values.tolist()}: give finite coefficients.")
        if self.denominator[0] == 0:
            raise ParameterError("The denominator of the filter starts with 0: give one that does not.")

    def response(self, frequency: Float[Array, " k"], period: float) -> Complex[Array, " k"]:
        """Output over input at the frequencies [rad/s], sampled every `period` [s], shape ``(k,)``."""
        back = np.exp(-1j * frequency * period)
        return np.polyval(self.numerator[::-1], back) / np.polyval(self.denominator[::-1], back)

    def matrices(self) -> tuple[Array, Array, Array, float]:
        """State space ``x[k+1] = A x[k] + B u[k]``, ``y[k] = C x[k] + D u[k]``."""
        size = max(len(self.numerator), len(self.denominator))
        b, a = np.zeros(size), np.zeros(size)
        b[: len(self.numerator)], a[: len(self.denominator)] = self.numerator, self.denominator
        if size == 1:
            return np.zeros((0, 0)), np.zeros(0), np.zeros(0), float(b[0] / a[0])
        A, B, C, D = tf2ss(b, a)
        return A, B[:, 0], C[0], float(D[0, 0])


UNFILTERED = DigitalFilter(np.ones(1), np.ones(1))
"""Filter whose output is its input."""
NOTHING = DigitalFilter(np.zeros(1), np.ones(1))
"""Filter whose output is zero."""


@dataclass(frozen=True)
class SampledLoop:
    """Device and digital controller ``u = -(g scaled + fixed) y``.

    Attributes:
        plants: The sampled device, or several devices under one force whose positions are added.
        scaled: Filter whose gain is searched.
        fixed: Filter in parallel with ``scaled``.

    Raises:
        ParameterError: If there is no device, or devices differ in period or delay.
    """

    plants: tuple[SampledAxis, ...]
    scaled: DigitalFilter = UNFILTERED
    fixed: DigitalFilter = NOTHING

    def __post_init__(self) -> None:
        if not self.plants:
            raise ParameterError("The loop has no device: give at least one.")
        for other in self.plants[1:]:
            if (other.period, other.delay) != (self.period, self.plants[0].delay):
                raise ParameterError(
                    f"Devices sampled every {self.period:g} s and {other.period:g} s with delays of "
                    f"{self.plants[0].delay:g} s and {other.delay:g} s: give all the same period and delay."
                )

    @property
    def period(self) -> float:
        """Sampling period [s]."""
        return self.plants[0].period

    def gain_on_unit_circle(self, frequency: Float[Array, " k"]) -> Complex[Array, " k"]:
        """Complex gain g at which the loop has the root ``exp(j w T)``, at each frequency w [rad/s].

        Only a real positive gain is possible; at such a gain the loop is at its limit of stability.
        """
        response = sum(plant.response(frequency) for plant in self.plants)
        held = 1.0 / response + self.fixed.response(frequency, self.period)
        with np.errstate(divide="ignore", invalid="ignore"):
            return -held / self.scaled.response(frequency, self.period)

    @cached_property
    def plant(self) -> SampledAxis:
        """All devices as one system."""
        return reduce(_in_parallel, self.plants)

    @cached_property
    def _parts(self) -> tuple[tuple[Array, Array, Array, float], tuple[Array, Array, Array, float]]:
        return self.scaled.matrices(), self.fixed.matrices()

    def closed_loop(self, gain: float) -> Float[Array, "m m"]:
        """Transition matrix of states of the devices, past forces, and states of both filters."""
        scaled, fixed = self._parts
        return self.plant.closed_by(
            (
                np.asarray(block_diag(scaled[0], fixed[0])),
                np.concatenate([scaled[1], fixed[1]]),
                np.concatenate([gain * scaled[2], fixed[2]]),
                gain * scaled[3] + fixed[3],
            )
        )

    def spectral_radius(self, gain: float) -> float:
        """Largest absolute eigenvalue of the closed loop: stable below one."""
        return float(np.abs(np.linalg.eigvals(self.closed_loop(gain))).max())

    def is_stable(self, gain: float) -> bool:
        """True if no motion grows; the position of a free device may be constant."""
        return self.spectral_radius(gain) < 1.0 + _MARGINAL


@dataclass(frozen=True)
class CriticalGain:
    """Gain up to which a loop is stable.

    Attributes:
        gain: Upper end of the range of stable gains that starts at 0; 0 if the smallest gain is unstable, infinite if
            every gain is stable.
        frequency: Frequency of the oscillation at this gain [rad/s]; NaN if the gain is 0 or infinite.
    """

    gain: float
    frequency: float


def critical_gain(loop: SampledLoop, *, lowest: float = 1e-2) -> CriticalGain:
    """Largest gain up to which a loop is stable, from all gains at the limit and the spectral radius between them.

    Args:
        loop: Device and controller.
        lowest: Lowest frequency of the search for crossings [rad/s].

    Raises:
        ParameterError: If the lowest frequency is not between 0 and half the sampling frequency.
    """
    period = loop.period
    if not 0 < lowest < math.pi / period:
        raise ParameterError(
            f"The lowest frequency is {lowest} rad/s: give one above 0 and below {math.pi / period:g} rad/s."
        )
    filter_delay = max(len(loop.scaled.numerator), len(loop.fixed.numerator), 1) - 1
    modes = np.concatenate([_modes(plant) for plant in loop.plants])
    grid = frequency_grid(lowest, period, loop.plants[0].delay + filter_delay * period, modes)
    gains = loop.gain_on_unit_circle(grid)

    changes = np.flatnonzero(np.diff(np.signbit(np.imag(gains))))
    where = _roots(loop, grid[changes], grid[changes + 1])
    ends = np.append(where, math.pi / period)
    at_ends = loop.gain_on_unit_circle(ends)
    # At a zero of the filter the gain changes its sign through infinity, which is not a crossing.
    near = np.append(np.abs(at_ends[:-1]) < 1e3 * (np.abs(gains[changes]) + np.abs(gains[changes + 1])), True)
    found = zip(np.real(at_ends)[near], ends[near], strict=True)
    crossing = np.array(sorted(pair for pair in found if np.isfinite(pair[0]) and pair[0] > 0)).reshape(-1, 2)
    between = _between(crossing[:, 0])
    stable = np.array([loop.is_stable(gain) for gain in between])
    unstable = np.flatnonzero(~stable)
    end, frequency = math.inf, math.nan
    if len(unstable) and unstable[0] == 0:
        end = 0.0
    elif len(unstable):
        end, frequency = map(float, crossing[unstable[0] - 1])
    return CriticalGain(end, frequency)


def _roots(loop: SampledLoop, low: Float[Array, " n"], high: Float[Array, " n"]) -> Float[Array, " n"]:
    """Frequencies between ``low`` and ``high`` at which the gain is real, by bisection of all intervals at once."""
    below = np.signbit(np.imag(loop.gain_on_unit_circle(low)))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        same = np.signbit(np.imag(loop.gain_on_unit_circle(middle))) == below
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)


def _in_parallel(first: SampledAxis, second: SampledAxis) -> SampledAxis:
    return replace(
        first,
        transition=block_diag(first.transition, second.transition),
        newer=np.concatenate([first.newer, second.newer]),
        older=np.concatenate([first.older, second.older]),
        output=np.concatenate([first.output, second.output]),
        direct_now=first.direct_now + second.direct_now,
        direct_before=first.direct_before + second.direct_before,
    )


def _modes(plant: SampledAxis) -> Float[Array, "m 2"]:
    """Frequency and half width [rad/s] of the oscillating poles and zeros of a device."""
    # The zeros are roots of the numerator for the newer force, a polynomial in z - 1.
    *_, of_newer, _ = plant.loop
    roots = np.concatenate([np.linalg.eigvals(plant.transition), 1.0 + np.roots(of_newer)])
    s = np.log(roots[np.abs(roots) > 1e-12].astype(complex)) / plant.period
    s = s[s.imag > 0]
    return np.column_stack([s.imag, np.maximum(np.abs(s.real), 1e-6 * s.imag)]).astype(float)


def _between(gains: Float[Array, " c"]) -> Float[Array, " d"]:
    """One gain in each interval between increasing gains: below the first, between two, above the last."""
    if not len(gains):
        return np.ones(1)
    inner = np.sqrt(gains[1:] * gains[:-1])
    return np.concatenate([gains[:1] / 2, inner, gains[-1:] * 2])
