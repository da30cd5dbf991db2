"""Estimates the autocorrelation of noise, up to the lag at which its estimate is no longer larger than its error.

The method is Geyer's initial positive sequence.

References:
    C. J. Geyer, Practical Markov chain Monte Carlo, Statistical Science 7(4), 1992.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float

_FEWEST = 8  # samples: a shorter series counts as uncorrelated


def lagged_products(series: Float[Array, " n"]) -> Float[Array, " n"]:
    """Sum of products of a series with itself at every lag from 0, ``(n,)``."""
    n = len(series)
    return np.fft.irfft(np.abs(np.fft.rfft(series, 2 * n)) ** 2, 2 * n)[:n]


def positive_sequence(products: Float[Array, " n"]) -> Float[Array, " m"]:
    """Autocorrelation from lag 0 on, ``(m,)``; it ends before the first pair of lags whose sum is zero or negative.

    Args:
        products: Result of `lagged_products`, or its sum over several series.
    """
    if len(products) < 2 or products[0] <= 0:
        return np.ones(1)
    rho = products / products[0]
    pairs = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    end = 2 * int(negative[0] if len(negative) else len(pairs))
    return rho[:end] if end else np.ones(1)


def integrated_autocorrelation_time(rho: Float[Array, " m"]) -> float:
    r"""Number of samples per independent sample, :math:`N / N_\mathrm{eff} = 1 + 2 \sum_k \rho_k`, at least 1.

    Args:
        rho: Autocorrelation from lag 0.
    """
    return max(1.0, float(2 * rho.sum() - 1))


def autocorrelation_time(e: Float[Array, " n"]) -> float:
    """Number of samples of a series per independent sample, from the lags up to half its length, at least 1."""
    if len(e) < _FEWEST or not np.any(e):
        return 1.0
    return integrated_autocorrelation_time(positive_sequence(lagged_products(e - e.mean())[: len(e) // 2]))
