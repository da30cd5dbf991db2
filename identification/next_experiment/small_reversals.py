"""A family of motions for friction and play: holds in several postures, with small reversals about each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.excitation.waves import Triangle
from phantom_dyn.errors import ParameterError

Array = np.ndarray

# Part of a stop that goes to the next posture.
_TRAVEL = 0.3
# Part of the rest of a stop in which its reversals grow, and fade again.
_FADE = 0.15
# Largest slope and curvature of the way, from zero to one in a unit of time.
_STEEPEST, _SHARPEST = 1.875, 10.0 / np.sqrt(3.0)
# Share of a period in which a triangle turns.
_TURN = 0.2


@dataclass(frozen=True)
class SmallReversals:
    """Shapes from rest to rest: one moves to each posture but the first, and two shake about each posture.

    Of the two, one has ``reversals`` periods of a triangle and the other half as many: joints that take different ones
    go through zero at different times.

    Attributes:
        duration: Length [s].
        stops: Postures.
        reversals: Periods of the faster triangle at each.
    """

    duration: float
    stops: int = 4
    reversals: int = 4

    def __post_init__(self):
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ParameterError(f"A motion of {self.duration:g} s was asked for: give more than 0.")
        if self.stops < 1 or self.reversals < 2:
            raise ParameterError(
                f"{self.stops} postures with {self.reversals} reversals were asked for: give at least 1 with 2."
            )

    @property
    def samples(self) -> int:
        """Samples that show the extremes."""
        return 20 * self.reversals * self.stops

    @property
    def stop(self) -> float:
        """Length of one stop, the way to it included [s]."""
        return self.duration / self.stops

    @property
    def period(self) -> float:
        """Period of the faster triangle [s]."""
        return (1.0 - _TRAVEL) * self.stop / self.reversals

    def farthest(self, velocity: Float[Array, " nv"], acceleration: Float[Array, " nv"]) -> Float[Array, " nv"]:
        """How far the next posture may be at most [rad or m] for joints with these limits."""
        length = _TRAVEL * self.stop
        return np.minimum(velocity * length / _STEEPEST, acceleration * length**2 / _SHARPEST)

    def values(self, t: Float[Array, " N"]) -> Float[Array, "3 N K"]:
        """Position, velocity and acceleration: the constant, then for each stop its way and its two triangles."""
        constant = np.stack([np.ones(len(t)), np.zeros(len(t)), np.zeros(len(t))])
        shapes = [constant]
        for k in range(self.stops):
            start = k * self.stop
            if k:
                shapes.append(_rise(t, start, _TRAVEL * self.stop))
            shapes += [self._shake(t, start + _TRAVEL * self.stop, count) for count in (self.reversals, -1)]
        return np.stack(shapes, axis=2)

    def weights(self, postures: Float[Array, "s nv"], sizes: Float[Array, "s nv"], slow: Array) -> Float[Array, "K nv"]:
        """Weights of a motion through postures.

        Args:
            postures: One for each stop.
            sizes: Amplitudes of the reversals at each [rad or m].
            slow: True for joints that take the slower triangle, ``(nv,)``.
        """
        rows = [postures[0]]
        for k in range(self.stops):
            if k:
                rows.append(postures[k] - postures[k - 1])
            rows += [np.where(slow, 0.0, sizes[k]), np.where(slow, sizes[k], 0.0)]
        return np.array(rows)

    def _shake(self, t: Float[Array, " N"], start: float, count: int) -> Float[Array, "3 N"]:
        """Triangles of unit amplitude that grow from nothing and fade again."""
        length = (1.0 - _TRAVEL) * self.stop
        periods = count if count > 0 else max(1, self.reversals // 2)
        wave = Triangle(1.0, periods / length, 0.0, _TURN).motion(t - start)
        up = _rise(t, start, _FADE * length)
        down = _rise(t, start + (1.0 - _FADE) * length, _FADE * length)
        return _product(up - down, wave)


def _rise(t: Float[Array, " N"], start: float, length: float) -> Float[Array, "3 N"]:
    """From zero to one with rest at both ends: a polynomial of degree five."""
    x = np.clip((t - start) / length, 0.0, 1.0)
    return np.stack(
        [
            x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
            30.0 * x**2 * (1.0 - x) ** 2 / length,
            60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / length**2,
        ]
    )


def _product(f: Float[Array, "3 N"], g: Float[Array, "3 N"]) -> Float[Array, "3 N"]:
    """Value and two derivatives of a product."""
    return np.stack([f[0] * g[0], f[1] * g[0] + f[0] * g[1], f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2]])
