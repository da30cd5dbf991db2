"""Reference motions: fast sums of sines and constant speeds, and the slow ones that people record by hand.

A careful user sends sums of sines and constant speeds with reversals. Most recordings are moves from point to point
with pauses, an arm that is guided by hand, or one joint after the other.
"""

from __future__ import annotations

import numpy as np

from .robots import Table

KINDS = ("fourier", "ramps", "mixed")
SLOW = ("point_to_point", "guided", "one_by_one")
AMPLITUDES = {
    "pendulum": ((0.9, 2.2),),
    "planar2": ((0.6, 1.5), (0.8, 1.8)),
    "spatial3": ((0.7, 1.8), (0.6, 1.2), (0.8, 1.7)),
    "phantom": ((0.5, 1.0), (0.35, 0.6), (0.35, 0.6)),
    "six": ((0.6, 1.4), (0.4, 0.8), (0.5, 0.9), (0.6, 1.2), (0.6, 1.2), (0.8, 1.8)),
    "panda": ((0.6, 1.2), (0.4, 0.7), (0.6, 1.2), (0.5, 0.9), (0.7, 1.4), (0.6, 1.1), (0.8, 1.5)),
}
TURNS = 0.85  # of the changes of a constant speed: reversals
SMOOTHING = 0.03  # [s]: width of the window that limits the jerk at the ends of an acceleration


def _fade(t: np.ndarray, width: float) -> np.ndarray:
    """Rises from 0 to 1 at the start and falls back at the end, both smooth to the second derivative."""
    x = np.clip(np.minimum(t - t[0], t[-1] - t) / width, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def fourier(rng: np.random.Generator, t: np.ndarray, amplitude: float) -> np.ndarray:
    """Sum of six sines between 0.15 and 1.4 Hz, starting and ending at rest at zero."""
    frequency = rng.choice(np.arange(0.15, 1.45, 0.05), size=6, replace=False)
    weight = rng.uniform(0.5, 1.0, size=6) / (0.3 + frequency)
    phase = rng.uniform(0.0, 2.0 * np.pi, size=6)
    wave = (weight * np.sin(2.0 * np.pi * frequency * t[:, None] + phase)).sum(axis=1)
    wave *= _fade(t, 1.2)
    return amplitude * wave / np.abs(wave).max()


def ramps(rng: np.random.Generator, t: np.ndarray, amplitude: float) -> np.ndarray:
    """Constant speeds from 0.03 to 1.5 rad/s, mostly turning round between them, at 2 to 30 rad/s2; few short holds."""
    dt = t[1] - t[0]
    speeds, place, time, v, sign = [np.zeros(round(0.2 / dt))], 0.0, 0.2, 0.0, float(rng.choice((-1.0, 1.0)))
    while time < t[-1] - t[0] + 2 * dt:
        if rng.random() < 0.08:
            target, duration = 0.0, rng.uniform(0.15, 0.4)
        else:
            speed = float(np.exp(rng.uniform(np.log(0.03), np.log(1.5))))
            longest = 0.6 if speed < 0.3 else 0.2 + min(0.8, amplitude / speed)
            duration = rng.uniform(0.2, longest)
            sign = -sign if rng.random() < TURNS else sign
            ends = place + sign * speed * duration
            sign = -float(np.sign(place)) if abs(ends) > amplitude and place else sign
            target = sign * speed
        acceleration = float(np.exp(rng.uniform(np.log(2.0), np.log(30.0))))
        turn = max(2, round(abs(target - v) / acceleration / dt))
        piece = np.concatenate(
            [np.linspace(v, target, turn, endpoint=False), np.full(max(1, round(duration / dt)), target)]
        )
        path = place + np.cumsum(piece) * dt
        over = np.abs(path) > amplitude
        if over.any() and abs(path[-1]) > abs(place):
            piece = piece[: max(int(np.argmax(over)), 2)]
        speeds.append(piece)
        place += float(piece.sum()) * dt
        time += len(piece) * dt
        v = float(piece[-1])
    window = np.hanning(max(3, round(SMOOTHING / dt)) + 2)
    profile = np.concatenate(speeds)[: len(t)]
    smooth = np.convolve(np.pad(profile, len(window), mode="edge"), window / window.sum(), mode="same")
    return np.concatenate([[0.0], np.cumsum(smooth[len(window) : -len(window)])[:-1]]) * dt


def point_to_point(rng: np.random.Generator, t: np.ndarray, amplitude: float) -> np.ndarray:
    """Moves of 1 to 3 s with the least jerk, and pauses of 0.3 to 1.5 s between them."""
    out, place, at = np.zeros(len(t)), 0.0, t[0] + rng.uniform(0.3, 1.0)
    while at < t[-1]:
        goal, last = rng.uniform(-1.0, 1.0) * amplitude, at + rng.uniform(1.0, 3.0)
        x = np.clip((t - at) / (last - at), 0.0, 1.0)
        out += (goal - place) * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        place, at = goal, last + rng.uniform(0.3, 1.5)
    return out


def guided(rng: np.random.Generator, t: np.ndarray, amplitude: float) -> np.ndarray:
    """Four sines between 0.05 and 0.5 Hz, as a hand leads an arm."""
    frequency = rng.uniform(0.05, 0.5, size=4)
    phase = rng.uniform(0.0, 2.0 * np.pi, size=4)
    wave = (np.sin(2.0 * np.pi * frequency * t[:, None] + phase) / (0.2 + frequency)).sum(axis=1) * _fade(t, 2.0)
    return amplitude * wave / np.abs(wave).max()


def _joint(rng: np.random.Generator, kind: str, t: np.ndarray, amplitude: float) -> np.ndarray:
    if kind == "fourier":
        return fourier(rng, t, amplitude)
    if kind == "ramps":
        return ramps(rng, t, amplitude)
    if kind == "point_to_point":
        return point_to_point(rng, t, amplitude)
    if kind == "guided":
        return guided(rng, t, amplitude)
    if kind == "mixed":
        split = round(len(t) * rng.uniform(0.4, 0.5))
        return np.concatenate([fourier(rng, t[:split], amplitude), ramps(rng, t[split:], amplitude)])
    raise ValueError(f"No reference {kind!r}: there are {', '.join((*KINDS, *SLOW))}.")


def draw_reference(rng: np.random.Generator, table: Table, kind: str, t: np.ndarray) -> np.ndarray:
    """Joint references [rad], shape ``(N, nv)``; a mix is a Fourier stretch followed by ramps."""
    ranges = AMPLITUDES[table.name]
    if kind == "one_by_one":
        columns = [np.zeros(len(t)) for _ in ranges]
        for column, rows, (low, high) in zip(
            columns, np.array_split(np.arange(len(t)), len(ranges)), ranges, strict=True
        ):
            column[rows] = guided(rng, t[rows], rng.uniform(low, high))
    else:
        columns = [_joint(rng, kind, t, rng.uniform(low, high)) for low, high in ranges]
    return np.stack(columns, axis=1) + np.array(table.posture or (0.0,) * len(columns))
