r"""Largest stable stiffness of a virtual wall: gain margins of a sampled loop, exact and by the linear condition.

The loop has a device G, a hold H, a delay :math:`t_d` and a virtual wall :math:`C(z) = K + B (z - 1)/(T z)`:

.. math:: 1 + K\,Z[H(s) G(s) e^{-t_d s}] = 0 \quad (20), \qquad K_{CR} = Gm\{Z[H(s) G(s) e^{-t_d s}]\} \quad (21)

The gain margin is that of the crossing with the lowest gain. Every crossing of the negative real axis is found, because
a vibration causes several, and eigenvalues check the result. With virtual damping, the loop is closed by B first, and
the crossings are those of this loop.

References:
    Equation numbers are those of the chapter, [Gil]_ in `phantom_dyn.haptics.device.axis`. The available copy lacks
    (10), the linear condition :math:`K < (b + B)/(T/2 + t_d)`. It is derived here, and a test compares it with the
    exact limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.discretisation import SampledAxis, discretise, split_delay
from phantom_dyn.haptics.device.frequency_kernels import (
    MapDevices,
    MapSettings,
    crossings,
    frequency_grid,
    map_lowest_gain,
)
from phantom_dyn.haptics.device.transfer_function import Axis
from phantom_dyn.number_checks import require_numbers

Values = Sequence[float] | Float[Array, " _"]
# Lowest frequency of the search, over the lowest corner frequency of the loop.
_LOWEST = 0.03
# Relative difference from the gain of a crossing at which stability is checked, on both sides.
_BESIDE = 1e-3
# Roots and real parts below this share of the largest root count as zero.
_ZERO = 1e-9


@dataclass(frozen=True)
class Crossing:
    """A frequency at which the open loop is real and negative.

    Attributes:
        frequency: Frequency [rad/s].
        gain: Virtual stiffness at which the loop oscillates at this frequency [N/m or N m/rad].
    """

    frequency: float
    gain: float

    @property
    def decibels(self) -> float:
        """Gain margin at this crossing [dB]."""
        return 20.0 * math.log10(self.gain)


@dataclass(frozen=True)
class CriticalStiffness:
    """The virtual stiffness up to which a loop is stable.

    Attributes:
        stiffness: Critical stiffness [N/m or N m/rad]; 0 if no wall is stable, infinite if every wall is.
        frequency: Frequency of the oscillation at this stiffness [rad/s]; NaN if there is none.
        crossings: All crossings in the order of their frequencies; the last one may be at the Nyquist frequency.
        radius_below: Spectral radius at 0.1 % less than the critical stiffness. If the critical stiffness is 0 or
            infinite, the radius for some other stiffness.
        radius_above: Spectral radius at 0.1 % more than the critical stiffness, or as ``radius_below``.
    """

    stiffness: float
    frequency: float
    crossings: tuple[Crossing, ...]
    radius_below: float
    radius_above: float

    @property
    def decibels(self) -> float:
        """Gain margin [dB]."""
        return 20.0 * math.log10(self.stiffness) if self.stiffness > 0 else -math.inf

    @property
    def verified(self) -> bool:
        """True if the eigenvalues confirm that the loop is stable below the critical stiffness and unstable above."""
        if self.stiffness == 0:
            return self.radius_below > 1
        return self.radius_below < 1 and (math.isinf(self.stiffness) or self.radius_above > 1)


@dataclass(frozen=True)
class LoopBode(ReadOnlyArrays):
    """Sampled open loop for a Bode diagram, with its margins.

    Attributes:
        frequency: Frequencies up to the Nyquist frequency [rad/s], shape ``(k,)``.
        response: Position over force, ``Z[H G e^{-td s}]``, shape ``(k,)``.
        margin: Critical stiffness and all crossings.
        linear: Critical stiffness by the linear condition; NaN unless the axis consists of masses and dampers.
    """

    frequency: Float[Array, " k"]
    response: Complex[Array, " k"]
    margin: CriticalStiffness
    linear: float

    @property
    def decibels(self) -> Float[Array, " k"]:
        """Magnitude [dB]."""
        return 20.0 * np.log10(np.abs(self.response))

    @property
    def phase(self) -> Float[Array, " k"]:
        """Unwrapped phase [rad], from -pi or -pi/2 at low frequency downwards."""
        phase = np.unwrap(np.angle(self.response))
        return phase - 2 * np.pi * np.round((phase[0] + 0.75 * np.pi) / (2 * np.pi))


@dataclass(frozen=True)
class StabilityMap(ReadOnlyArrays):
    """Critical stiffness on a grid; the axes of each array are the first four fields.

    Attributes:
        damping: Damping added to that of the motor [N s/m or N m s/rad], shape ``(i,)``.
        virtual_damping: Virtual damping of the wall [N s/m or N m s/rad], shape ``(j,)``.
        delay: Delay in addition to the hold [s], shape ``(k,)``.
        period: Sampling period [s], shape ``(m,)``.
        stiffness: Critical stiffness [N/m or N m/rad]; 0 if no wall is stable.
        frequency: Frequency of the oscillation at the limit [rad/s]; NaN if no wall is stable.
        linear: Critical stiffness by the linear condition (10).
    """

    damping: Float[Array, " i"]
    virtual_damping: Float[Array, " j"]
    delay: Float[Array, " k"]
    period: Float[Array, " m"]
    stiffness: Float[Array, "i j k m"]
    frequency: Float[Array, "i j k m"]
    linear: Float[Array, "i j k m"]

    @property
    def ratio(self) -> Float[Array, "i j k m"]:
        """Exact critical stiffness over that of the linear condition; NaN if that is not positive."""
        out = np.full(self.stiffness.shape, np.nan)
        return np.divide(self.stiffness, self.linear, out=out, where=self.linear > 0)


def critical_stiffness(
    axis: Axis, *, period: float, delay: float = 0.0, virtual_damping: float = 0.0
) -> CriticalStiffness:
    """Critical stiffness of a virtual wall, (21): all softer walls are stable.

    Args:
        axis: A model of `phantom_dyn.haptics.device.axis`, or a transfer function.
        period: Sampling period T [s].
        delay: Delay of the loop in addition to the hold [s], 0 or more.
        virtual_damping: B of the wall, on the backward difference of the position [N s/m or N m s/rad].

    Raises:
        ParameterError: If the period is not positive, the delay negative, or the virtual damping not finite.
    """
    sampled = discretise(axis, period=period, delay=delay)
    rate = virtual_damping / period
    grid = search_grid(axis, period, delay, virtual_damping)
    found = crossings(grid, period, sampled.loop, (1.0, 0.0), (rate, -rate))
    positive = tuple(Crossing(float(w), float(gain)) for w, gain in found if gain > 0)
    lowest = min(positive, key=lambda crossing: crossing.gain, default=None)
    if lowest is None:
        # Without a crossing, either all walls are stable or none, so that it is enough to check one.
        radius = sampled.spectral_radius(float(np.abs(found[:, 1]).min()), virtual_damping)
        return CriticalStiffness(math.inf if radius < 1 else 0.0, math.nan, (), radius, radius)
    below = sampled.spectral_radius((1 - _BESIDE) * lowest.gain, virtual_damping)
    above = sampled.spectral_radius((1 + _BESIDE) * lowest.gain, virtual_damping)
    if below >= 1:
        return CriticalStiffness(0.0, math.nan, positive, below, below)
    return CriticalStiffness(lowest.gain, lowest.frequency, positive, below, above)


def linear_stiffness(damping: float, *, period: float, delay: float = 0.0, virtual_damping: float = 0.0) -> float:
    r"""Critical stiffness by the linear condition (10), :math:`(b + B)/(T/2 + t_d)`.

    It is valid for a rigid device whose dampings are much smaller than its mass divided by the period.

    Args:
        damping: b, the sum of the device's dampings to ground [N s/m or N m s/rad].
        period: Sampling period T [s].
        delay: Delay of the loop in addition to the hold [s].
        virtual_damping: B of the wall [N s/m or N m s/rad].

    Raises:
        ParameterError: If the period is not positive, the delay is negative, or a damping is not finite.
    """
    split_delay(period, delay)
    require_numbers(damping=damping, virtual_damping=virtual_damping)
    return (damping + virtual_damping) / (0.5 * period + delay)


def linear_ratio(
    axis: RigidAxis | TwoMassAxis, *, period: float, delay: float = 0.0, virtual_damping: float = 0.0
) -> float:
    """Exact critical stiffness divided by that of the linear condition for a rigid device.

    NaN if the linear condition does not give a positive stiffness.
    """
    exact = critical_stiffness(axis, period=period, delay=delay, virtual_damping=virtual_damping).stiffness
    linear = linear_stiffness(axis.rigid.damping, period=period, delay=delay, virtual_damping=virtual_damping)
    return exact / linear if linear > 0 else math.nan


def loop_bode(axis: Axis, *, period: float, delay: float = 0.0) -> LoopBode:
    """Sampled open loop of an axis with its margins, from far below its crossings to the Nyquist frequency."""
    sampled: SampledAxis = discretise(axis, period=period, delay=delay)
    frequency = search_grid(axis, period, delay, 0.0)
    response = sampled.response(frequency)
    linear = math.nan
    if isinstance(axis, RigidAxis | TwoMassAxis):
        linear = linear_stiffness(axis.rigid.damping, period=period, delay=delay)
    return LoopBode(frequency, response, critical_stiffness(axis, period=period, delay=delay), linear)


def stability_map(
    axis: RigidAxis | TwoMassAxis,
    *,
    period: Values,
    delay: Values = (0.0,),
    damping: Values = (0.0,),
    virtual_damping: Values = (0.0,),
) -> StabilityMap:
    """Critical stiffness for every combination of values, each as exact as `critical_stiffness`.

    Args:
        axis: Model of the device.
        period: Sampling periods [s].
        delay: Delays of the loop in addition to the hold [s].
        damping: Dampings added to that of the motor [N s/m or N m s/rad].
        virtual_damping: Virtual dampings of the wall, on the backward difference of the position.

    Raises:
        ParameterError: If a sequence is empty, a period is not positive, a delay or damping is negative, or a number is
            not finite.
    """
    values = {"period": period, "delay": delay, "damping": damping, "virtual_damping": virtual_damping}
    for name, given in values.items():
        if np.ndim(given) != 1 or len(given) == 0:
            raise ParameterError(f"The {name} of the map is {given}: give a sequence of at least one number.")
    added, virtual, delays, periods = (
        np.array(values[name], dtype=float) for name in ("damping", "virtual_damping", "delay", "period")
    )
    devices = [axis.damped(float(extra)) for extra in added]
    splits = [[split_delay(float(T), float(late)) for T in periods] for late in delays]
    steps = np.array([[whole for whole, _ in row] for row in splits], dtype=np.int64)
    rest = np.array([[part for _, part in row] for row in splits])
    low, linear = (np.empty((len(added), len(virtual), len(delays), len(periods))) for _ in range(2))
    found = [roots_of_modes(device) for device in devices]
    for (i, j, k, m), _ in np.ndenumerate(low):
        T, late, B = float(periods[m]), float(delays[k]), float(virtual[j])
        low[i, j, k, m] = lowest_frequency(devices[i], found[i][1], T, late, B)
        linear[i, j, k, m] = linear_stiffness(devices[i].rigid.damping, period=T, delay=late, virtual_damping=B)
    stiffness, frequency = np.empty_like(low), np.empty_like(low)
    systems = [device.state_space for device in devices]
    A = np.stack([system.A for system in systems])
    modes = _same_length([modes for modes, _ in found])
    settings = MapSettings(periods, virtual, steps, rest, low)
    map_lowest_gain(MapDevices(A, systems[0].B, systems[0].C, modes), settings, stiffness, frequency)
    return StabilityMap(added, virtual, delays, periods, stiffness, frequency, linear)


def search_grid(axis: Axis, period: float, delay: float, virtual_damping: float) -> Float[Array, " k"]:
    """Frequencies [rad/s] that are dense enough to find all crossings, shape ``(k,)``."""
    modes, corner = roots_of_modes(axis)
    return frequency_grid(lowest_frequency(axis, corner, period, delay, virtual_damping), period, delay, modes)


def lowest_frequency(axis: Axis, corner: float, period: float, delay: float, virtual_damping: float) -> float:
    """Frequency [rad/s] far below every crossing; ``corner`` is the lowest corner frequency of the axis [rad/s]."""
    require_numbers(virtual_damping=virtual_damping)
    function = axis.transfer_function
    damper = abs(virtual_damping) * abs(function.numerator[-1])
    inertia = np.abs(function.denominator[:-2]).max() if len(function.denominator) > 2 else 0.0
    # A virtual damper adds a corner frequency of B over the mass; the largest mass has the lowest frequency.
    virtual = damper / inertia if damper > 0 and inertia > 0 else math.inf
    return _LOWEST * min(corner, virtual, 1.0 / (0.5 * period + delay))


def roots_of_modes(axis: Axis) -> tuple[Float[Array, "m 2"], float]:
    """Frequency and half width of each resonance and anti-resonance, and the lowest corner frequency [rad/s]."""
    function = axis.transfer_function
    roots = np.concatenate([function.poles, function.zeros])
    size = np.abs(roots)
    largest = float(size.max()) if len(size) else 0.0
    corners = size[size > _ZERO * largest]
    oscillating = roots[np.imag(roots) > _ZERO * largest]
    modes = np.column_stack([np.imag(oscillating), np.maximum(np.abs(np.real(oscillating)), _ZERO * largest)])
    return modes, float(corners.min()) if len(corners) else math.inf


def _same_length(modes: list[Float[Array, "_ 2"]]) -> Float[Array, "i most 2"]:
    """Modes of all devices in one array; devices with fewer modes have modes of frequency 0."""
    most = max(len(part) for part in modes)
    out = np.zeros((len(modes), most, 2))
    for row, part in zip(out, modes, strict=True):
        row[: len(part)] = part
    return out
