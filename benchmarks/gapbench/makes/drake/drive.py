"""From the command to the torque at the rotor: delay, current loop, limit, constant, ripple."""

from __future__ import annotations

import numpy as np

from .departures import Departures


class CommandHistory:
    """Held commands and their integral, so that any delay is exact to the fraction of a step.

    A class, since it grows while the robot moves.
    """

    def __init__(self, ticks: np.ndarray, size: int) -> None:
        self._ticks = ticks
        self._held = np.zeros((len(ticks), size))
        self._sum = np.zeros((len(ticks), size))
        self._now = -1

    def hold(self, k: int, command: np.ndarray) -> None:
        """From tick k on this command is held."""
        if k:
            self._sum[k] = self._sum[k - 1] + (self._ticks[k] - self._ticks[k - 1]) * self._held[k - 1]
        self._held[k], self._now = command, k

    def _integral(self, when: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(self._ticks, when, side="right") - 1, 0, self._now)
        j = np.arange(len(when))
        # Before the first tick the first command was held already.
        return self._sum[k, j] + (when - self._ticks[k]) * self._held[k, j]

    def mean(self, begin: float, end: float, delay: np.ndarray) -> np.ndarray:
        """Mean of what was commanded ``delay`` earlier, over a step, shape ``(n,)``."""
        return (self._integral(end - delay) - self._integral(begin - delay)) / (end - begin)

    @property
    def held(self) -> np.ndarray:
        """The command of the last tick."""
        return self._held[self._now]


def passed(state: np.ndarray, wanted: np.ndarray, time: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """A first-order lag over one step: its mean and its state at the end, exact for a constant input.

    Args:
        state: At the start [N m], shape ``(n,)``.
        wanted: Input over the step [N m], shape ``(n,)``.
        time: Time constants [s]; zero passes the input on.
        step: [s].
    """
    safe = np.maximum(time, 1e-9)
    fade = np.exp(-step / safe)
    mean = wanted + (state - wanted) * safe / step * (1.0 - fade)
    return mean, wanted + (state - wanted) * fade


def ripple(of: Departures, q: np.ndarray) -> np.ndarray:
    """Cogging at these motor angles [N m], shape ``(n,)``."""
    out = np.zeros_like(q)
    for j, order, amplitude, phase in of.ripple:
        out[j] += amplitude * np.sin(order * q[j] + phase)
    return out


def sensed(of: Departures, q: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Encoder reading of motor angles, rounded to the given step."""
    offset, amplitude, phase, order, coarse = of.reading.T
    shown = q + offset + amplitude * np.sin(order * q + phase)
    unit = np.where(coarse > 0.0, coarse, step)
    return np.round(shown / unit) * unit
