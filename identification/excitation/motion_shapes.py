"""Families of motions from rest to rest, and periodic waves.

In a family, the motion of a joint is a weighted sum of shape functions; it begins and ends at rest. The first shape is
constant. `identification.excitation.excite` chooses the weights. Waves need not begin at rest; they are references of
other experiments. Triangles have constant speeds and excite friction and gravity; sines accelerate and excite inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.interpolate import BSpline

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion
from phantom_dyn.number_checks import require_positive

SAMPLES_PER_PERIOD = 30
"""Number of samples per period of the fastest part of a motion: the peak of a sine is at most 0.5 % above a sample."""


@runtime_checkable
class Wave(Protocol):
    """A periodic motion of one joint about zero."""

    def motion(self, t: Float[Array, " N"]) -> Float[Array, "3 N"]:
        """Position, velocity and acceleration at times ``t`` [s]."""
        ...


@dataclass(frozen=True)
class Sine:
    """A sine wave with an ``amplitude`` [rad or m], a ``frequency`` [Hz] and a ``phase`` [periods]."""

    amplitude: float
    frequency: float
    phase: float = 0.0

    def __post_init__(self):
        require_positive("a wave", frequency=self.frequency)

    def motion(self, t: Float[Array, " N"]) -> Float[Array, "3 N"]:
        """Position, velocity and acceleration, shape ``(3, N)``."""
        w = 2 * np.pi * self.frequency
        angle = w * t + 2 * np.pi * self.phase
        return self.amplitude * np.stack([np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)])


@dataclass(frozen=True)
class Triangle:
    """A triangular wave between ``-amplitude`` and ``amplitude`` that starts upwards at zero.

    Its corners are rounded, because a sharp corner needs infinite torque: during a ``turn`` (share of a period, 0 to
    0.5) at each end the velocity is a half cosine, so that position, velocity and acceleration are continuous.
    ``frequency`` is in Hz, ``phase`` in periods.
    """

    amplitude: float
    frequency: float
    phase: float = 0.0
    turn: float = 0.1

    def __post_init__(self):
        require_positive("a wave", frequency=self.frequency)
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
        """Distance in half a period at unit speed [periods]."""
        return 0.5 - self.turn + 2 * self.turn / np.pi

    def motion(self, t: Float[Array, " N"]) -> Float[Array, "3 N"]:
        """Position, velocity and acceleration, shape ``(3, N)``."""
        since_turn = (self.frequency * t + self.phase + 0.25) % 1.0
        sign = np.where(since_turn < 0.5, 1.0, -1.0)
        u = since_turn % 0.5
        from_turn = np.minimum(u, 0.5 - u)  # distance from the nearer turn
        turning = from_turn < 0.5 * self.turn
        angle = np.pi * from_turn / self.turn
        during_turn = self.turn / np.pi * (1 - np.cos(angle))
        distance = np.where(turning, during_turn, self.turn / np.pi + from_turn - 0.5 * self.turn)
        distance = np.where(u < 0.25, distance, self._rise - distance)
        a = np.where(turning, np.pi / self.turn * np.cos(angle), 0.0) * np.where(u < 0.25, 1.0, -1.0)
        shape = np.stack(
            [distance - 0.5 * self._rise, self.frequency * np.where(turning, np.sin(angle), 1.0), self.frequency**2 * a]
        )
        return 2 * self.amplitude / self._rise * sign * shape


def wave_motion(
    t: Float[Array, " N"], joints: Sequence[Sequence[Wave]], center: Float[Array, " nv"] | None = None
) -> Motion:
    """Motion in which every joint follows the sum of its waves.

    Args:
        t: Times [s], shape ``(N,)``.
        joints: Waves of each joint; a joint without waves stays at its centre.
        center: Position about which each joint moves [rad or m], shape ``(nv,)``; zero by default.
    """
    parts = [sum((wave.motion(t) for wave in waves), np.zeros((3, len(t)))) for waves in joints]
    q, v, a = np.stack(parts, axis=2)
    return Motion(t, q if center is None else q + center, v, a)


@runtime_checkable
class Shapes(Protocol):
    """A family of motions of one joint over ``duration`` [s], with zero velocity and acceleration at both ends."""

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        ...

    @property
    def samples(self) -> int:
        """Number of samples over the duration from which the extremes of the motion are known to within a per cent."""
        ...

    def values(self, t: Float[Array, " N"]) -> Float[Array, "3 N K"]:
        """Position, velocity and acceleration of each shape, shape ``(3, N, K)``; the first shape is constantly one."""
        ...


@dataclass(frozen=True)
class FourierSeries:
    """Sines and cosines with the first ``harmonics`` multiples of the frequency 1/``duration``: a periodic motion."""

    duration: float
    harmonics: int = 5

    def __post_init__(self):
        require_positive("a motion", duration=self.duration)
        # Each harmonic has two weights; rest at the ends determines two weights in all.
        _require_count(self.harmonics, "harmonics", 2)

    @property
    def samples(self) -> int:
        """Number of samples over the duration from which the extremes of the motion are known to within a per cent."""
        return SAMPLES_PER_PERIOD * self.harmonics

    def values(self, t: Float[Array, " N"]) -> Float[Array, "3 N K"]:
        """Position, velocity and acceleration of each shape."""
        at_ends = _harmonics(_ends(self), self.duration, self.harmonics)
        return _from_rest(_harmonics(t, self.duration, self.harmonics), at_ends)


@dataclass(frozen=True)
class BSplines:
    """Splines of degree five over ``pieces`` equal intervals, smooth up to the fourth derivative."""

    duration: float
    pieces: int = 10

    def __post_init__(self):
        require_positive("a motion", duration=self.duration)
        _require_count(self.pieces, "pieces", 1)

    @property
    def samples(self) -> int:
        """Number of samples from which the extremes of the motion are known; a piece counts as half a period."""
        return SAMPLES_PER_PERIOD * max(self.pieces // 2, 4)

    def values(self, t: Float[Array, " N"]) -> Float[Array, "3 N K"]:
        """Position, velocity and acceleration of each shape."""
        knots = np.concatenate([np.zeros(5), np.linspace(0.0, 1.0, self.pieces + 1), np.ones(5)]) * self.duration
        spline = BSpline(knots, np.eye(self.pieces + 5), 5)

        def part(times: Array) -> Array:
            inside = np.clip(times, 0.0, self.duration)
            values = np.stack([spline(inside), spline.derivative(1)(inside), spline.derivative(2)(inside)])
            # The first three splines do not start at rest, and are left out. The factor makes speeds about 1.
            return values[:, :, 3:] * self.duration / self.pieces

        return _from_rest(part(t), part(_ends(self)))


@dataclass(frozen=True)
class TrianglesAndSines:
    """Triangular waves with one to ``triangles`` periods, and sines and cosines with one to ``harmonics`` periods.

    Triangles have constant speeds between their corners and excite friction; sines excite inertia. ``turn`` is the
    duration of a triangle's rounded corner, as a share of its period.
    """

    duration: float
    triangles: int = 3
    harmonics: int = 4
    turn: float = 0.15

    def __post_init__(self):
        require_positive("a motion", duration=self.duration)
        _require_count(self.triangles, "triangles", 1)
        _require_count(self.harmonics, "harmonics", 1)
        self._triangle(1)

    @property
    def samples(self) -> int:
        """Number of samples from which the extremes of the motion are known; ten or more in each rounded corner."""
        return max(SAMPLES_PER_PERIOD * self.harmonics, int(np.ceil(12 * self.triangles / self.turn)))

    def values(self, t: Float[Array, " N"]) -> Float[Array, "3 N K"]:
        """Position, velocity and acceleration of each shape."""
        return _from_rest(self._parts(t), self._parts(_ends(self)))

    def _parts(self, t: Array) -> Array:
        """Position, velocity and acceleration of each sine, cosine and triangle, ``(3, N, M)``."""
        waves = [self._triangle(k).motion(t) for k in range(1, self.triangles + 1)]
        return np.concatenate([_harmonics(t, self.duration, self.harmonics), np.stack(waves, axis=2)], axis=2)

    def _triangle(self, periods: int) -> Triangle:
        """A triangle with unit speed that starts at its lower turn, where its velocity is zero."""
        shape = Triangle(1.0, periods / self.duration, -0.25, self.turn)
        return Triangle(1.0 / shape.speed, periods / self.duration, -0.25, self.turn)


def _ends(shapes: Shapes) -> Float[Array, "2"]:
    """Times of begin and end [s]."""
    return np.array([0.0, shapes.duration])


def _harmonics(t: Array, duration: float, harmonics: int) -> Array:
    """Sines and cosines with a peak velocity of one."""
    parts = []
    for k in range(1, harmonics + 1):
        w = 2 * np.pi * k / duration
        s, c = np.sin(w * t), np.cos(w * t)
        parts += [np.stack([s / w, c, -w * s]), np.stack([c / w, -s, -w * c])]
    return np.stack(parts, axis=2)


def _from_rest(parts: Float[Array, "3 N M"], at_ends: Float[Array, "3 2 M"]) -> Float[Array, "3 N K"]:
    """The constant shape, and orthonormal combinations of ``parts`` that are at rest at both ends."""
    # At rest, velocity and acceleration are zero at both ends: four conditions on the weights of the parts. Weights
    # that keep them are the null space of the matrix of the conditions, which the SVD yields.
    conditions = at_ends[1:].reshape(4, -1)
    size = np.linalg.norm(conditions, axis=1, keepdims=True)
    _, singular, rows = np.linalg.svd(conditions / np.where(size > 0, size, 1.0))
    rank = int((singular > 1e-9).sum())  # a periodic family has the same conditions at both ends
    constant = np.zeros((3, parts.shape[1], 1))
    constant[0] = 1.0
    return np.concatenate([constant, parts @ rows[rank:].T], axis=2)


def _require_count(count: int, name: str, least: int) -> None:
    """Raise an error for fewer parts of a motion than the least number."""
    if count < least:
        raise ParameterError(f"A motion of {count} {name} was asked for: give at least {least}.")
