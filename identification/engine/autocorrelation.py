"""Autocorrelation of noise up to the lag at which estimation noise hides it: Geyer's initial positive sequence.

References:
    C. J. Geyer, Practical Markov chain Monte Carlo, Statistical Science 7(4), 1992.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float

_FEWEST = 8  # samples of which an autocorrelation is estimated


def lagged_products(series: Float[Array, " n"]) -> Float[Array, " n"]:
    """Sum of products of a series with itself at every lag from 0, ``(n,)``."""
    n = len(series)
    return np.fft.irfft(np.abs(np.fft.rfft(series, 2 * n)) ** 2, 2 * n)[:n]


def positive_sequence(products: Float[Array, " n"]) -> Float[Array, " m"]:
    """Autocorrelation from lag 0 on; lags count while the sum of two neighbours is positive.

    Args:
        products: Products of the series with itself, by lag, see `lagged_products`; those of several series are added.
    """
    if len(products) < 2 or products[0] <= 0:
        return np.ones(1)
    rho = products / products[0]
    pairs = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    end = 2 * int(negative[0] if len(negative) else len(pairs))
    return rho[:end] if end else np.ones(1)


def samples_per_independent(rho: Float[Array, " m"]) -> float:
    r"""Samples that carry the information of one, :math:`N / N_\mathrm{eff} = 1 + 2 \sum_k \rho_k`, at least 1.

    Args:
        rho: Autocorrelation from lag 0.
    """
    return max(1.0, float(2 * rho.sum() - 1))


def autocorrelation_time(e: Float[Array, " n"]) -> float:
    """Samples of a series that carry the information of one independent sample; lags beyond its half do not count."""
    if len(e) < _FEWEST or not np.any(e):
        return 1.0
    return samples_per_independent(positive_sequence(lagged_products(e - e.mean())[: len(e) // 2]))
