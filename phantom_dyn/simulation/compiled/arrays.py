"""Arguments of the compiled simulation steps as named tuples of arrays: effects, controller, state, samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn.array_types import Array
from phantom_dyn.effects.compiled_laws import delay_law, number_of
from phantom_dyn.effects.simulated import Law

GIVEN, AT_SAMPLES, AT_STEPS = 0, 1, 2
"""Source of the commanded torque: the caller; the tracking law at samples; the tracking law at every step."""


class Laws(NamedTuple):
    """The ``k`` laws of one channel (torque, command or reading), in the order in which they act.

    Attributes:
        codes: Number of each law, see `phantom_dyn.effects.compiled_laws.number_of`, ``(k,)``.
        rows: Joint of each law, ``(k,)``.
        others: A second joint of each law, whose weighted speed is added, ``(k,)``.
        shares: Weight of the second joint, ``(k,)``.
        numbers: Parameters of each law, filled with zeros, ``(k, 4)``.
        state: Internal state of each law, filled with zeros, ``(k, 3)``; updated in every step.
    """

    codes: Array
    rows: Array
    others: Array
    shares: Array
    numbers: Array
    state: Array


class Lines(NamedTuple):
    """Delay lines of the commands, one for each command law (used only if the law is a delay).

    Attributes:
        rings: Ring buffers of the step lengths and commands that are still delayed, ``(k, n, 2)``.
        ends: Indices of the oldest and the newest entry, ``(k, 2)``.
    """

    rings: Array
    ends: Array


class EffectLaws(NamedTuple):
    """Laws of all effects by channel, and the delay lines of the drives."""

    torques: Laws
    commands: Laws
    readings: Laws
    lines: Lines


class Plan(NamedTuple):
    """Times of samples and steps, and the motion of the base.

    Attributes:
        t: Times of the samples [s], ``(N,)``.
        steps: Length of the steps after each sample [s], ``(N,)``.
        counts: Number of steps after each sample, ``(N,)``.
        far: Speed above which the integration has diverged.
        base: Motion of the base at the samples, the columns of `phantom_dyn.motion.BaseMotion`, ``(N, 9)``; shape
            ``(0, 9)`` for a fixed base.
    """

    t: Array
    steps: Array
    counts: Array
    far: float
    base: Array


class Control(NamedTuple):
    """The tracking law of `phantom_dyn.simulation.control` as arrays.

    Attributes:
        mode: ``GIVEN``, ``AT_SAMPLES`` or ``AT_STEPS``.
        t: Times of the tables [s], ``(n,)``.
        tables: Feedforward torque, position reference, velocity reference, position gain, velocity gain, torque that is
            added after the limit, ``(n, nv, 6)``.
        limits: Largest commanded torques, ``(nv,)``.
        cursor: Row of the tables before the current time, ``(1,)``; updated in every step.
    """

    mode: int
    t: Array
    tables: Array
    limits: Array
    cursor: Array


class Moving(NamedTuple):
    """State of the simulated robot; all arrays are updated in every step.

    Attributes:
        x: Positions of joints, then of motors on elastic transmissions, ``(n,)``.
        v: Velocities, ``(n,)``.
        a: Mean accelerations of the last step, ``(n,)``.
        transmitted: Torque that the transmissions passed in the last step, ``(nv,)``.
        friction: Torque of dry friction, ``(nv,)``.
        commanded: Commanded torque of the drives, ``(nv,)``.
        delivered: Torque of the drives in the last step, NaN before the first, ``(nv,)``.
    """

    x: Array
    v: Array
    a: Array
    transmitted: Array
    friction: Array
    commanded: Array
    delivered: Array


class Rows(NamedTuple):
    """Recorded values at N samples.

    Attributes:
        q: Readings of the encoders, ``(N, nv)``.
        commanded: Commanded torque of the drives, ``(N, nv)``.
        delivered: Torque of the drives in the step before, ``(N, nv)``.
        x: Positions, ``(N, n)``.
        v: Velocities, ``(N, n)``.
        before: Accelerations in the step before the sample, ``(N, n)``.
        after: Accelerations in the step after the sample, ``(N, n)``.
    """

    q: Array
    commanded: Array
    delivered: Array
    x: Array
    v: Array
    before: Array
    after: Array


def packed(laws: list[Law]) -> Laws:
    """Write the laws of one channel as arrays."""
    k = len(laws)
    numbers, state = np.zeros((k, 4)), np.zeros((k, 3))
    for i, law in enumerate(laws):
        numbers[i, : len(law.numbers)] = law.numbers
        state[i, : len(law.start)] = law.start
    return Laws(
        np.array([number_of(law.function) for law in laws], np.int64),
        np.array([law.row for law in laws], np.int64),
        np.array([law.other for law in laws], np.int64),
        np.array([law.share for law in laws], float),
        numbers,
        state,
    )


def lines_of(laws: list[Law], t: Array, counts: Array) -> Lines:
    """Make empty delay lines, long enough for ``counts[k]`` steps between the times ``t[k]`` and ``t[k + 1]``."""
    delays = [law.numbers[0] if law.function is delay_law else 0.0 for law in laws]
    size = 4 + int(max((_most_steps(t, counts, delay) for delay in delays if delay > 0.0), default=0.0))
    return Lines(np.zeros((len(laws), size, 2)), np.full((len(laws), 2), -1, np.int64))


def _most_steps(t: Array, counts: Array, delay: float) -> float:
    """The largest number of steps that begin within ``delay`` seconds."""
    done = np.concatenate([[0.0], np.cumsum(counts[: len(t) - 1], dtype=float)])
    # The number of steps is piecewise linear in time, so it is largest for an interval that begins or ends at a sample.
    ends = np.concatenate([t, t + delay])
    return float(np.max(np.interp(ends, t, done) - np.interp(ends - delay, t, done)))


def moving_from(x: Array, v: Array, transmitted: Array) -> Moving:
    """The state at the start of a simulation."""
    nv = len(transmitted)
    no_acceleration = np.zeros(len(x))
    return Moving._make(
        np.array(part, dtype=float)
        for part in (x, v, no_acceleration, transmitted, np.zeros(nv), np.zeros(nv), np.full(nv, np.nan))
    )


def rows_for(count: int, nv: int, n: int) -> Rows:
    """Arrays for ``count`` samples, filled with zeros."""
    return Rows._make(np.zeros((count, width)) for width in (nv, nv, nv, n, n, n, n))
