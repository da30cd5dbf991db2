"""States to start from: smoothed over the neighbouring samples, with what the noise of the encoders leaves of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.log import Log
from identification.rollout.models import Model
from identification.signals import differentiate, low_pass, motion_edge

Array = np.ndarray

_LEAST = 1e-9  # of a state's deviation [rad or m]: numbers themselves are no better
_NUDGE = 1e-4  # [rad or m], for the slope of a reading
_ITERATIONS = 6  # of the inverse of a reading, whose slope is close to one


@dataclass(frozen=True)
class States:
    """Smoothed readings of one log.

    Attributes:
        q: Positions [rad or m], ``(N, nv)``.
        v: Velocities, ``(N, nv)``.
        raw: Positions as they were read.
        q_std: Standard deviation of each joint's ``q``, ``(nv,)``.
        v_std: Of ``v``.
    """

    q: Float[Array, "N nv"]
    v: Float[Array, "N nv"]
    raw: Float[Array, "N nv"]
    q_std: Float[Array, " nv"]
    v_std: Float[Array, " nv"]


def states_of(log: Log, cutoff_hz: float) -> States:
    """States of a log from its positions, low-passed without delay above the judged band.

    What lies above the low-pass is taken for white noise: it tells how much noise is left inside.

    Args:
        log: A recording.
        cutoff_hz: Edge of the judged band.
    """
    rate = log.band.rate_hz
    raw = log.motion.q if log.raw_q is None else log.raw_q
    edge = motion_edge(low_pass(cutoff_hz, rate))
    q, v, _ = differentiate(raw, rate, edge)
    density = ((raw - q)[log.valid] ** 2).mean(axis=0) / max(0.5 * rate - edge, 1e-9)  # per Hz
    q_std, v_std = np.sqrt(density * edge), 2.0 * np.pi * np.sqrt(density * edge**3 / 3.0)
    return States(q, v, raw, np.maximum(q_std, _LEAST), np.maximum(v_std, _LEAST))


def true_state(
    model: Model, q: Float[Array, " nv"], v: Float[Array, " nv"]
) -> tuple[Float[Array, " nv"], Float[Array, " nv"]]:
    """Position and velocity at which the encoders of a model read ``q`` and ``v``.

    Args:
        model: Its readings are inverted; without any the state is the one that was read.
        q: Readings.
        v: Their velocities.
    """
    readings = [part.reading for part in map(model.part, model.causes) if part.reading is not None]
    if not readings:
        return q, v

    def read(x: Array) -> Array:
        for reading in readings:
            x = reading(x)
        return x

    true = q
    for _ in range(_ITERATIONS):
        true = true + q - read(true)
    slope = (read(true + _NUDGE) - read(true - _NUDGE)) / (2.0 * _NUDGE)
    return true, v / np.maximum(slope, 0.5)
