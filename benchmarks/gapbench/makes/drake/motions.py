"""Reference motions: moves from point to point with rests, sums of sines, slow sweeps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from .robots import Part, Robot

KINDS = ("points", "sines", "sweeps", "points+sines", "sines+sweeps", "points+sweeps")


@dataclass(frozen=True)
class Motion:
    """Positions, speeds and accelerations wanted at times; arrays of shape ``(N, n)``."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def trapezoid(t: np.ndarray, distance: float, speed: float, acceleration: float) -> tuple[np.ndarray, ...]:
    """Position, speed and acceleration of a move from rest to rest that starts at time zero."""
    way, sign = abs(distance), np.sign(distance)
    speed = min(speed, np.sqrt(way * acceleration))
    up = speed / acceleration
    flat = way / speed - up
    s1, s2 = np.clip(t, 0.0, up), np.clip(t - up, 0.0, flat)
    s3 = np.clip(t - up - flat, 0.0, up)
    q = 0.5 * acceleration * s1**2 + speed * s2 + speed * s3 - 0.5 * acceleration * s3**2
    v = acceleration * s1 - acceleration * s3
    a = acceleration * (((t > 0) & (t < up)) * 1.0 - ((t > up + flat) & (t < 2 * up + flat)) * 1.0)
    return sign * q, sign * np.where(t > 0, v, 0.0), sign * a


def _moves(t: np.ndarray, start: float, stops: list[tuple[float, float, float, float]]) -> tuple[np.ndarray, ...]:
    """Moves one after the other: each its time, its target, its speed and its acceleration."""
    q, v, a, here = np.full_like(t, start), np.zeros_like(t), np.zeros_like(t), start
    for begin, target, speed, acceleration in stops:
        dq, dv, da = trapezoid(t - begin, target - here, speed, acceleration)
        q, v, a, here = q + dq, v + dv, a + da, target
    return q, v, a


def _duration(way: float, speed: float, acceleration: float) -> float:
    return way / speed + speed / acceleration if way * acceleration > speed**2 else 2.0 * np.sqrt(way / acceleration)


def _points(rng: np.random.Generator, t: np.ndarray, part: Part) -> tuple[np.ndarray, ...]:
    """Random targets, each followed by a rest of up to half a second."""
    now, here, stops = float(rng.uniform(0.1, 0.5)), 0.0, []
    while now < t[-1]:
        target = float(rng.uniform(-1.0, 1.0)) * part.reach
        if abs(target - here) < 0.3 * part.reach:
            continue
        speed = part.speed * rng.uniform(0.4, 1.0)
        acceleration = speed / rng.uniform(0.1, 0.35)
        length = _duration(abs(target - here), speed, acceleration)
        if now + length > t[-1] - 0.2:
            break
        stops.append((now, target, speed, acceleration))
        now, here = now + length + float(rng.uniform(0.05, 0.5)), target
    return _moves(t, 0.0, stops)


def _sweeps(rng: np.random.Generator, t: np.ndarray, part: Part) -> tuple[np.ndarray, ...]:
    """There and back at slow, held speeds, without rests."""
    now, here, stops = 0.1, 0.0, []
    side = float(rng.choice((-1.0, 1.0)))
    while True:
        target = side * part.reach * float(rng.uniform(0.25, 0.9))
        speed = part.speed * float(np.exp(rng.uniform(np.log(0.04), np.log(0.4))))
        acceleration = speed / rng.uniform(0.05, 0.2)
        length = _duration(abs(target - here), speed, acceleration)
        if now + length > t[-1] - 0.2:
            speed *= 2.0
            length = _duration(abs(target - here), speed, acceleration)
            if now + length > t[-1] - 0.2:
                break
        stops.append((now, target, speed, acceleration))
        now, here, side = now + length, target, -side
    return _moves(t, 0.0, stops)


def _sines(rng: np.random.Generator, t: np.ndarray, part: Part) -> tuple[np.ndarray, ...]:
    """Five to nine tones, faded in and out over 0.8 s, scaled to travel and speed."""
    count = int(rng.integers(5, 10))
    w = 2.0 * np.pi * np.exp(rng.uniform(np.log(0.08), np.log(1.6), count))
    weight, phase = rng.uniform(0.4, 1.0, count) / w**0.7, rng.uniform(0.0, 2.0 * np.pi, count)
    angle = np.multiply.outer(t, w) + phase
    q, v, a = np.sin(angle) @ weight, np.cos(angle) @ (weight * w), -np.sin(angle) @ (weight * w**2)
    x = np.clip(np.minimum(t - t[0], t[-1] - t) / 0.8, 0.0, 1.0)
    side = np.where(t - t[0] < t[-1] - t, 1.0, -1.0) / 0.8
    f, df, ddf = 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)
    q, v, a = f * q, f * v + df * side * q, f * a + 2 * df * side * v + ddf * side**2 * q
    scale = min(part.reach / np.abs(q).max(), part.speed / np.abs(v).max())
    return scale * q, scale * v, scale * a


PIECES = {"points": _points, "sines": _sines, "sweeps": _sweeps}


@dataclass(frozen=True)
class Plan:
    """A motion as a pure function of time: every piece begins and ends at rest."""

    kind: str
    seed: tuple[int, ...]
    duration: float

    def at(self, robot: Robot, t: np.ndarray) -> Motion:
        """The motion at these times; they may be uneven and the same plan gives the same motion."""
        kinds = self.kind.split("+")
        fine = np.linspace(0.0, self.duration, 4001)
        out = np.empty((3, len(t), len(robot.parts)))
        for j, part in enumerate(robot.parts):
            here, q, v, a = 0.0, np.empty_like(t), np.empty_like(t), np.empty_like(t)
            for i, kind in enumerate(kinds):
                begin, end = self.duration * i / len(kinds), self.duration * (i + 1) / len(kinds)
                inside = (t >= begin) if i == len(kinds) - 1 else (t >= begin) & (t < end)
                # Drawn on a fine grid that does not depend on the times asked for.
                rng = np.random.default_rng([*self.seed, j, i])
                grid = fine[(fine >= begin) & (fine <= end)] - begin
                values = PIECES[kind](rng, grid, part)
                local = np.clip(t[inside] - begin, 0.0, grid[-1])
                q[inside] = CubicHermiteSpline(grid, values[0], values[1])(local) + here
                v[inside], a[inside] = np.interp(local, grid, values[1]), np.interp(local, grid, values[2])
                here += float(values[0][-1])
            out[:, :, j] = q + part.home, v, a
        return Motion(t, *out)
