"""Periodic reference motions in closed form.

Triangles move at constant speeds, which excites friction and gravity; sines accelerate, which excites inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion

Array = np.ndarray


@runtime_checkable
class Wave(Protocol):
    """A periodic motion of one joint about zero."""

    def motion(self, t: Float[Array, " N"]) -> Float[Array, "3 N"]:
        """Position, velocity and acceleration at times ``t`` [s]."""
        ...


@dataclass(frozen=True)
class Sine:
    """``amplitude`` times the sine of ``frequency`` [Hz] times t plus ``phase`` [periods]."""

    amplitude: float
    frequency: float
    phase: float = 0.0

    def __post_init__(self):
        _require_positive(self.frequency, "frequency", "Hz")

    def motion(self, t: Float[Array, " N"]) -> Float[Array, "3 N"]:
        """Position, velocity and acceleration, shape ``(3, N)``."""
        w = 2 * np.pi * self.frequency
        angle = w * t + 2 * np.pi * self.phase
        return self.amplitude * np.stack([np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)])


@dataclass(frozen=True)
class Triangle:
    """Constant speeds to and fro between ``-amplitude`` and ``amplitude``, from the middle upwards.

    A corner would take an infinite torque: within ``turn`` of a period (0 to 0.5) the velocity goes through a half
    cosine at either end, so that position, velocity and acceleration are all continuous.
    """

    amplitude: float
    frequency: float
    phase: float = 0.0
    turn: float = 0.1

    def __post_init__(self):
        _require_positive(self.frequency, "frequency", "Hz")
        if not 0 < self.turn <= 0.5:
            raise ParameterError(
                f"A triangle was to turn within {self.turn:g} of its period: give more than 0 and at most 0.5."
            )

    @property
    def speed(self) -> float:
        """Constant speed between the turns."""
        return 2 * self.amplitude * self.frequency / self._rise

    @property
    def _rise(self) -> float:
        # Way of half a period at unit speed [periods].
        return 0.5 - self.turn + 2 * self.turn / np.pi

    def motion(self, t: Float[Array, " N"]) -> Float[Array, "3 N"]:
        """Position, velocity and acceleration, shape ``(3, N)``."""
        since_turn = (self.frequency * t + self.phase + 0.25) % 1.0
        sign = np.where(since_turn < 0.5, 1.0, -1.0)
        u = since_turn % 0.5
        into = np.minimum(u, 0.5 - u)  # distance from the nearer turn
        turning = into < 0.5 * self.turn
        angle = np.pi * into / self.turn
        way = np.where(turning, self.turn / np.pi * (1 - np.cos(angle)), self.turn / np.pi + into - 0.5 * self.turn)
        way = np.where(u < 0.25, way, self._rise - way)
        a = np.where(turning, np.pi / self.turn * np.cos(angle), 0.0) * np.where(u < 0.25, 1.0, -1.0)
        shape = np.stack(
            [way - 0.5 * self._rise, self.frequency * np.where(turning, np.sin(angle), 1.0), self.frequency**2 * a]
        )
        return 2 * self.amplitude / self._rise * sign * shape


def wave_motion(
    t: Float[Array, " N"], joints: Sequence[Sequence[Wave]], center: Float[Array, " nv"] | None = None
) -> Motion:
    """Motion in which every joint follows the sum of its waves.

    Args:
        t: Time [s].
        joints: Waves of each joint; a joint without waves stays at its center.
        center: Position that each joint moves about [rad or m]; zero by default.
    """
    parts = [sum((wave.motion(t) for wave in waves), np.zeros((3, len(t)))) for waves in joints]
    q, v, a = np.stack(parts, axis=2)
    return Motion(t, q if center is None else q + center, v, a)


def _require_positive(value: float, name: str, unit: str) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ParameterError(f"A wave with a {name} of {value:g} {unit} was asked for: give more than 0.")
