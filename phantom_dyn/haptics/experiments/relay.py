r"""Relay experiment: critical stiffness from the oscillation of a device under an on-off force.

A relay :math:`u = -F\,\mathrm{sign}(x)` makes the device swing about zero at a frequency where the phase of the loop is
-180 degrees. At this frequency the first harmonic of the force over that of the position is the critical stiffness
(Astrom and Hagglund, 1995). A device with a vibration has several such frequencies, and **two limit cycles coexist**: a
small initial displacement leads to the limit cycle of the vibration, a large one to that of the rigid device.

The relay is sampled, so that it reacts to a zero crossing up to one period late, on average half a period. If the delay
is short, this changes the result at the frequency of the vibration, but not at a few hertz. The compiled functions have
no annotations, because numba compiles them for the types of their arguments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.number_checks import require_columns, require_numbers, require_positive, sample_count
from phantom_dyn.signals.spectra import cross_density, power_density

# Share of the recording, from its start, that is not used because the oscillation is not yet steady.
_SETTLING = 0.4
# Samples of the longest segment of a spectrum.
_SEGMENT = 8192
# Bins on either side of a peak that belong to it under a Hann window.
_REACH = 2
# Smallest number of samples of an experiment, and of its part after settling.
_LEAST_SAMPLES, _LEAST_SETTLED = 100, 64


@dataclass(frozen=True)
class RelayExperiment(ReadOnlyArrays):
    """Force and position of a device under a relay.

    Attributes:
        period: Sampling period [s].
        delay: Delay of the loop in addition to the hold [s].
        t: Time [s], shape ``(N,)``.
        force: Force of the relay as commanded by the computer [N or N m], shape ``(N,)``.
        position: Position [m or rad], shape ``(N,)``.
    """

    period: float
    delay: float
    t: Float[Array, " N"]
    force: Float[Array, " N"]
    position: Float[Array, " N"]


@dataclass(frozen=True)
class LimitCycle(ReadOnlyArrays):
    """The steady oscillation of a relay experiment.

    Attributes:
        frequency: Frequency of the largest peak in the spectrum of the position [rad/s].
        stiffness: First harmonic of force over that of position: the critical stiffness [N/m or N m/rad].
        amplitude: First harmonic of the position [m or rad].
        frequencies: Frequencies of the spectra [rad/s], shape ``(k,)``.
        position_density: Power spectral density of the position, in its unit squared per hertz, shape ``(k,)``.
    """

    frequency: float
    stiffness: float
    amplitude: float
    frequencies: Float[Array, " k"]
    position_density: Float[Array, " k"]

    @property
    def decibels(self) -> float:
        """Stiffness as a gain margin [dB]."""
        return 20.0 * math.log10(self.stiffness)


def simulate_relay(
    axis: RigidAxis | TwoMassAxis, *, period: float, delay: float = 0.0, force: float, start: float, duration: float
) -> RelayExperiment:
    """Simulated experiment: an ideal sampled relay drives a device behind hold and delay, which is released at rest.

    Args:
        axis: Model of the device.
        period: Sampling period [s].
        delay: Delay of the loop in addition to the hold [s].
        force: Force of the relay [N or N m]; it is negative at position zero.
        start: Position at which the device is released [m or rad], on which the limit cycle depends.
        duration: Duration of the experiment [s].

    Raises:
        ParameterError: If force or period is not positive, the delay is negative, the start is not finite, or the
            duration is less than a hundred periods.
    """
    require_positive(force_of_the_relay=force)
    require_numbers(start=start)
    count = sample_count(duration, period)
    if count < _LEAST_SAMPLES:
        raise ParameterError(
            f"A relay experiment of {count} samples was asked for: give a duration of at least 100 periods."
        )
    s, given = discretise(axis, period=period, delay=delay), np.zeros(count)
    position = held_forces(s.transition, s.newer, s.older, s.output, s.steps, axis.rest(start), given, float(force))
    return RelayExperiment(period, delay, period * np.arange(count), given, position)


def limit_cycle(experiment: RelayExperiment) -> LimitCycle:
    """Frequency and critical stiffness of a relay experiment, from the averaged spectra of its later part.

    As in [Gil]_ (`phantom_dyn.haptics.device.axis`), the frequency is that of the largest peak; here it is the centre
    of the peak, between bins. The stiffness is the inverse of the empirical transfer function at the peak.

    Raises:
        ParameterError: If fewer than 64 samples are left after the device has settled, the relay does not switch any
            more, or force or position are not finite.
    """
    require_columns(len(experiment.t), force=experiment.force, position=experiment.position)
    first = int(_SETTLING * len(experiment.t))
    force, position = experiment.force[first:], experiment.position[first:]
    length = min(_SEGMENT, len(force))
    if length < _LEAST_SETTLED:
        raise ParameterError(f"{length} samples are left of the relay experiment after settling: record 64 or more.")
    if np.ptp(force) == 0 or np.ptp(position) == 0:
        raise ParameterError(
            "After settling the relay never switches, so that there is no limit cycle: "
            "record for longer, and for several times the delay."
        )
    rate = 1.0 / experiment.period
    f, density = power_density(position, rate, length)
    _, force_density = power_density(force, rate, length)
    _, cross = cross_density(force, position, rate, length)
    at = 1 + int(np.argmax(density[1:]))
    peak = slice(max(at - _REACH, 1), at + _REACH + 1)
    frequency = float(np.sum(f[peak] * density[peak]) / np.sum(density[peak]))
    # Noises of force and position are not correlated, so that the ratio of force power to cross power has no bias.
    stiffness = float(np.sum(force_density[peak]) / np.abs(np.sum(cross[peak])))
    amplitude = float(np.sqrt(2.0 * np.sum(density[peak]) * (f[1] - f[0])))
    return LimitCycle(2 * np.pi * frequency, stiffness, amplitude, 2 * np.pi * f, density)


@jit
def held_forces(transition, newer, older, C, steps, state, forces, relay):
    """Positions of a device that starts in ``state``, under a sequence of held and delayed forces.

    If ``relay`` is above 0, the forces are those of a relay of this force, which are written to ``forces``.
    """
    position = np.zeros(len(forces))
    x = state.copy()
    following = np.zeros(len(state))
    for k in range(len(forces)):
        position[k] = _read(C, x)
        if relay > 0.0:
            forces[k] = relay if position[k] < 0.0 else -relay
        _advance(transition, newer, older, steps, forces, k, x, following)
        x, following = following, x
    return position


@jit
def _advance(transition, newer, older, steps, given, k, x, following):
    """Write the state after sample ``k`` into ``following``; there is no force before the first sample."""
    new = given[k - steps] if k >= steps else 0.0
    old = given[k - steps - 1] if k > steps else 0.0
    for i in range(len(x)):
        following[i] = newer[i] * new + older[i] * old
        for j in range(len(x)):
            following[i] += transition[i, j] * x[j]


@jit
def _read(C, x):
    """Position in state ``x``."""
    y = 0.0
    for i in range(len(x)):
        y += C[i] * x[i]
    return y
