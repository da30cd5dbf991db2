"""How much an estimate scatters: noise of each joint, its memory, and the covariance that follows."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from identification.estimators.least_squares import Solution

Array = np.ndarray


def correlation_factor(residual: Float[Array, " N"], starts: tuple[int, ...]) -> float:
    r"""Samples per independent sample, :math:`N / N_\mathrm{eff} = 1 + 2 \sum_k \rho_k`, at least 1.

    The sum runs over the autocorrelation of the residual while the sum of two neighbouring lags is positive (the
    initial positive sequence of a Markov chain, [Geyer]_), so that the noise of the distant lags does not
    pile up. Pairs of samples from different recordings do not count.

    Args:
        residual: Of one joint.
        starts: First sample of each recording, and N.

    References:
        .. [Geyer] C. J. Geyer, Practical Markov chain Monte Carlo, Statistical Science 7(4), 1992.
    """
    longest = max((stop - start for start, stop in pairwise(starts)), default=0)
    power = np.zeros(longest)
    for start, stop in pairwise(starts):
        x = residual[start:stop]
        if len(x):
            spectrum = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
            power[: len(x)] += np.fft.irfft(spectrum, 2 * len(x))[: len(x)]
    if longest < 4 or power[0] <= 0:
        return 1.0
    rho = power / power[0]
    pairs = rho[: longest // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    kept = pairs[: negative[0]] if len(negative) else pairs
    return max(1.0, float(2 * kept.sum() - 1))


def leverage(solution: Solution, information: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Number of parameters that each joint's rows determine; they sum to ``r``.

    Args:
        solution: Gives the grams.
        information: Weight of each joint's rows (squared).
    """
    bread = np.einsum("j,jkl->kl", information, solution.grams)
    return information * np.array([np.trace(np.linalg.solve(bread, gram)) for gram in solution.grams])


def joint_noise(residual: Float[Array, "N nv"], used: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Standard deviation of each joint's noise; nan where no equation is left over.

    Args:
        residual: Of the fit.
        used: Parameters that each joint's rows determine.
    """
    spare = len(residual) - used
    left = spare > 1e-6 * len(residual)
    return np.sqrt(np.where(left, np.sum(residual**2, axis=0), np.nan) / np.where(left, spare, 1.0))


def sandwich(solution: Solution, information: Float[Array, " nv"], scatter: Float[Array, " nv"]) -> Float[Array, "r r"]:
    r"""Covariance :math:`A^{-1} B A^{-1}` of the base parameters.

    :math:`A = \sum_j a_j X_j^T X_j` is the information that the estimator believes in, :math:`B = \sum_j b_j X_j^T X_j`
    the scatter of its score. Noise of different joints is taken as independent.

    Args:
        solution: Gives the grams.
        information: ``a``.
        scatter: ``b``.
    """
    bread = np.einsum("j,jkl->kl", information, solution.grams)
    meat = np.einsum("j,jkl->kl", scatter, solution.grams)
    middle = np.linalg.solve(bread, np.linalg.solve(bread, meat).T)
    left = solve_triangular(solution.factor, middle)
    covariance = solve_triangular(solution.factor, left.T)
    return 0.5 * (covariance + covariance.T)
