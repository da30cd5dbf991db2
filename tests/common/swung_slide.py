"""Recordings of a mass on a slide that is swung by a known force."""

import numpy as np

from identification.data.recording import Recording

RATE = 200.0
T = np.arange(2000) / RATE


def recording(t: np.ndarray, q: np.ndarray, tau: np.ndarray, **more) -> Recording:
    return Recording("swing.csv", ("axis",), t, q[:, None], tau[:, None], **more)


def swing(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the slide and the force that they need."""
    w, amplitude, phase = 2 * np.pi * np.array([0.5, 1.3, 2.9]), np.array([0.1, 0.05, 0.01]), np.array([0.3, 1.0, 2.2])
    waves = amplitude * np.sin(np.outer(t, w) + phase)
    return waves.sum(axis=1), -95.1089 * waves @ w**2
