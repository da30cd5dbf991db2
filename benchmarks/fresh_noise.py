"""Draw new noise with the spectrum of given noise, for another recording with the same sensors and drives."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

Array = np.ndarray


def fresh_noise(noise: Float[Array, "N n"], count: int, rng: np.random.Generator) -> Float[Array, "count n"]:
    """Normal noise of any length with the autocovariance of given noise, for each column separately.

    White noise is convolved with the given noise. On average, the result has the autocovariance of the given noise.

    Args:
        noise: Given noise at even steps.
        count: Number of samples, at the same steps.
        rng: Random number generator.
    """
    size = len(noise) + count
    spectrum = np.fft.rfft(noise, size, axis=0) * np.fft.rfft(rng.standard_normal((size, noise.shape[1])), axis=0)
    return np.fft.irfft(spectrum, size, axis=0)[:count] / np.sqrt(len(noise))
