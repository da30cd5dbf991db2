"""Ordinary, weighted and robust least squares, which differ only in the weights of the rows.

The equations come from `torque_regressor` (rigid bodies and effects) or `gap_regressor` (effects only). Ordinary least
squares (OLS) gives all rows the same weight. Weighted least squares (WLS) divides the rows of each joint by its noise,
which the previous fit estimates. Iteratively reweighted least squares (IRLS) reduces the weight of outliers.
"""

from __future__ import annotations

import numpy as np

from identification.estimators.fit import Fit, JointNoise, fit_of, values_of_solution
from identification.estimators.linear.least_squares import Solution, base_of, solve
from identification.estimators.linear.scatter import joint_noise, leverage
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import EstimationError, IdentifiabilityError

# The fit is repeated until the relative weights of the joints change by less than this share. One repetition is not
# enough: in the first fit, which has no weights, joints with large torques cause large residuals of the other joints.
_CHANGE = 0.1
PASSES = 8
"""Largest number of fits, including the first one without weights."""
_HUBER = 1.345  # residual, in units of the noise, beyond which the influence is constant; 95 % efficiency
_MAD_OF_NORMAL = 0.6744897501960817  # median of the absolute value of a standard normal


def ols(regressor: Regressor) -> Fit:
    """Base parameters by ordinary least squares.

    Args:
        regressor: The equations.

    Raises:
        IdentifiabilityError: If the recording excites no parameter.
    """
    base = base_of(regressor)
    solution = solve(regressor, base, np.ones_like(regressor.y))
    information = np.ones(regressor.robot.nv)
    sigma = joint_noise(solution.residual, leverage(solution, information))
    noise = JointNoise(sigma, information=information, scatter=sigma**2, score=solution.residual)
    return fit_of("ols", regressor, base, values_of_solution(regressor, base, solution, noise))


def wls(regressor: Regressor) -> Fit:
    """Base parameters by least squares, each joint weighted by the inverse of its noise.

    Args:
        regressor: The equations.

    Raises:
        IdentifiabilityError: If the recording excites no parameter, or has too few equations to estimate the noise.
    """
    base = base_of(regressor)
    noise = sigma = np.ones(regressor.robot.nv)
    solution = solve(regressor, base, np.ones_like(regressor.y))
    for fits in range(1, PASSES + 1):
        sigma = joint_noise(solution.residual, leverage(solution, noise**-2))
        following = floored(sigma, regressor)
        if fits == PASSES or weights_agree(noise, following):
            break
        noise = following
        solution = solve(regressor, base, np.broadcast_to(1 / noise, regressor.y.shape))
    of_joints = JointNoise(sigma, information=noise**-2, scatter=sigma**2 / noise**4, score=solution.residual)
    return fit_of("wls", regressor, base, values_of_solution(regressor, base, solution, of_joints))


def weights_agree(before: Float[Array, " nv"], after: Float[Array, " nv"]) -> bool:
    """True if the noise ``after`` gives the joints the same relative weights as ``before``.

    Args:
        before: Noise of each joint by which a fit was weighted.
        after: Noise of each joint from the residual of the fit.
    """
    ratio = after / before
    return bool(ratio.max() <= (1.0 + _CHANGE) * ratio.min())


def floored(sigma: Float[Array, " nv"], regressor: Regressor) -> Float[Array, " nv"]:
    """Noise from which weights are computed: ``sigma``, but at least 1e-9 of the largest torque of any joint.

    Without this limit, a joint without noise (in a simulation, or without a drive) would have an infinite weight.

    Args:
        sigma: Estimated noise of each joint.
        regressor: The equations, with the torques.

    Raises:
        IdentifiabilityError: If a noise is not known.
    """
    if np.isnan(sigma).any():
        raise IdentifiabilityError(
            f"{regressor.count} samples leave no equation to judge the noise by: record more, or use ordinary least "
            "squares."
        )
    largest = float(np.abs(regressor.measured).max())
    return np.maximum(sigma, 1e-9 * largest if largest > 0 else 1.0)


def irls(regressor: Regressor, *, iterations: int = 100) -> Fit:
    """Base parameters by least squares with bounded influence of outliers (Huber's loss).

    Args:
        regressor: The equations.
        iterations: Largest number of iterations.

    Raises:
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the weights do not converge.
    """
    base = base_of(regressor)
    solution, sigma = _reweighted(regressor, base, solve(regressor, base, np.ones_like(regressor.y)), iterations)
    u = solution.residual / sigma
    psi = u * _huber_weight(u)
    information = (np.abs(u) <= _HUBER).mean(axis=0) / sigma**2
    spread = joint_noise(psi, leverage(solution, information))
    noise = JointNoise(sigma, information=information, scatter=(spread / sigma) ** 2, score=psi)
    return fit_of("irls", regressor, base, values_of_solution(regressor, base, solution, noise))


def _huber_weight(u: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Weight of a residual of ``u`` noise units."""
    return np.minimum(1.0, _HUBER / np.maximum(np.abs(u), 1e-300))


def _reweighted(
    regressor: Regressor, base: BaseParameters, solution: Solution, iterations: int
) -> tuple[Solution, Float[Array, " nv"]]:
    """Converged solution of iteratively reweighted least squares, and the noise of each joint."""
    sigma = _scale(solution, regressor)
    for _ in range(iterations):
        before = solution.theta
        solution = solve(regressor, base, np.sqrt(_huber_weight(solution.residual / sigma)) / sigma)
        sigma = _scale(solution, regressor)
        # The change is measured in torques, so that the units of the parameters do not matter.
        change = np.linalg.norm(solution.factor @ (solution.theta - before))
        if change <= 1e-7 * np.linalg.norm(solution.factor @ solution.theta):
            return solution, sigma
    raise EstimationError(
        f"The weights did not settle within {iterations} iterations: look for a joint with a gross outlier."
    )


def _scale(solution: Solution, regressor: Regressor) -> Float[Array, " nv"]:
    """Noise of each joint from the median absolute residual, which outliers hardly change."""
    return floored(np.median(np.abs(solution.residual), axis=0) / _MAD_OF_NORMAL, regressor)
