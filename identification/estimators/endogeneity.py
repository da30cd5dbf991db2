"""Durbin-Wu-Hausman test: do errors of the recorded motion (noise, filters, derivatives) bias least squares?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from identification.estimators.closed_loop.loop import Feedback
from identification.estimators.closed_loop.simulated_start import start_of
from identification.estimators.iv import with_instruments
from identification.estimators.judged_values import Judged
from identification.estimators.linear.rows import base_rows, covariances, factor_of, influence_of
from identification.regression.regressor import Regressor

Array = np.ndarray

# Directions in which both estimates agree by construction (a constant is its own instrument) hold this share of the
# variance of least squares, or less.
_SAME = 1e-8
_MATTERS = 0.5  # standard deviations of least squares below which a bias is lost in its interval


@dataclass(frozen=True)
class Endogeneity:
    """Outcome of the test.

    Attributes:
        statistic: Chi-squared under the hypothesis that least squares is not biased.
        freedom: Its degrees of freedom.
        probability: Of a statistic at least as large without bias.
        difference: Least squares minus instrumental variables, shape ``(r,)``.
        std: Standard deviations of the differences without bias, shape ``(r,)``.
        scatter: Standard deviations of least squares, shape ``(r,)``.
        names: Of the base parameters.
    """

    statistic: float
    freedom: int
    probability: float
    difference: Float[Array, " r"]
    std: Float[Array, " r"]
    scatter: Float[Array, " r"]
    names: tuple[str, ...]

    def biased(self, level: float = 0.05) -> bool:
        """True if the bias is beyond chance.

        Args:
            level: Share of sound recordings for which it is true all the same.
        """
        return self.probability < level

    def sentence(self, level: float = 0.05) -> str:
        """What the test says, in words.

        Args:
            level: See `biased`.
        """
        p = f"Durbin-Wu-Hausman test, p = {self.probability:.2g}"
        if not self.biased(level):
            return f"Errors of the recorded motion do not bias least squares beyond chance ({p})."
        far = np.abs(self.difference) / self.scatter
        worst = int(np.argmax(far))
        name, size = self.names[worst], f"{far[worst]:.2g} of its standard deviations"
        biased = f"Errors of the recorded motion bias least squares ({p})"
        if far[worst] < _MATTERS:
            return f"{biased}, but by no more than {size} ({name}): it may stay."
        return f"{biased}, {name} by {size}: use instrumental variables (iv), or record with a finer encoder."


def hausman_test(regressor: Regressor, *, feedback: Feedback | None = None) -> Endogeneity:
    """Test of weighted least squares against instrumental variables, robust against coloured noise.

    Args:
        regressor: The equations.
        feedback: The controllers, where the robot does not state them.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the simulated robot cannot move.
    """
    start = start_of(regressor, feedback)
    found = with_instruments(regressor, start.base, start.simulation.rows(start.base), start.weights)
    rows = base_rows(regressor, start.base)
    influence = influence_of(rows, factor_of(rows, start.weights), start.weights)
    return compared(influence, found, regressor, start.base.base_names)


def compared(
    influence: Float[Array, "N nv r"], found: Judged, regressor: Regressor, names: tuple[str, ...]
) -> Endogeneity:
    """The test from both estimates of the same parameters.

    Args:
        influence: By how much the noise of each joint at each sample moves the estimates of least squares.
        found: Those with instruments.
        regressor: The equations.
        names: Of the parameters.
    """
    difference = np.einsum("njk,nj->k", influence, regressor.y, optimize=True) - found.theta
    own, _, _ = covariances(influence, found.residual, found.sigma, regressor.starts)
    apart, _, _ = covariances(influence - found.influence, found.residual, found.sigma, regressor.starts)
    # In units in which the estimates of least squares scatter by one, independently.
    scale = np.linalg.cholesky(own)
    whitened = np.linalg.solve(scale, np.linalg.solve(scale, apart).T)
    size, axes = np.linalg.eigh(0.5 * (whitened + whitened.T))
    parts = axes.T @ np.linalg.solve(scale, difference)
    kept = size > _SAME
    statistic = float(np.sum(parts[kept] ** 2 / size[kept]))
    freedom = int(kept.sum())
    probability = float(chi2.sf(statistic, freedom)) if freedom else 1.0
    std, scatter = (np.sqrt(np.clip(np.diag(cov), 0.0, None)) for cov in (apart, own))
    return Endogeneity(statistic, freedom, probability, difference, std, scatter, names)
