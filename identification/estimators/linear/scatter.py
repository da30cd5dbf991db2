"""Covariance of an estimate (sandwich covariance), from the noise of each joint and the autocorrelation of the noise.

The score is the residual as it enters the normal equations. For least squares it equals the residual.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.fft import next_fast_len
from scipy.linalg import solve_triangular

from identification.engine.autocorrelation import integrated_autocorrelation_time, lagged_products, positive_sequence
from identification.estimators.linear.least_squares import Solution, base_blocks, base_places
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from phantom_dyn.array_types import Array, Float

_FEWEST = 4  # smallest number of samples from which an autocorrelation is computed
_STRETCH = 4096  # length of a stretch [samples at the full rate]; samples of different stretches count as uncorrelated


def autocorrelation(score: Float[Array, " N"], starts: tuple[int, ...]) -> Float[Array, " m"]:
    """Autocorrelation from lag 0 up to the lag at which it is lost in estimation errors.

    Pairs of samples from different recordings are not used.

    Args:
        score: Residual of one joint.
        starts: Index of the first sample of each recording, and last N.
    """
    longest = max((stop - start for start, stop in pairwise(starts)), default=0)
    products = np.zeros(longest)
    for start, stop in pairwise(starts):
        if stop > start:
            products[: stop - start] += lagged_products(score[start:stop])
    return positive_sequence(products) if longest >= _FEWEST else np.ones(1)


def leverage(solution: Solution, information: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Effective number of parameters that each joint's rows determine, ``(nv,)``; the sum is ``r``.

    Args:
        solution: Solution with the Gram matrix of each joint.
        information: Squared weight of each joint's rows.
    """
    bread = np.einsum("j,jkl->kl", information, solution.grams)
    return information * np.array([np.trace(np.linalg.solve(bread, gram)) for gram in solution.grams])


def joint_noise(residual: Float[Array, "N nv"], used: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Standard deviation of each joint's noise; NaN if there are no more equations than parameters.

    Args:
        residual: Residual of the fit.
        used: Effective number of parameters that the rows of each joint determine.
    """
    return noise_of_squares(np.sum(residual**2, axis=0), len(residual), used)


def noise_of_squares(squares: Float[Array, " nv"], samples: int, used: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Standard deviation of each joint's noise, as `joint_noise`, from the sum of squares of its residual."""
    spare = samples - used
    has_spare = spare > 1e-6 * samples
    return np.sqrt(np.where(has_spare, squares, np.nan) / np.where(has_spare, spare, 1.0))


def white_scatter(solution: Solution, scatter: Float[Array, " nv"]) -> Float[Array, "r r"]:
    """Covariance of the normal equations' right side if the noise of all samples were independent.

    Args:
        solution: Solution with the Gram matrix of each joint.
        scatter: Variance of each joint's score.
    """
    return np.einsum("j,jkl->kl", scatter, solution.grams)


def coloured_scatter(
    regressor: Regressor,
    base: BaseParameters,
    solution: Solution,
    scatter: Float[Array, " nv"],
    rho: Sequence[Float[Array, " _"]],
) -> Float[Array, "r r"]:
    r"""Covariance of the normal equations' right side with autocorrelated noise.

    It is :math:`\sum_j b_j \sum_{t,s} x_t x_s^T \rho_j(t - s)`. For a column that varies slowly compared with the
    noise, the variance is larger than with white noise by the factor `integrated_autocorrelation_time`. For a faster
    column the factor is smaller. The spectrum of the noise is limited from below to that of white noise: residuals also
    contain errors of the model, so that no variance may be smaller than with white noise. Pairs of samples in different
    stretches are not used.

    Args:
        regressor: The equations.
        base: The unknowns.
        solution: Triangular factor of the equations.
        scatter: Variance ``b`` of each joint's score.
        rho: Autocorrelation of each joint's score.
    """
    out = np.zeros((base.rank, base.rank))
    inverse = solve_triangular(solution.factor, np.eye(base.rank))
    # Columns on which a joint does not depend are zero in its rows, and are left out.
    places = base_places(regressor, base)
    # A joint's rows of the inverse factor are R^T Q^T. Only the small R^T is applied to all samples; Q follows at the
    # end.
    decompositions = [np.linalg.qr(inverse[place].T) for place in places]
    grams = [np.zeros((len(place), len(place))) for place in places]
    for stretch in _stretches(regressor, base, solution, places):
        for joint, lags in enumerate(rho):
            white = _coloured_spectrum(stretch[joint], lags) @ decompositions[joint].R.T
            grams[joint] += white.T @ white
    for joint, (q, _) in enumerate(decompositions):
        out += scatter[joint] * (q @ grams[joint] @ q.T)
    return out


def _stretches(
    regressor: Regressor, base: BaseParameters, solution: Solution, places: Sequence[Sequence[int]]
) -> Iterator[list[Float[Array, "n _"]]]:
    """The base columns of each joint's rows, over stretches of at most `_STRETCH` samples of one log."""
    longest = max(1, _STRETCH // min(log.band.step for log in regressor.logs))
    if solution.rows:
        for start, stop in pairwise(regressor.starts):
            for k in range(start, stop, longest):
                yield [rows[:, k : min(k + longest, stop)].T for rows in solution.rows]
        return
    ends, parts = set(regressor.starts), [[] for _ in places]
    count = 0
    for at, block in base_blocks(regressor, base):
        for joint, place in enumerate(places):
            parts[joint].append(block[:, joint, place].T)
        count += len(block)
        if count >= longest or at.stop in ends:
            yield [np.concatenate(part, axis=1).T for part in parts]
            parts, count = [[] for _ in places], 0
    if count:
        yield [np.concatenate(part, axis=1).T for part in parts]


def scatter_of_rows(
    rows: Float[Array, "n nv r"], scatter: Float[Array, " nv"], rho: Sequence[Float[Array, " _"]]
) -> Float[Array, "r r"]:
    r"""Covariance of sums over samples of ``rows`` times autocorrelated noise.

    It is :math:`\sum_j b_j \sum_{t,s} x_t x_s^T \rho_j(t - s)`, as in `coloured_scatter`.

    Args:
        rows: Factors ``x`` of the noise of each joint at each sample.
        scatter: Variance of each joint's noise.
        rho: Autocorrelation of each joint's noise.
    """
    out = np.zeros((rows.shape[2], rows.shape[2]))
    for joint, lags in enumerate(rho):
        spectrum = _coloured_spectrum(rows[:, joint], lags)
        out += scatter[joint] * (spectrum.T @ spectrum)
    return out


def _coloured_spectrum(columns: Float[Array, "n k"], lags: Float[Array, " _"]) -> Float[Array, "f k"]:
    """Spectrum of columns (real and imaginary parts alternate), times the square root of the noise spectrum."""
    if not len(columns):
        return columns
    kept = lags[: len(columns)]
    # Zeros are appended, so that the end of a column is not correlated with its beginning.
    length = 2 * int(next_fast_len((len(columns) + 1) // 2 + len(kept), real=True) or 0)
    padded = np.zeros(length)
    padded[: len(kept)] = kept
    padded[length - len(kept) + 1 :] += kept[:0:-1]
    noise_spectrum = np.maximum(np.fft.rfft(padded).real, 1.0)
    # The first and last frequency of a real spectrum count once, all other frequencies twice (Parseval).
    weight = np.full(len(noise_spectrum), 2.0 / length)
    weight[[0, -1]] = 1.0 / length
    # Only a contiguous complex array can be viewed as pairs of real numbers.
    spectrum = np.fft.rfft(np.ascontiguousarray(columns.T), length, axis=1)
    spectrum *= np.sqrt(noise_spectrum * weight)
    return spectrum.view(float).T


def sandwich(solution: Solution, information: Float[Array, " nv"], scatter: Float[Array, "r r"]) -> Float[Array, "r r"]:
    r"""Covariance :math:`A^{-1} B A^{-1}` of the base parameters, :math:`A = \sum_j a_j X_j^T X_j`.

    The noise of different joints is assumed to be independent.

    Args:
        solution: Solution with the Gram matrix of each joint.
        information: ``a``: squared weight of each joint's rows in the estimator.
        scatter: ``B``: covariance of the normal equations' right side.
    """
    bread = np.einsum("j,jkl->kl", information, solution.grams)
    middle = np.linalg.solve(bread, np.linalg.solve(bread, scatter).T)
    # No check for finite values: they are NaN if the noise is not known.
    half = solve_triangular(solution.factor, middle, check_finite=False)
    covariance = solve_triangular(solution.factor, half.T, check_finite=False)
    return 0.5 * (covariance + covariance.T)


def covariances(
    influence: Float[Array, "N nv r"],
    residual: Float[Array, "N nv"],
    sigma: Float[Array, " nv"],
    starts: tuple[int, ...],
) -> tuple[Float[Array, "r r"], Float[Array, "r r"], Float[Array, " nv"]]:
    """Covariance with and without autocorrelation of the noise, and samples per independent sample of each joint.

    Args:
        influence: Derivative of each estimate by the torque of each joint at each sample, shape ``(N, nv, r)``.
        residual: Residual of each joint at each sample.
        sigma: Standard deviation of each joint's noise.
        starts: Index of the first sample of each recording, and last N.
    """
    rho = [autocorrelation(column, starts) for column in residual.T]
    r = influence.shape[2]
    cov, white = np.zeros((r, r)), np.zeros((r, r))
    for start, stop in pairwise(starts):
        rows = influence[start:stop]
        if len(rows):
            cov += scatter_of_rows(rows, sigma**2, rho)
            white += np.einsum("j,njk,njl->kl", sigma**2, rows, rows, optimize=True)
    return 0.5 * (cov + cov.T), white, np.array([integrated_autocorrelation_time(lags) for lags in rho])


def residual_noise(
    rows: Float[Array, "N nv r"], influence: Float[Array, "N nv r"], residual: Float[Array, "N nv"]
) -> Float[Array, " nv"]:
    """Standard deviation of each joint's noise; NaN if there are no more equations than parameters.

    Args:
        rows: Regressor of the unknowns.
        influence: Derivative of each estimate by the torque of each joint at each sample, shape ``(N, nv, r)``.
        residual: Residual torque of the estimates.
    """
    return joint_noise(residual, np.einsum("njk,njk->j", influence, rows, optimize=True))
