r"""Force feedforward over a link that is noisy and loses samples, such as a wireless force sensor in a handle.

The reading at sample k has white noise. It arrives with the delay of `Feedforward`, or is lost with a given
probability, independently of the other readings; then the last reading that arrived is used again. So the loop switches
at random between two linear systems. It is **stable in the mean square** if the second moment of its state decays,

.. math:: \rho\{(1 - \pi)\, A_a \otimes A_a + \pi\, A_l \otimes A_l\} < 1,

with :math:`A_a` for an arrived sample, :math:`A_l` for a lost sample, and the share :math:`\pi` of lost samples. From
the stationary second moment under the noise follows the motor force while the hand does not push.

References:
    O. L. V. Costa, M. D. Fragoso, R. P. Marques, Discrete-Time Markov Jump Linear Systems, 2005, chapter 3 (recalled,
    not read). The source of `force_feedforward` mentions noise of the force sensor, and another chapter of its book
    describes a wireless controller, both without equations. Tests compare with spectra, the loop without loss, and
    simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import Operator
from phantom_dyn.haptics.device.discretisation import Controller, SampledAxis, discretise
from phantom_dyn.haptics.device.frequency_kernels import held_input
from phantom_dyn.haptics.device.held_device import Device, HeldDevice
from phantom_dyn.haptics.stability.force_feedforward import Feedforward, critical_feedforward
from phantom_dyn.number_checks import require_columns, require_not_negative, require_numbers

# Largest number of states of a loop. With it there are 1830 second moments, for which a solution takes a second.
_MOST_STATES = 60
# Gains at which the limit of stability is bracketed, relative to the limit without loss.
_GRID = np.geomspace(1e-3, 10.0, 81)
# Bisection steps for the gain. The bracket has a relative width of an eighth, so that the gain is exact to 1e-10.
_HALVINGS = 30


@dataclass(frozen=True)
class ForceLink:
    """Noise and loss of a force reading between sensor and motor, in addition to the delay.

    Attributes:
        noise: Standard deviation of the white noise of a reading [N or N m].
        loss: Probability with which a sample is lost, independent of the others.

    Raises:
        ParameterError: If the noise is negative, or the loss is not from 0 to below 1.
    """

    noise: float = 0.0
    loss: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(noise_of_the_reading=self.noise)
        if not 0 <= self.loss < 1:
            raise ParameterError(
                f"The loss of the link is {self.loss}: give the share of samples that are lost, from 0 to below 1."
            )


@dataclass(frozen=True)
class NoiseFelt:
    """Root mean squares of force and motion that the sensor's noise causes while the hand does not push.

    Attributes:
        motor_force: Force of the motor [N or N m].
        tip: Position of the body that the hand holds [m or rad].
    """

    motor_force: float
    tip: float


@dataclass(frozen=True)
class LinkTrace(ReadOnlyArrays):
    """Motion and forces over time of a held device with force feedforward.

    Attributes:
        t: Times [s], shape ``(N,)``.
        tip: Position of the body [m or rad], shape ``(N,)``.
        reading: Reading of the sensor, with its noise [N or N m], shape ``(N,)``.
        motor_force: Force commanded by the computer [N or N m], shape ``(N,)``.
        arrived: True if the sample arrived, shape ``(N,)``.
    """

    t: Float[Array, " N"]
    tip: Float[Array, " N"]
    reading: Float[Array, " N"]
    motor_force: Float[Array, " N"]
    arrived: Array


def mean_square_radius(axis: Device, hand: Operator, feedforward: Feedforward, gain: float, link: ForceLink) -> float:
    """Long-run factor by which the second moment of the loop grows per sample: stable below one.

    Without loss it is the square of the spectral radius of `feedforward_loop`.

    Raises:
        ParameterError: If nobody holds the device, the gain is not finite, or the delay has too many samples.
    """
    loop = _Loop.of(axis, hand, feedforward, gain)
    return float(np.abs(np.linalg.eigvals(loop.moments(link.loss))).max())


def critical_feedforward_of_link(axis: Device, hand: Operator, feedforward: Feedforward, link: ForceLink) -> float:
    """Largest force gain for which the loop is stable in the mean square.

    It is infinite if it is larger than ten times the limit without loss.

    Raises:
        ParameterError: As for `mean_square_radius`.
    """
    whole = critical_feedforward(axis, hand, feedforward).gain
    if link.loss == 0 or not 0 < whole < math.inf:
        return whole

    def stable(gain: float) -> bool:
        return mean_square_radius(axis, hand, feedforward, gain, link) < 1.0

    low = 0.0
    for high in whole * _GRID:
        if not stable(high):
            break
        low = high
    else:
        return math.inf
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return 0.5 * (low + high)


def noise_felt(axis: Device, hand: Operator, feedforward: Feedforward, gain: float, link: ForceLink) -> NoiseFelt:
    """Motor force and hand motion due to the sensor's noise in the steady state, from stationary second moments.

    Raises:
        ParameterError: If the loop is not stable in the mean square, or as for `mean_square_radius`.
    """
    loop = _Loop.of(axis, hand, feedforward, gain)
    moments = loop.moments(link.loss)
    radius = float(np.abs(np.linalg.eigvals(moments)).max())
    if radius >= 1.0:
        raise ParameterError(
            f"With a force gain of {gain:g} the second moment of the loop grows {radius:.4g} times a sample, so that "
            "there is no steady state: give a smaller gain, see critical_feedforward_of_link."
        )
    noise = (1.0 - link.loss) * link.noise**2 * np.outer(loop.noise, loop.noise)
    state = _whole(np.linalg.solve(np.eye(len(moments)) - moments, noise[np.tril_indices(len(noise))]), len(loop.noise))
    n = len(loop.plant.output)
    own = state[:n, :n]
    return NoiseFelt(
        motor_force=math.sqrt(max(float(state[n, n]), 0.0)),
        tip=math.sqrt(max(float(loop.tip @ own @ loop.tip), 0.0)),
    )


def simulate_link(
    axis: Device,
    hand: Operator,
    feedforward: Feedforward,
    gain: float,
    link: ForceLink,
    pushed: Float[Array, " N"],
    rng: np.random.Generator,
) -> LinkTrace:
    """Simulation of a held device with force feedforward, from rest.

    Args:
        axis: Rigid device, or a device with two masses.
        hand: The hand that holds it.
        feedforward: Filters, sampling and delay.
        gain: Force gain K_f.
        link: Noise and loss.
        pushed: Force F_h with which the hand pushes, constant during each sample [N or N m], shape ``(N,)``.
        rng: Generator of noise and lost samples.

    Raises:
        ParameterError: If nobody holds the device, the gain or a force is not finite.
    """
    require_columns(np.size(pushed), pushed=pushed)
    loop = _Loop.of(axis, hand, feedforward, gain)
    held = HeldDevice(axis, hand, feedforward.cutoff)
    push = np.zeros(len(loop.noise))
    n = len(loop.plant.output)
    push[:n] = held_input(held.state_space.A, held.push, feedforward.period)[1]
    count = len(pushed)
    arrived = rng.random(count) >= link.loss
    noise = link.noise * rng.standard_normal(count)
    tip, reading, motor = np.zeros((3, count))
    state = np.zeros(len(loop.noise))
    for k in range(count):
        # The input of the loop is minus the reading, so that the noise has a minus sign as well.
        tip[k], reading[k] = loop.tip @ state[:n], noise[k] - loop.plant.output @ state[:n]
        state = (loop.arrived @ state - noise[k] * loop.noise) if arrived[k] else loop.lost @ state
        state = state + pushed[k] * push
        motor[k] = state[n]
    return LinkTrace(feedforward.period * np.arange(count), tip, reading, motor, arrived)


@dataclass(frozen=True)
class _Loop:
    """The loop with an arrived and with a lost sample; states: device, past forces, filter, last arrived sample.

    Attributes:
        plant: Sampled device and sensor.
        tip: Row from the states of the device to the position of the body.
        arrived: Transition matrix for an arrived sample.
        lost: Transition matrix for a lost sample.
        noise: Change of the states per unit of minus the noise of an arrived sample.
    """

    plant: SampledAxis
    tip: Array
    arrived: Array
    lost: Array
    noise: Array

    @staticmethod
    def of(axis: Device, hand: Operator, feedforward: Feedforward, gain: float) -> _Loop:
        require_numbers(force_gain=gain)
        held = HeldDevice(axis, hand, feedforward.cutoff)
        plant = discretise(held, period=feedforward.period, delay=feedforward.delay)
        A, B, C, D = feedforward.filter.matrices()
        m = len(B)
        wide = np.zeros((m + 1, m + 1))
        wide[:m, :m] = A
        with_reading: Controller = (wide, np.append(B, 1.0), gain * np.append(C, 0.0), gain * D)
        repeating = wide.copy()
        repeating[:m, m], repeating[m, m] = B, 1.0
        without_reading: Controller = (repeating, np.zeros(m + 1), gain * np.append(C, D), 0.0)
        arrived, lost = plant.closed_by(with_reading), plant.closed_by(without_reading)
        n = len(plant.output)
        noise = np.zeros(len(arrived))
        noise[n] = -gain * D
        if plant.steps == 0:
            noise[:n] = plant.newer * noise[n]
        noise[-(m + 1) :] = with_reading[1]
        return _Loop(plant, held.tip, arrived, lost, noise)

    def moments(self, loss: float) -> Float[Array, "h h"]:
        """Map of the second moments over one sample; moments are the lower half of a symmetric matrix."""
        n = len(self.noise)
        if n > _MOST_STATES:
            raise ParameterError(
                f"The loop has {n} states, of which {self.plant.steps + 1} are forces on their way: give a delay of "
                f"at most {_MOST_STATES - n + self.plant.steps} samples."
            )
        rows, columns = np.tril_indices(n)
        total = np.zeros((len(rows), len(rows)))
        for share, A in ((1.0 - loss, self.arrived), (loss, self.lost)):
            if share:
                both = A[rows][:, rows] * A[columns][:, columns]
                crossed = A[rows][:, columns] * A[columns][:, rows]
                # An entry off the diagonal represents two equal entries of the symmetric matrix.
                total += share * np.where(rows == columns, both, both + crossed)
        return total


def _whole(half: Array, size: int) -> Array:
    """Symmetric matrix from its lower half."""
    out = np.zeros((size, size))
    out[np.tril_indices(size)] = half
    return out + np.tril(out, -1).T
