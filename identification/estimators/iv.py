r"""Instrumental variables (IDIM-IV), and a test whether errors of the recorded motion bias least squares.

Under a position controller, noise of the positions enters both torque and regressor, which biases least squares. The
estimate with instruments solves :math:`Z^T S^{-1} (y - W \theta) = 0`. The instruments :math:`Z` are the regressor of a
simulated closed loop, which has no noise, so that this estimate is not biased. The Durbin-Wu-Hausman test compares it
with weighted least squares.

References:
    A. Janot, P.-O. Vandanjon, M. Gautier, A generic instrumental variable approach for industrial robot
    identification, IEEE Transactions on Control Systems Technology 22(1), 2014.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from identification.estimators.closed_loop.loop import MOST_SIMULATIONS, Feedback, not_settled, resimulated, start_of
from identification.estimators.fit import Fit, InfluencedValues, fit_of, values_of_influence
from identification.estimators.linear.least_squares import base_rows, factor_of, influence_of
from identification.estimators.linear.scatter import covariances
from identification.estimators.weighted_least_squares import floored
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import IdentifiabilityError

_SETTLED = 0.05  # largest step of a converged estimate, in its standard deviations
_LEAST_LINK = 1e-9  # smallest correlation between instruments and regressor

# Directions in which the difference of both estimates has less than this share of the variance of least squares are
# left out of the test: there both agree by construction, because columns such as a constant are their own instruments.
_EQUAL_VARIANCE = 1e-8
_SMALL_BIAS = 0.5  # largest bias that needs no action, in standard deviations of least squares


def iv(regressor: Regressor, *, feedback: Feedback | None = None) -> Fit:
    """Base parameters by instrumental variables.

    Args:
        regressor: The equations.
        feedback: The controllers; by default those of ``robot.yaml``.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the simulation diverges, or the estimates do not converge.
    """
    start = start_of(regressor, feedback)
    base = start.base
    found = with_instruments(regressor, base, start.simulation.rows(base), start.weights)
    for _ in range(MOST_SIMULATIONS):
        before = found
        simulation = resimulated(regressor, start.loops, base, found.theta)
        found = with_instruments(regressor, base, simulation.rows(base), 1.0 / floored(before.sigma, regressor))
        # Without noise the first term is zero; the second one allows for rounding errors.
        converged = np.abs(found.theta - before.theta) <= _SETTLED * found.std + 1e-9 * np.abs(found.theta)
        if converged.all():
            return fit_of("iv", regressor, base, found)
    raise not_settled()


def with_instruments(
    regressor: Regressor, base: BaseParameters, instruments: Float[Array, "N nv r"], weights: Float[Array, " nv"]
) -> InfluencedValues:
    """Solution of the equations of a regressor with given instruments.

    Args:
        regressor: The equations.
        base: The unknowns.
        instruments: Regressor on the simulated motion.
        weights: One over the noise of each joint.

    Raises:
        IdentifiabilityError: If the instruments are not correlated with the regressor.
    """
    rows = base_rows(regressor, base)
    factor = factor_of(instruments, weights)
    influence = influence_of(instruments, factor, weights)
    link = np.einsum("njk,njl->kl", influence, rows, optimize=True)
    # If instruments and regressor are equal, the matrix of which the smallest singular value is taken is the identity.
    if np.linalg.svd(factor @ np.linalg.solve(factor.T, link.T).T, compute_uv=False)[-1] < _LEAST_LINK:
        raise IdentifiabilityError(
            "The simulated motion does not follow the recorded one, so that it says nothing about it: check references "
            "and controllers."
        )
    influence = influence @ np.linalg.inv(link).T
    theta = np.einsum("njk,nj->k", influence, regressor.y, optimize=True)
    return values_of_influence(theta, rows, regressor.y, influence, factor, regressor.starts)


@dataclass(frozen=True)
class Endogeneity:
    """Result of the Durbin-Wu-Hausman test.

    Attributes:
        probability: Probability of a chi-squared statistic at least as large if least squares is not biased.
        difference: Estimates of least squares minus those of instrumental variables, shape ``(r,)``.
        scatter: Standard deviations of least squares, shape ``(r,)``.
        names: Names of the base parameters.
    """

    probability: float
    difference: Float[Array, " r"]
    scatter: Float[Array, " r"]
    names: tuple[str, ...]

    def biased(self, level: float = 0.05) -> bool:
        """True if the bias is significant.

        Args:
            level: Probability of a significant result without a bias.
        """
        return self.probability < level

    def sentence(self, level: float = 0.05) -> str:
        """Result of the test in words.

        Args:
            level: Probability of a significant result without a bias.
        """
        p = f"Durbin-Wu-Hausman test, p = {self.probability:.2g}"
        if not self.biased(level):
            return f"Errors of the recorded motion do not bias least squares beyond chance ({p})."
        far = np.abs(self.difference) / self.scatter
        worst = int(np.argmax(far))
        name, size = self.names[worst], f"{far[worst]:.2g} of its standard deviations"
        biased = f"Errors of the recorded motion bias least squares ({p})"
        if far[worst] < _SMALL_BIAS:
            return f"{biased}, but by no more than {size} ({name}): it may stay."
        return f"{biased}, {name} by {size}: use instrumental variables (iv), or record with a finer encoder."


def hausman_test(regressor: Regressor, *, feedback: Feedback | None = None) -> Endogeneity:
    """Durbin-Wu-Hausman test of weighted least squares against instrumental variables, for autocorrelated noise.

    Args:
        regressor: The equations.
        feedback: The controllers; by default those of ``robot.yaml``.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the simulation diverges.
    """
    start = start_of(regressor, feedback)
    found = with_instruments(regressor, start.base, start.simulation.rows(start.base), start.weights)
    rows = base_rows(regressor, start.base)
    influence = influence_of(rows, factor_of(rows, start.weights), start.weights)
    return compared(influence, found, regressor, start.base.base_names)


def compared(
    influence: Float[Array, "N nv r"], found: InfluencedValues, regressor: Regressor, names: tuple[str, ...]
) -> Endogeneity:
    """Result of the test, from both estimates of the same parameters.

    Args:
        influence: Derivative of each least-squares estimate by the torque of each joint at each sample.
        found: Estimates with instruments.
        regressor: The equations.
        names: Names of the parameters.
    """
    difference = np.einsum("njk,nj->k", influence, regressor.y, optimize=True) - found.theta
    least_squares_cov, _, _ = covariances(influence, found.residual, found.sigma, regressor.starts)
    difference_cov, _, _ = covariances(influence - found.influence, found.residual, found.sigma, regressor.starts)
    # The differences are transformed to coordinates in which the least-squares estimates have the covariance identity.
    scale = np.linalg.cholesky(least_squares_cov)
    whitened = np.linalg.solve(scale, np.linalg.solve(scale, difference_cov).T)
    size, axes = np.linalg.eigh(0.5 * (whitened + whitened.T))
    parts = axes.T @ np.linalg.solve(scale, difference)
    kept = size > _EQUAL_VARIANCE
    statistic = float(np.sum(parts[kept] ** 2 / size[kept]))
    freedom = int(kept.sum())
    probability = float(chdtrc(freedom, statistic)) if freedom else 1.0
    scatter = np.sqrt(np.clip(np.diag(least_squares_cov), 0.0, None))
    return Endogeneity(probability, difference, scatter, names)
