"""Simulation of sampled loops of one or two devices: quantised positions, any velocity estimator, delayed forces.

A linear loop has a closed-form solution (`phantom_dyn.haptics.device.discretisation`). A loop with rounded positions,
and with edges between samples, has none: it is simulated step by step, with exact steps of the device.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.frequency_kernels import held_input
from phantom_dyn.haptics.device.transfer_function import Axis, StateSpace
from phantom_dyn.haptics.sensing.encoder import Encoder, count_through
from phantom_dyn.haptics.sensing.velocity_estimators import (
    EDGES_KEPT,
    READINGS_KEPT,
    AveragedDifference,
    Estimator,
    KernelForm,
    kernel_form,
    next_velocity,
)
from phantom_dyn.number_checks import require_columns, require_numbers, require_positive

# Steps per sample. The motion is linear within a step, so that times of edges are exact to some tens of ns.
_SUBSTEPS = 20
# Largest delay [samples].
_LATEST = 4000
# Size of the ring buffer of delayed forces: a power of two above `_LATEST`.
_FORCES_KEPT = 4096
# Relative width of the bracket at which the bisection of a gain ends.
_WIDTH = 0.01
# Position [m or rad] beyond which the device has run away.
_FAR = 10.0


@dataclass(frozen=True)
class LoopSettings:
    """Sampling, sensor and estimator between a device and its force.

    Attributes:
        period: Sampling period T [s].
        delay: Delay from a sample to its force [s], a multiple of T / 20.
        encoder: Position sensor.
        estimator: Velocity estimator.

    Raises:
        ParameterError: If the period is not above 0, or the delay is no multiple of a twentieth of it.
    """

    period: float = 1e-3
    delay: float = 0.0
    encoder: Encoder = field(default_factory=Encoder)
    estimator: Estimator = field(default_factory=AveragedDifference)

    def __post_init__(self) -> None:
        require_positive("the loop", period=self.period)
        late = self.delay / self.period * _SUBSTEPS
        if not (0 <= late <= _LATEST * _SUBSTEPS and abs(late - round(late)) < 1e-6):
            raise ParameterError(
                f"The delay of the loop is {self.delay} s: give a multiple of {self.period / _SUBSTEPS:g} s, "
                f"at most {_LATEST} periods."
            )


@dataclass(frozen=True)
class LoopTrace:
    """Time traces of d devices, which end if a position exceeds 10 m or rad.

    Attributes:
        t: Times of the samples [s], shape ``(N,)``.
        position: True position [m or rad], shape ``(N, d)``.
        reading: Position according to the encoder [m or rad], shape ``(N, d)``.
        velocity: Velocity according to the estimator [m/s or rad/s], shape ``(N, d)``.
        force: Commanded force [N or N m], shape ``(N, d)``.
        ran_away: True if a position exceeded 10 m or rad.
    """

    t: Float[Array, " N"]
    position: Float[Array, "N d"]
    reading: Float[Array, "N d"]
    velocity: Float[Array, "N d"]
    force: Float[Array, "N d"]
    ran_away: bool

    def keeps_swinging(self, step: float) -> bool:
        """True if an oscillation of more than ten encoder steps does not decay.

        It does not decay if its width in the last third of the time is more than nine tenths of that in the middle
        third. Smaller oscillations are ignored, because rounding may sustain them in a stable loop. A motion that does
        not reverse twice is not an oscillation.

        Raises:
            ParameterError: If there are fewer than nine samples.
        """
        if self.ran_away:
            return True
        third = len(self.t) // 3
        if third < 3:
            raise ParameterError(
                f"{len(self.t)} samples are too few to see an oscillation: simulate for nine periods or more."
            )
        difference = self.position[:, 0] if self.position.shape[1] == 1 else self.position[:, 0] - self.position[:, 1]
        last = difference[-third:]
        turns = np.count_nonzero(np.diff(np.sign(np.diff(last))))
        middle = np.ptp(difference[third : 2 * third])
        return bool(turns >= 2 and np.ptp(last) > 10 * step and np.ptp(last) > 0.9 * middle)


def simulate_loop(
    devices: tuple[Axis, ...],
    settings: LoopSettings,
    *,
    gain: float,
    damping: float,
    start: tuple[float, ...],
    speed: tuple[float, ...],
    hand: Float[Array, "N d"],
    one_sided: bool = False,
) -> LoopTrace:
    """Simulate one device under the force ``-(gain x + damping v)``, or two with this law for their difference.

    Args:
        devices: One or two models. The encoder reads the motor, and hand and motor push at the motor.
        settings: Sampling, sensor and estimator, the same for both.
        gain: Gain on the position [N/m or N m/rad].
        damping: Gain on the estimated velocity [N s/m or N m s/rad].
        start: Position of each device at the start [m or rad].
        speed: Velocity of each device at the start [m/s or rad/s]; only a device with mass at its motor has one.
        hand: Force of the hand [N or N m], constant during each sample, shape ``(N, d)``.
        one_sided: True for a wall: the force acts at positions above zero only.

    Raises:
        ParameterError: If there are not one or two devices, a tuple has another length, or a number is not finite.
    """
    count = len(devices)
    if count not in (1, 2) or len(start) != count or len(speed) != count or np.shape(hand)[1:] != (count,):
        raise ParameterError(
            f"{count} devices with {len(start)} positions, {len(speed)} speeds and hands of shape {np.shape(hand)} "
            "were given: give one or two devices and as many of each."
        )
    require_numbers(gain=gain, damping=damping)
    for k in range(count):
        require_numbers(start=start[k], speed=speed[k])
        require_columns(len(hand), force_of_the_hand=hand[:, k])
    systems = [device.state_space for device in devices]
    order = max(len(system.B) for system in systems)
    transition, push = np.zeros((count, order, order)), np.zeros((count, order))
    output, x = np.zeros((count, order)), np.zeros((count, order))
    for i, system in enumerate(systems):
        n = len(system.B)
        transition[i, :n, :n], push[i, :n] = held_input(system.A, system.B, settings.period / _SUBSTEPS)
        output[i, :n] = system.C
        x[i, :n] = _state(system, start[i], speed[i])
    held = HeldDevices(transition, push, output, np.array([system.D for system in systems]))
    law = LoopLaw(
        form=kernel_form(settings.estimator, step=settings.encoder.step, period=settings.period),
        step=settings.encoder.step,
        spacing=np.array(settings.encoder.spacing),
        late=round(settings.delay / settings.period * _SUBSTEPS),
        gain=float(gain),
        damping=float(damping),
        one_sided=one_sided,
    )
    traces = Traces(*(np.zeros(hand.shape) for _ in range(4)))
    done = run_loop(held, law, x, np.ascontiguousarray(hand, float), traces)
    position, reading, velocity, force = (trace[:done] for trace in traces)
    return LoopTrace(np.arange(done) * settings.period, position, reading, velocity, force, done < len(hand))


def gain_until_swinging(run: Callable[[float], LoopTrace], step: float, *, low: float, high: float) -> float:
    """Smallest gain at which an oscillation does not decay, by bisection; infinite if it decays at the highest gain.

    Args:
        run: Function that simulates the loop with a given gain.
        step: Encoder step [m or rad], see `LoopTrace.keeps_swinging`.
        low: Lowest gain that is tried.
        high: Highest gain that is tried.

    Returns:
        The gain in the middle of the last bracket; 0 if an oscillation does not decay at the lowest gain.

    Raises:
        ParameterError: If the gains are not positive and increasing.
    """
    if not 0 < low < high < math.inf:
        raise ParameterError(f"Gains from {low} to {high} were given: give two above 0, the lower one first.")
    if run(low).keeps_swinging(step):
        return 0.0
    if not run(high).keeps_swinging(step):
        return math.inf
    while high / low > 1 + _WIDTH:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if run(middle).keeps_swinging(step) else (middle, high)
    return math.sqrt(low * high)


def _state(system: StateSpace, position: float, speed: float) -> Float[Array, " n"]:
    """Smallest state with this position and speed, and with higher derivatives of zero as far as possible.

    So a device with the speed zero stays at rest, and no internal vibration starts.
    """
    rows = [system.C]
    for _ in range(len(system.B) - 1):
        rows.append(rows[-1] @ system.A)
    scale = np.array([max(float(np.abs(row).max()), 1e-300) for row in rows])
    wanted = np.zeros(len(rows))
    wanted[0] = position
    if len(rows) > 1:
        wanted[1] = speed
    return np.linalg.lstsq(np.array(rows) / scale[:, None], wanted / scale, rcond=None)[0]


class HeldDevices(NamedTuple):
    """Exact motion of ``d`` devices over a substep under a constant force.

    Attributes:
        transition: Transition matrices of the states, shape ``(d, n, n)``.
        push: Change of the states per unit of force, shape ``(d, n)``.
        output: Rows from state to position, shape ``(d, n)``.
        direct: Feed-through from force to position, shape ``(d,)``.
    """

    transition: Array
    push: Array
    output: Array
    direct: Array


class LoopLaw(NamedTuple):
    """Law of the force, from the readings of one device or the difference of two.

    Attributes:
        form: Velocity estimator.
        step: Step of the encoder [m or rad].
        spacing: Displacements of its edges [steps], shape ``(4,)``.
        late: Substeps between a sample and its force.
        gain: Gain on the position.
        damping: Gain on the estimated velocity.
        one_sided: True if the force acts at positions above zero only.
    """

    form: KernelForm
    step: float
    spacing: Array
    late: int
    gain: float
    damping: float
    one_sided: bool


class Traces(NamedTuple):
    """Arrays that `run_loop` writes, each of shape ``(N, d)``, see `LoopTrace`."""

    positions: Array
    readings: Array
    velocities: Array
    forces: Array


@jit
def run_loop(held: HeldDevices, law: LoopLaw, x: Array, hand: Array, traces: Traces) -> int:
    """Write the traces of ``d`` devices; returns the number of samples until a position exceeds `_FAR`.

    Args:
        held: The devices.
        law: Law of the force and its delay.
        x: States at the start, shape ``(d, n)``; overwritten.
        hand: Force of the hand at each sample, shape ``(N, d)``.
        traces: Output: the traces.
    """
    transition, push, output, direct = held
    form, step, spacing, late, gain, damping, one_sided = law
    positions, readings, velocities, forces = traces
    samples, devices = positions.shape
    order, period = x.shape[1], form.period
    dt = period / _SUBSTEPS
    rings = np.zeros((devices, READINGS_KEPT))
    memories = np.zeros((devices, READINGS_KEPT + 2))
    times, directions = np.full((devices, EDGES_KEPT), -1.0), np.zeros((devices, EDGES_KEPT))
    edges, counts = np.zeros(devices, np.int64), np.zeros(devices, np.int64)
    place, speed, following = np.zeros(devices), np.zeros(devices), np.zeros(order)
    commands = np.zeros((devices, _FORCES_KEPT))
    for i in range(devices):
        for j in range(order):
            place[i] += output[i, j] * x[i, j]
        counts[i] = int(np.floor(place[i] / step + 0.5))
    for k in range(samples):
        for i in range(devices):
            rings[i, k % READINGS_KEPT] = counts[i] * step
            speed[i] = next_velocity(form, k, rings[i], memories[i], times[i], directions[i], edges[i])
        for i in range(devices):
            error, rate = counts[i] * step, speed[i]
            if devices == 2:
                error, rate = error - counts[1 - i] * step, rate - speed[1 - i]
            u = -(gain * error + damping * rate)
            if one_sided and error <= 0.0:
                u = 0.0
            commands[i, k % _FORCES_KEPT] = u
            positions[k, i], readings[k, i] = place[i], counts[i] * step
            velocities[k, i], forces[k, i] = speed[i], u
            if abs(place[i]) > _FAR:
                return k
        for s in range(_SUBSTEPS):
            at = (k * _SUBSTEPS + s - late) // _SUBSTEPS
            for i in range(devices):
                u = hand[k, i] + (commands[i, at % _FORCES_KEPT] if at >= 0 else 0.0)
                for row in range(order):
                    following[row] = push[i, row] * u
                    for j in range(order):
                        following[row] += transition[i, row, j] * x[i, j]
                new = direct[i] * u
                for j in range(order):
                    x[i, j] = following[j]
                    new += output[i, j] * following[j]
                if not abs(new) <= _FAR:
                    # Counting all edges on the way to such a position would take too long.
                    return k + 1
                start = k * period + s * dt
                counts[i], edges[i] = count_through(
                    counts[i], start, place[i], start + dt, new, step, spacing, times[i], directions[i], edges[i]
                )
                place[i] = new
    return samples
