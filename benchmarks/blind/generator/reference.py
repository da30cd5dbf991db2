"""Reference motions: Fourier series, slow ramps with reversals and holds, and mixes of both."""

from __future__ import annotations

import numpy as np

KINDS = ("fourier", "ramps", "mixed")
AMPLITUDES = {
    "pendulum": ((0.8, 2.2),),
    "planar2": ((0.5, 1.5), (0.7, 1.8)),
    "spatial3": ((0.6, 1.8), (0.5, 1.2), (0.7, 1.7)),
}
SMOOTHING = 0.25  # [s]: width of the window that rounds the corners of a ramp


def _fade(t: np.ndarray, width: float) -> np.ndarray:
    """Rises from 0 to 1 at the start and falls back at the end, both smooth to the second derivative."""
    x = np.clip(np.minimum(t - t[0], t[-1] - t) / width, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def fourier(rng: np.random.Generator, t: np.ndarray, amplitude: float) -> np.ndarray:
    """Sum of six sines between 0.1 and 1.3 Hz, starting and ending at rest at zero."""
    frequency = rng.choice(np.arange(0.1, 1.35, 0.05), size=6, replace=False)
    weight = rng.uniform(0.5, 1.0, size=6) / (0.3 + frequency)
    phase = rng.uniform(0.0, 2.0 * np.pi, size=6)
    wave = (weight * np.sin(2.0 * np.pi * frequency * t[:, None] + phase)).sum(axis=1)
    wave *= _fade(t, 1.5)
    return amplitude * wave / np.abs(wave).max()


def ramps(rng: np.random.Generator, t: np.ndarray, amplitude: float) -> np.ndarray:
    """Constant speeds from 0.03 to 1.5 rad/s in both directions, with holds, corners rounded."""
    times, places = [t[0], t[0] + 0.3], [0.0, 0.0]
    while times[-1] < t[-1]:
        if rng.random() < 0.15:
            times.append(times[-1] + rng.uniform(0.3, 0.8))
            places.append(places[-1])
            continue
        speed, duration = np.exp(rng.uniform(np.log(0.03), np.log(1.5))), rng.uniform(0.5, 2.0)
        turn = -np.sign(places[-1]) if abs(places[-1]) > 0.6 * amplitude else rng.choice((-1.0, 1.0))
        target = float(np.clip(places[-1] + turn * speed * duration, -amplitude, amplitude))
        times.append(times[-1] + max(abs(target - places[-1]) / speed, 0.1))
        places.append(target)
    dt = t[1] - t[0]
    window = np.hanning(max(3, round(SMOOTHING / dt)))
    line = np.interp(t, times, places)
    padded = np.pad(line, len(window), mode="edge")
    return np.convolve(padded, window / window.sum(), mode="same")[len(window) : -len(window)]


def draw_reference(rng: np.random.Generator, robot: str, kind: str, t: np.ndarray) -> np.ndarray:
    """Joint references [rad], shape ``(N, nv)``; a mix is a Fourier stretch followed by ramps."""
    columns = []
    for low, high in AMPLITUDES[robot]:
        amplitude = rng.uniform(low, high)
        if kind == "fourier":
            columns.append(fourier(rng, t, amplitude))
        elif kind == "ramps":
            columns.append(ramps(rng, t, amplitude))
        elif kind == "mixed":
            split = round(len(t) * rng.uniform(0.4, 0.6))
            columns.append(np.concatenate([fourier(rng, t[:split], amplitude), ramps(rng, t[split:], amplitude)]))
        else:
            raise ValueError(f"No reference {kind!r}: there are {', '.join(KINDS)}.")
    return np.stack(columns, axis=1)
