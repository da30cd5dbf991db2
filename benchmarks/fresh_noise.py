"""Noise of the same spectrum drawn anew, for another recording by the same sensors and drives."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

Array = np.ndarray


def fresh_noise(noise: Float[Array, "N n"], count: int, rng: np.random.Generator) -> Float[Array, "count n"]:
    """Normal noise of any length with the autocovariance of another one, each column for itself.

    White noise is convolved with the given noise, whose own autocovariance is what results on average.

    Args:
        noise: In even steps.
        count: Samples that are wanted, in the same steps.
        rng: Source of chance.
    """
    size = len(noise) + count
    spectrum = np.fft.rfft(noise, size, axis=0) * np.fft.rfft(rng.standard_normal((size, noise.shape[1])), axis=0)
    return np.fft.irfft(spectrum, size, axis=0)[:count] / np.sqrt(len(noise))
