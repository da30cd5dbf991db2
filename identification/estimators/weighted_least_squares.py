"""Ordinary, weighted and robust least squares: they differ in the weight of a row alone.

Ordinary least squares (OLS) counts every row alike. Weighted least squares (WLS) divides each joint by its own noise,
which the fits before estimate. Iteratively reweighted least squares (IRLS) lets rows far outside the noise count less,
or not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from identification.data.log import Log
from identification.estimators.fit import Fit, JointNoise, Status, fit_of, values_of_solution
from identification.estimators.linear.least_squares import Solution, base_of, solve
from identification.estimators.linear.scatter import joint_noise, leverage
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import EstimationError, IdentifiabilityError
from phantom_dyn.model.robot import Robot

# In a fit without weights a joint of small torque gets the residual of the others, and keeps much of it in the first
# fit with weights: fits go on until no joint's noise moves by a tenth against the others'.
_CHANGE = 0.1
PASSES = 8
"""Most fits of weighted least squares, the one without weights included."""
_MAD_OF_NORMAL = 0.6744897501960817  # median of the absolute value of a standard normal


def fit_ols(robot: Robot, logs: Log | Sequence[Log], effects: Sequence[EffectOnJoint] = ()) -> Fit:
    """Base parameters of the rigid body and the effects by ordinary least squares.

    Args:
        robot: Gives the rigid body.
        logs: One recording or several.
        effects: What acts on the joints beside the rigid body.

    Raises:
        IdentifiabilityError: If the recording excites no parameter.
    """
    return ols(torque_regressor(robot, logs, effects))


def ols(regressor: Regressor) -> Fit:
    """`fit_ols` on equations that are made already (`gap_regressor` for the effects alone).

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


def fit_wls(robot: Robot, logs: Log | Sequence[Log], effects: Sequence[EffectOnJoint] = ()) -> Fit:
    """Base parameters of the rigid body and the effects, each joint weighted by its noise.

    Args:
        robot: Gives the rigid body.
        logs: One recording or several.
        effects: What acts on the joints beside the rigid body.

    Raises:
        IdentifiabilityError: If the recording excites no parameter, or leaves no equation to judge the noise by.
    """
    return wls(torque_regressor(robot, logs, effects))


def wls(regressor: Regressor) -> Fit:
    """`fit_wls` on equations that are made already (`gap_regressor` for the effects alone).

    Args:
        regressor: The equations.

    Raises:
        IdentifiabilityError: If the recording excites no parameter, or leaves no equation to judge the noise by.
    """
    base = base_of(regressor)
    noise = sigma = np.ones(regressor.robot.nv)
    solution = solve(regressor, base, np.ones_like(regressor.y))
    for again in reversed(range(PASSES)):
        sigma = joint_noise(solution.residual, leverage(solution, noise**-2))
        following = floored(sigma, regressor)
        if not again or settled(noise, following):
            break
        noise = following
        solution = solve(regressor, base, np.broadcast_to(1 / noise, regressor.y.shape))
    of_joints = JointNoise(sigma, information=noise**-2, scatter=sigma**2 / noise**4, score=solution.residual)
    return fit_of("wls", regressor, base, values_of_solution(regressor, base, solution, of_joints))


def settled(before: Float[Array, " nv"], after: Float[Array, " nv"]) -> bool:
    """True if another fit with the noise ``after`` would weigh the joints as the one with ``before`` did.

    Args:
        before: Noise of each joint that a fit was weighted by.
        after: Noise that it has left.
    """
    ratio = after / before
    return bool(ratio.max() <= (1.0 + _CHANGE) * ratio.min())


def floored(sigma: Float[Array, " nv"], regressor: Regressor) -> Float[Array, " nv"]:
    """Noise to weigh joints by: ``sigma``, but at least 1e-9 of the largest torque of any joint.

    A joint without noise (a simulation, or one that is not driven) would else get infinite weight.

    Args:
        sigma: Estimated noise of each joint.
        regressor: Gives the torques.

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


@dataclass(frozen=True)
class RobustLoss:
    """Weight of a residual of ``u`` noise units, and the slope of ``psi(u) = u weight(u)``."""

    weight: Callable[[Array], Array]
    slope: Callable[[Array], Array]


# Both are 95 % efficient on normal noise (the usual tuning constants).
HUBER = RobustLoss(
    lambda u: np.minimum(1.0, 1.345 / np.maximum(np.abs(u), 1e-300)),
    lambda u: (np.abs(u) <= 1.345).astype(float),
)
BISQUARE = RobustLoss(
    lambda u: np.where(np.abs(u) < 4.685, (1 - (u / 4.685) ** 2) ** 2, 0.0),
    lambda u: np.where(np.abs(u) < 4.685, (1 - (u / 4.685) ** 2) * (1 - 5 * (u / 4.685) ** 2), 0.0),
)


def fit_irls(
    robot: Robot,
    logs: Log | Sequence[Log],
    effects: Sequence[EffectOnJoint] = (),
    *,
    loss: RobustLoss = HUBER,
    iterations: int = 100,
    on_failure: Literal["raise", "return"] = "raise",
) -> Fit:
    """Base parameters of the rigid body and the effects, robust against outliers.

    Args:
        robot: Gives the rigid body.
        logs: One recording or several.
        effects: What acts on the joints beside the rigid body.
        loss: `HUBER` bounds an outlier's pull; `BISQUARE` ends it.
        iterations: Most there may be.
        on_failure: What to do where the weights do not settle.

    Raises:
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the weights do not settle and ``on_failure`` is ``raise``.
    """
    return irls(torque_regressor(robot, logs, effects), loss=loss, iterations=iterations, on_failure=on_failure)


def irls(
    regressor: Regressor,
    *,
    loss: RobustLoss = HUBER,
    iterations: int = 100,
    on_failure: Literal["raise", "return"] = "raise",
) -> Fit:
    """`fit_irls` on equations that are made already (`gap_regressor` for the effects alone).

    Args:
        regressor: The equations.
        loss: `HUBER` bounds an outlier's pull; `BISQUARE` ends it.
        iterations: Most there may be.
        on_failure: What to do where the weights do not settle.

    Raises:
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the weights do not settle and ``on_failure`` is ``raise``.
    """
    base = base_of(regressor)
    solution = solve(regressor, base, np.ones_like(regressor.y))
    # A loss that ends the pull of outliers has several minima: it starts from the one that only bounds it.
    solution, sigma, settled = _reweighted(regressor, base, solution, HUBER, iterations)
    if loss is not HUBER:
        solution, sigma, settled = _reweighted(regressor, base, solution, loss, iterations)
    status = Status.SOLVED if settled else Status.NOT_CONVERGED
    if not settled and on_failure == "raise":
        raise EstimationError(f"{status.value} ({iterations} iterations)")
    u = solution.residual / sigma
    psi = u * loss.weight(u)
    information = loss.slope(u).mean(axis=0) / sigma**2
    spread = joint_noise(psi, leverage(solution, information))
    noise = JointNoise(sigma, information=information, scatter=(spread / sigma) ** 2, score=psi)
    return fit_of("irls", regressor, base, values_of_solution(regressor, base, solution, noise), status=status)


def _reweighted(
    regressor: Regressor, base: BaseParameters, solution: Solution, loss: RobustLoss, iterations: int
) -> tuple[Solution, Float[Array, " nv"], bool]:
    sigma = _scale(solution, regressor)
    for _ in range(iterations):
        before = solution.theta
        weights = np.sqrt(loss.weight(solution.residual / sigma)) / sigma
        solution = solve(regressor, base, weights)
        sigma = _scale(solution, regressor)
        # Relative to the torque that the parameters produce, so that their units do not matter.
        change = np.linalg.norm(solution.factor @ (solution.theta - before))
        if change <= 1e-7 * np.linalg.norm(solution.factor @ solution.theta):
            return solution, sigma, True
    return solution, sigma, False


def _scale(solution: Solution, regressor: Regressor) -> Float[Array, " nv"]:
    """Noise of each joint from the median of the absolute residual, which half of the samples cannot spoil."""
    return floored(np.median(np.abs(solution.residual), axis=0) / _MAD_OF_NORMAL, regressor)
