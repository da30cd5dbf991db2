"""Values of base parameters with how sure they are, from what each sample's noise does to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.estimators.fit import Fit, Status, fit_of
from identification.estimators.linear.rows import covariances, noise_left
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor

Array = np.ndarray


@dataclass(frozen=True)
class Judged:
    """Values and their covariance.

    Attributes:
        theta: Base parameters, shape ``(r,)``.
        cov: Covariance with the memory of the residual.
        cov_white: Covariance if every sample's noise were independent.
        sigma: Noise of each joint.
        correlation: Samples per independent sample of each joint's residual.
        residual: Torque that is left.
        influence: By how much the noise of each joint at each sample moves each estimate.
        factor: Triangular factor of the weighted equations.
    """

    theta: Float[Array, " r"]
    cov: Float[Array, "r r"]
    cov_white: Float[Array, "r r"]
    sigma: Float[Array, " nv"]
    correlation: Float[Array, " nv"]
    residual: Float[Array, "N nv"]
    influence: Float[Array, "N nv r"]
    factor: Float[Array, "r r"]

    @property
    def std(self) -> Float[Array, " r"]:
        """Standard deviations; zero where they are not known."""
        return np.sqrt(np.nan_to_num(np.diag(self.cov)))

    def fit(self, estimator: str, regressor: Regressor, base: BaseParameters, status: Status) -> Fit:
        """As the common result."""
        return fit_of(
            estimator,
            regressor,
            base,
            self.theta,
            cov=self.cov,
            cov_white=self.cov_white,
            sigma=self.sigma,
            correlation=self.correlation,
            residual=self.residual,
            factor=self.factor,
            status=status,
        )


def judged(
    theta: Float[Array, " r"],
    rows: Float[Array, "N nv r"],
    target: Float[Array, "N nv"],
    influence: Float[Array, "N nv r"],
    factor: Float[Array, "r r"],
    starts: tuple[int, ...],
) -> Judged:
    """Values with the covariance that the noise which they leave gives them.

    Args:
        theta: The values.
        rows: Of the unknowns.
        target: What the rows times the values are to be.
        influence: By how much the noise of each joint at each sample moves each value.
        factor: Triangular factor of the weighted equations.
        starts: First sample of each recording, and N.
    """
    residual = target - rows @ theta
    sigma = noise_left(rows, influence, residual)
    cov, white, correlation = covariances(influence, residual, sigma, starts)
    return Judged(theta, cov, white, sigma, correlation, residual, influence, factor)
