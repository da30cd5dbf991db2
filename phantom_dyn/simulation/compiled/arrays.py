"""What compiled steps take: effects' laws, delay lines, a controller, the state, and room for what is recorded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn.array_types import Array
from phantom_dyn.effects.compiled_laws import delay_law, number_of
from phantom_dyn.effects.simulated import Law

GIVEN, AT_SAMPLES, AT_STEPS = 0, 1, 2
"""Who says what the drives are asked for: the caller; the tracking law at samples; the same law at every step."""


class Laws(NamedTuple):
    """Laws of one channel, in their order; ``k`` of them.

    Attributes:
        codes: Numbers of the laws, see `phantom_dyn.effects.compiled_laws.number_of`, ``(k,)``.
        rows: Joints, ``(k,)``.
        others: Joints whose speed counts too, ``(k,)``.
        shares: Weight of that speed, ``(k,)``.
        numbers: Parameters, ``(k, 4)``.
        state: ``(k, 3)``; moves on with every step.
    """

    codes: Array
    rows: Array
    others: Array
    shares: Array
    numbers: Array
    state: Array


class Lines(NamedTuple):
    """Delay lines of the commands, one for each command law (used only where it is a delay).

    Attributes:
        rings: Lengths and commands of the steps on their way, ``(k, n, 2)``.
        ends: Places of the oldest and the newest, ``(k, 2)``.
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
    """When to record and to step.

    Attributes:
        t: Times of the samples [s], ``(N,)``.
        steps: Length of the steps behind each sample [s], ``(N,)``.
        counts: How many there are, ``(N,)``.
        far: Speed beyond which the integration has blown up.
        base: How the root moves at the samples, the columns of `phantom_dyn.motion.BaseMotion`, ``(N, 9)``; none,
            ``(0, 9)``, of a robot that is bolted down.
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
        tables: Feedforward, reference of position and velocity, gains of both, what is added behind the limit,
            ``(n, nv, 6)``.
        limits: ``(nv,)``.
        cursor: Place in the tables, ``(1,)``; moves on.
    """

    mode: int
    t: Array
    tables: Array
    limits: Array
    cursor: Array


class Moving(NamedTuple):
    """State of a machine; all arrays move on with every step.

    Attributes:
        x: Positions of joints and loose motors, ``(n,)``.
        v: Velocities, ``(n,)``.
        a: Mean accelerations of the last step, ``(n,)``.
        transmitted: Torque that the transmissions passed, ``(nv,)``.
        friction: Torque of dry friction, ``(nv,)``.
        asked: Torque that is asked of the drives, ``(nv,)``.
        given: Torque that they gave in the last step, NaN before the first, ``(nv,)``.
    """

    x: Array
    v: Array
    a: Array
    transmitted: Array
    friction: Array
    asked: Array
    given: Array


class Rows(NamedTuple):
    """What is recorded at N samples.

    Attributes:
        q: Readings, ``(N, nv)``.
        asked: Torque asked of the drives, ``(N, nv)``.
        given: Torque that they gave before, ``(N, nv)``.
        x: Positions, ``(N, n)``.
        v: Velocities, ``(N, n)``.
        before: Accelerations of the step before, ``(N, n)``.
        after: Accelerations of the step after, ``(N, n)``.
    """

    q: Array
    asked: Array
    given: Array
    x: Array
    v: Array
    before: Array
    after: Array


def packed(laws: list[Law]) -> Laws:
    """Laws of one channel as arrays."""
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
    """Empty delay lines for steps of which there are ``counts[k]`` between the times ``t[k]`` and ``t[k + 1]``."""
    delays = [law.numbers[0] if law.function is delay_law else 0.0 for law in laws]
    size = 4 + int(max((_most_steps(t, counts, delay) for delay in delays if delay > 0.0), default=0.0))
    return Lines(np.zeros((len(laws), size, 2)), np.full((len(laws), 2), -1, np.int64))


def _most_steps(t: Array, counts: Array, delay: float) -> float:
    """The largest number of steps that begin within ``delay`` seconds."""
    done = np.concatenate([[0.0], np.cumsum(counts[: len(t) - 1], dtype=float)])
    # Linear between samples, so largest where the stretch begins or ends at one.
    ends = np.concatenate([t, t + delay])
    return float(np.max(np.interp(ends, t, done) - np.interp(ends - delay, t, done)))


def moving_from(x: Array, v: Array, transmitted: Array) -> Moving:
    """The state at the start."""
    nv = len(transmitted)
    still = np.zeros(len(x))
    return Moving._make(
        np.array(part, dtype=float)
        for part in (x, v, still, transmitted, np.zeros(nv), np.zeros(nv), np.full(nv, np.nan))
    )


def rows_for(count: int, nv: int, n: int) -> Rows:
    """Room for ``count`` samples."""
    return Rows._make(np.zeros((count, width)) for width in (nv, nv, nv, n, n, n, n))
