"""Four estimators of velocity from an incremental encoder, for recordings and for closed loops.

The stock PHANToM averages 100 differences. The improved PHANToM of Cavusoglu, Feygin and Tendick (2002, section 4.2.2)
measures the period between edges with a 10 MHz clock and a 16-bit counter, and averages 16 samples. One step of each
estimator is a compiled function, which recordings and closed loops share.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.sensing.encoder import EncoderRecord
from phantom_dyn.number_checks import require_positive

AVERAGED_DIFFERENCE, ADAPTIVE_WINDOW, KALMAN, PERIOD_MEASUREMENT = 0, 1, 2, 3
"""Numbers of the kinds of estimators in compiled functions."""
READINGS_KEPT = 512
"""Size of the ring buffer of readings, a little more than the longest window."""
EDGES_KEPT = 1024
"""Size of the ring buffer of edges, with several edges for each sample of a window."""


def _check_window(name: str, value: int) -> None:
    """Refuse a window that is not a whole number from 1 to 500."""
    if not (1 <= value <= READINGS_KEPT - 12 and value == int(value)):
        raise ParameterError(f"The estimator's {name} is {value}: give a whole number from 1 to 500.")


@dataclass(frozen=True)
class AveragedDifference:
    """Mean of the last n finite differences, which is (x[k] - x[k - n]) / (n T).

    Attributes:
        samples: n, from 1 to 500.
    """

    samples: int = 1

    def __post_init__(self) -> None:
        _check_window("samples", self.samples)


@dataclass(frozen=True)
class AdaptiveWindow:
    """End-fit first-order adaptive windowing (Janabi-Sharifi, Hayward and Chen 2000).

    The estimate is the slope of the longest chord that stays within `bound` of all readings in its window.

    Attributes:
        samples: Longest window, from 1 to 500 samples.
        bound: Largest error of a chord [counts]. For a linear motion, rounding of both ends and of a reading between
            them causes an error of at most one count.
    """

    samples: int = 100
    bound: float = 1.0

    def __post_init__(self) -> None:
        _check_window("samples", self.samples)
        require_positive("the adaptive window", bound=self.bound)


@dataclass(frozen=True)
class KalmanVelocity:
    """Stationary Kalman filter for a motion of constant velocity disturbed by white acceleration.

    The variance of a reading is that of rounding, step^2 / 12.

    Attributes:
        acceleration: Standard deviation of the acceleration, which is constant during a sample [m/s2 or rad/s2].
    """

    acceleration: float = 1.0

    def __post_init__(self) -> None:
        require_positive("the Kalman filter", acceleration=self.acceleration)


@dataclass(frozen=True)
class PeriodMeasurement:
    """Steps over the time between edges, which a clock measures, averaged over samples.

    If the time between edges is too long for the counter of the clock, the controller counts its samples instead. While
    the controller waits for an edge, it limits the speed to one step over the waiting time.

    Attributes:
        clock: Frequency of the clock [Hz].
        bits: Size of the counter.
        edges: Number of periods in one measurement; a multiple of four removes the spacing errors of a quadrature.
        samples: Number of samples of the controller that are averaged afterwards, from 1 to 500.
    """

    clock: float = 10e6
    bits: int = 16
    edges: int = 1
    samples: int = 16

    def __post_init__(self) -> None:
        _check_window("samples", self.samples)
        _check_window("edges", self.edges)
        if not (math.isfinite(self.clock) and self.clock > 0 and self.bits in range(1, 53)):
            raise ParameterError(
                f"A clock of {self.clock} Hz with a counter of {self.bits} bits: give a clock above 0 and 1 to 52 bits."
            )


Estimator = AveragedDifference | AdaptiveWindow | KalmanVelocity | PeriodMeasurement

STOCK = AveragedDifference(100)
"""Estimator of the stock PHANToM: an average of 100 samples, with a lag of 50 ms."""

IMPROVED = PeriodMeasurement()
"""Estimator of the improved PHANToM: period measurement and an average of 16 samples."""


def kalman_gains(estimator: KalmanVelocity, *, step: float, period: float) -> tuple[float, float]:
    """Stationary Kalman gains from the error of the predicted reading to position [-] and velocity [1/s].

    Raises:
        ParameterError: If encoder step or period is not above 0.
    """
    require_positive(encoder_step=step, period=period)
    transition = np.array([[1.0, period], [0.0, 1.0]])
    push = np.array([[period**2 / 2], [period]]) * estimator.acceleration
    position, velocity = stationary_gains(transition, push @ push.T, step)
    return float(position), float(velocity)


def stationary_gains(transition: Array, process: Array, step: float) -> Float[Array, " n"]:
    """Stationary Kalman gains of a motion whose first state is read with the rounding noise of an encoder.

    Args:
        transition: Transition matrix over a sample, shape ``(n, n)``.
        process: Covariance of the process noise over a sample, shape ``(n, n)``.
        step: Motion per count of the encoder [m or rad].
    """
    reading, noise = np.eye(1, len(transition)), np.array([[step**2 / 12]])
    covariance = solve_discrete_are(transition.T, reading.T, process, noise)
    return (covariance @ reading.T / (reading @ covariance @ reading.T + noise))[:, 0]


class KernelForm(NamedTuple):
    """An estimator in the form that compiled functions take.

    Attributes:
        kind: Kind of the estimator.
        parameters: Its parameters, shape ``(5,)``.
        period: Sampling period [s].
    """

    kind: int
    parameters: Array
    period: float


def kernel_form(estimator: Estimator, *, step: float, period: float) -> KernelForm:
    """Form of an estimator for an encoder of this step [m or rad] that is read with this period [s]."""
    kind, parameters = _kind_and_parameters(estimator, step, period)
    return KernelForm(kind, parameters, float(period))


def _kind_and_parameters(estimator: Estimator, step: float, period: float) -> tuple[int, Float[Array, "5"]]:
    p = np.zeros(5)
    match estimator:
        case AveragedDifference(samples):
            p[0] = samples
            return AVERAGED_DIFFERENCE, p
        case AdaptiveWindow(samples, bound):
            # A chord between whole counts may touch the bound exactly; without a margin rounding errors would decide.
            p[:2] = samples, bound * step * (1 + 1e-9)
            return ADAPTIVE_WINDOW, p
        case KalmanVelocity():
            p[:2] = kalman_gains(estimator, step=step, period=period)
            return KALMAN, p
        case PeriodMeasurement(clock, bits, edges, samples):
            p[:] = step, clock, 2.0**bits, edges, samples
            return PERIOD_MEASUREMENT, p


def estimate_velocity(estimator: Estimator, record: EncoderRecord) -> Float[Array, " N"]:
    """Velocity [m/s or rad/s] at each sample from the readings and edges up to this sample, shape ``(N,)``."""
    form = kernel_form(estimator, step=record.step, period=record.period)
    velocities = np.zeros(record.reading.size)
    ring, memory = np.zeros(READINGS_KEPT), np.zeros(READINGS_KEPT + 2)
    # An additional edge, because indices are taken modulo the number of edges, which must not be zero.
    times = np.append(record.edge_time, np.inf)
    directions = np.append(record.edge_direction, 0.0)
    velocities_of_record(form, record.reading, times, directions, ring, memory, velocities)
    return velocities


@jit
def velocities_of_record(form, readings, edge_time, edge_direction, ring, memory, velocities):
    """Write ``velocities`` from readings and edges; ``ring`` and ``memory`` of `next_velocity` start at zero."""
    edges = 0
    for k in range(readings.size):
        while edges < edge_time.size and edge_time[edges] <= k * form.period:
            edges += 1
        ring[k % ring.size] = readings[k]
        velocities[k] = next_velocity(form, k, ring, memory, edge_time, edge_direction, edges)


@jit
def next_velocity(form, k, readings, memory, edge_time, edge_direction, edges):
    """Velocity estimate at sample k of a `KernelForm`.

    ``readings`` is a ring buffer of `READINGS_KEPT` positions, with that of sample k at index k modulo its length.
    ``memory`` is the state of the estimator: it has two more entries than ``readings``, is zero at the start and
    updated here. ``edge_time`` and ``edge_direction`` are ring buffers with the latest of the ``edges`` edges so far.
    """
    kind, parameters, period = form
    if kind == AVERAGED_DIFFERENCE:
        return averaged_difference(int(parameters[0]), k, period, readings)
    if kind == ADAPTIVE_WINDOW:
        return adaptive_window(int(parameters[0]), parameters[1], k, period, readings)
    if kind == KALMAN:
        return kalman(parameters[0], parameters[1], k, period, readings, memory)
    raw = period_velocity(parameters, k, period, edge_time, edge_direction, edges)
    return moving_average(raw, int(parameters[4]), k, memory)


@jit
def averaged_difference(samples, k, period, readings):
    """``(x[k] - x[k - n]) / (n T)``, with n = k before sample n."""
    n = min(samples, k)
    if n == 0:
        return 0.0
    return (readings[k % readings.size] - readings[(k - n) % readings.size]) / (n * period)


@jit
def adaptive_window(longest, bound, k, period, readings):
    """Slope over the longest window whose chord stays within ``bound`` of every reading in it."""
    size = readings.size
    last = readings[k % size]
    slope = 0.0
    for n in range(1, min(longest, k) + 1):
        candidate = (last - readings[(k - n) % size]) / n
        for i in range(1, n):
            if abs(last - i * candidate - readings[(k - i) % size]) > bound:
                return slope / period
        slope = candidate
    return slope / period


@jit
def kalman(position_gain, velocity_gain, k, period, readings, memory):
    """Velocity of a stationary Kalman filter, whose state is in the last two entries of ``memory``."""
    reading = readings[k % readings.size]
    if k == 0:
        memory[-2] = reading
        memory[-1] = 0.0
        return 0.0
    predicted = memory[-2] + period * memory[-1]
    innovation = reading - predicted
    memory[-2] = predicted + position_gain * innovation
    memory[-1] = memory[-1] + velocity_gain * innovation
    return memory[-1]


@jit
def period_velocity(parameters, k, period, edge_time, edge_direction, edges):
    """Steps over the clock ticks between the last edges; ``parameters`` are step, clock, counter size and edges."""
    step, clock, counter = parameters[0], parameters[1], parameters[2]
    wanted = int(parameters[3])
    size = edge_time.size
    if edges < 2:
        return 0.0
    direction = edge_direction[(edges - 1) % size]
    ticks, used = 0.0, 0
    while used < wanted and edges - used >= 2 and used < size - 2:
        new, old = (edges - 1 - used) % size, (edges - 2 - used) % size
        # After a reversal the motion passes the same edge again, so that the time between both is not that of a step.
        if edge_direction[old] != direction:
            break
        ticks += period_ticks(edge_time[old], edge_time[new], clock, counter, period)
        used += 1
    if used == 0 or ticks == 0.0:
        return 0.0
    speed = used * step * clock / ticks
    # Without a further edge, the speed is below one step over the waiting time.
    waited = (k - math.ceil(edge_time[(edges - 1) % size] / period)) * period
    if waited * speed > step:
        speed = step / waited
    return direction * speed


@jit
def period_ticks(start, end, clock, counter, period):
    """Ticks of the counter between two edges; if it overflows, from the samples of the controller."""
    ticks = np.floor(end * clock) - np.floor(start * clock)
    if ticks < counter:
        return max(ticks, 1.0)
    return max((np.floor(end / period) - np.floor(start / period)) * period * clock, counter)


@jit
def moving_average(value, samples, k, memory):
    """Mean of the last n values; all but the last two entries of ``memory`` are the ring buffer of values."""
    size = memory.size - 2
    memory[k % size] = value
    n = min(samples, k + 1)
    total = 0.0
    for i in range(n):
        total += memory[(k - i) % size]
    return total / n
