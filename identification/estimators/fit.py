"""Result of an estimator: base parameters with their uncertainty, and the torque that they predict.

`refit` fits a `Reduction` (triangular factors of the equations) instead of samples, in milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from identification.data.log import Band, Log
from identification.engine.autocorrelation import integrated_autocorrelation_time
from identification.estimators.linear.cautions import Caution, cautions, condition_of, misfit_sentences
from identification.estimators.linear.least_squares import Solution, joint_grams, solve_factor
from identification.estimators.linear.scatter import (
    autocorrelation,
    coloured_scatter,
    covariances,
    leverage,
    noise_of_squares,
    residual_noise,
    sandwich,
    white_scatter,
)
from identification.regression.base_parameters import BaseParameters, base_of_reduction
from identification.regression.reduction import Reduction
from identification.regression.regressor import (
    EffectOnJoint,
    Regressor,
    RegressorTerm,
    gap_regressor,
    known_torque,
    torque_regressor,
)
from identification.regression.triangular import triangular
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import IdentifiabilityError, ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


@dataclass(frozen=True)
class Fit:
    """Estimated base parameters.

    Attributes:
        estimator: Name in `identification.estimators.estimator_list.ESTIMATORS`.
        theta: Base parameters, shape ``(r,)``.
        cov: Covariance, with the autocorrelation of the residual taken into account, shape ``(r, r)``.
        cov_white: Covariance if the noise of all samples were independent, shape ``(r, r)``.
        names: Names of the base parameters.
        units: Units of the base parameters.
        sigma: Noise of each joint's torque, shape ``(nv,)``.
        correlation: Number of samples per independent sample of each joint's residual, shape ``(nv,)``.
        relative_error: Root mean square of the residual divided by that of the measured torque [%], shape ``(nv,)``.
        cond: Condition number of the weighted base regressor with columns of norm one.
        base: Base parameters, with the regrouping of all parameters.
        effects: The terms that were fitted.
        first_effect: Index of the first column that belongs to an effect.
        samples: Number of samples.
        cautions: Warnings on the use of the fit.
    """

    estimator: str
    theta: Float[Array, " r"]
    cov: Float[Array, "r r"]
    cov_white: Float[Array, "r r"]
    names: tuple[str, ...]
    units: tuple[str, ...]
    sigma: Float[Array, " nv"]
    correlation: Float[Array, " nv"]
    relative_error: Float[Array, " nv"]
    cond: float
    base: BaseParameters
    effects: tuple[RegressorTerm, ...]
    first_effect: int
    samples: int
    cautions: tuple[Caution, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """The sentences of `cautions`."""
        return tuple(caution.sentence for caution in self.cautions)

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.theta)

    @property
    def rigid_body(self) -> bool:
        """True if inertial parameters were unknowns as well."""
        return self.first_effect > 0

    def std(self) -> Float[Array, " r"]:
        """Standard deviations, shape ``(r,)``."""
        return np.sqrt(np.diag(self.cov))

    def predict(self, robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
        """Drive torque for a motion, not filtered [N m or N], shape ``(N, nv)``.

        Args:
            robot: The robot that was fitted.
            motion: N samples.
        """
        given = [(term.effect, term.joint, term.shape) for term in self.effects]
        regressor_of = torque_regressor if self.rigid_body else gap_regressor
        regressor = regressor_of(robot, unfiltered_log(robot, motion), given)
        out = [block[:, :, list(self.base.independent)] @ self.theta for block in regressor.blocks()]
        return np.concatenate(out) + known_torque(robot, motion, rigid_body=self.rigid_body)


def unfiltered_log(robot: Robot, motion: Motion) -> Log:
    """A log of a motion without torque and filter, for the regressor on all its samples."""
    all_valid = np.ones(len(motion.t), dtype=bool)
    return Log("motion", robot.joint_names, motion, np.zeros_like(motion.q), Band(1.0, 0.5, np.ones(1), 1), all_valid)


@dataclass(frozen=True)
class Values:
    """Values of base parameters with their covariance, and the residual from which the covariance is estimated.

    Attributes:
        theta: Base parameters, shape ``(r,)``.
        cov: Covariance, with the autocorrelation of the residual taken into account, shape ``(r, r)``.
        cov_white: Covariance if the noise of all samples were independent, shape ``(r, r)``.
        sigma: Noise of each joint's torque, shape ``(nv,)``.
        correlation: Number of samples per independent sample of each joint's residual, shape ``(nv,)``.
        residual: Residual torque, shape ``(N, nv)``.
        factor: Triangular factor of the weighted equations that determined the values, shape ``(r, r)``.
    """

    theta: Float[Array, " r"]
    cov: Float[Array, "r r"]
    cov_white: Float[Array, "r r"]
    sigma: Float[Array, " nv"]
    correlation: Float[Array, " nv"]
    residual: Float[Array, "N nv"]
    factor: Float[Array, "r r"]

    @property
    def std(self) -> Float[Array, " r"]:
        """Standard deviations; zero if they are not known."""
        return np.sqrt(np.nan_to_num(np.diag(self.cov)))


@dataclass(frozen=True)
class InfluencedValues(Values):
    """Values of an estimator whose estimates are linear in the noise of the torque.

    Attributes:
        influence: Derivative of each estimate by the torque of each joint at each sample, shape ``(N, nv, r)``.
    """

    influence: Float[Array, "N nv r"]


@dataclass(frozen=True)
class JointNoise:
    """Noise of each joint, as an estimator models it.

    Attributes:
        sigma: Noise of each joint's torque, shape ``(nv,)``.
        information: Squared weight of each joint's rows, see `sandwich`, shape ``(nv,)``.
        scatter: Variance of each joint's score, see `sandwich`, shape ``(nv,)``.
        score: Residual as it enters the normal equations, shape ``(N, nv)``; a robust estimator limits it.
    """

    sigma: Float[Array, " nv"]
    information: Float[Array, " nv"]
    scatter: Float[Array, " nv"]
    score: Float[Array, "N nv"]


def values_of_solution(regressor: Regressor, base: BaseParameters, solution: Solution, noise: JointNoise) -> Values:
    """Values and sandwich covariance of a weighted least-squares solution.

    Args:
        regressor: The equations.
        base: The unknowns.
        solution: Values and residuals.
        noise: Noise of each joint.
    """
    rho = [autocorrelation(column, regressor.starts) for column in noise.score.T]
    coloured = coloured_scatter(regressor, base, solution, noise.scatter, rho)
    return Values(
        theta=solution.theta,
        cov=sandwich(solution, noise.information, coloured),
        cov_white=sandwich(solution, noise.information, white_scatter(solution, noise.scatter)),
        sigma=noise.sigma,
        correlation=np.array([integrated_autocorrelation_time(lags) for lags in rho]),
        residual=solution.residual,
        factor=solution.factor,
    )


def values_of_influence(
    theta: Float[Array, " r"],
    rows: Float[Array, "N nv r"],
    target: Float[Array, "N nv"],
    influence: Float[Array, "N nv r"],
    factor: Float[Array, "r r"],
    starts: tuple[int, ...],
) -> InfluencedValues:
    """Values of an estimator that is linear in the noise, with their covariance.

    Args:
        theta: Base parameters.
        rows: Regressor of the unknowns.
        target: Right-hand side of the equations.
        influence: Derivative of each value by the torque of each joint at each sample.
        factor: Triangular factor of the weighted equations.
        starts: Index of the first sample of each recording, and last N.
    """
    residual = target - rows @ theta
    sigma = residual_noise(rows, influence, residual)
    cov, white, correlation = covariances(influence, residual, sigma, starts)
    return InfluencedValues(theta, cov, white, sigma, correlation, residual, factor, influence)


def fit_of(
    estimator: str,
    regressor: Regressor,
    base: BaseParameters,
    values: Values,
) -> Fit:
    """The `Fit` that has the given values, with its errors and warnings.

    Args:
        estimator: Name of the estimator.
        regressor: The equations.
        base: The unknowns.
        values: Values of the unknowns.
    """
    error = 100 * relative_rms(values.residual, regressor.measured)
    general = cautions(regressor, base, values.theta, np.sqrt(np.diag(values.cov)), values.factor)
    return Fit(
        estimator=estimator,
        theta=values.theta,
        cov=values.cov,
        cov_white=values.cov_white,
        names=base.base_names,
        units=base.base_units,
        sigma=values.sigma,
        correlation=values.correlation,
        relative_error=error,
        cond=condition_of(values.factor),
        base=base,
        effects=regressor.terms,
        first_effect=regressor.first_effect,
        samples=regressor.count,
        cautions=(*map(Caution, misfit_sentences(regressor.robot, error)), *general),
    )


def relative_rms(residual: Float[Array, "N nv"], measured: Float[Array, "N nv"]) -> Float[Array, " nv"]:
    """Root mean square of each joint's residual divided by that of its measured torque; NaN without torque."""
    rms, size = (np.sqrt(np.mean(values**2, axis=0)) for values in (residual, measured))
    return np.divide(rms, size, out=np.full(len(rms), np.nan), where=size > 0)


@dataclass(frozen=True)
class ReducedFit:
    """Ordinary least squares of a reduction.

    Attributes:
        theta: Base parameters, shape ``(r,)``.
        cov: Covariance if the noise of all samples were independent, ``(r, r)``. The true covariance is larger, because
            noise is autocorrelated; a reduction does not contain the autocorrelation.
        sigma: Noise of each joint's torque, times its weight if there is one, shape ``(nv,)``; NaN if there are no more
            equations than unknowns.
        base: The unknowns, with the regrouping of all parameters.
        samples: Number of samples.
    """

    theta: Float[Array, " r"]
    cov: Float[Array, "r r"]
    sigma: Float[Array, " nv"]
    base: BaseParameters
    samples: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters."""
        return self.base.base_names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the base parameters."""
        return self.base.base_units

    def std(self) -> Float[Array, " r"]:
        """Standard deviations, shape ``(r,)``."""
        return np.sqrt(np.diag(self.cov))


def reductions(robot: Robot, logs: Iterable[Log], effects: Sequence[EffectOnJoint] = ()) -> Iterator[Reduction]:
    """The reduction of each log; `identification.regression.reduction.combined` combines them.

    Args:
        robot: The robot.
        logs: Logs, or a generator that reads them one by one; no log is kept.
        effects: Effects on the joints in addition to the rigid bodies.
    """
    for log in logs:
        yield torque_regressor(robot, log, effects).reduction


def refit(reduction: Reduction, base: BaseParameters | None = None) -> ReducedFit:
    """Ordinary least squares of all equations in a reduction.

    Args:
        reduction: Reduction of one recording or several, with weights or without.
        base: The unknowns; by default those that this reduction determines.

    Raises:
        IdentifiabilityError: If it determines no parameter, or not those of ``base``.
        ParameterError: If ``base`` has other columns.
    """
    if base is None:
        base = base_of_reduction(reduction)
    elif base.names != reduction.names:
        raise ParameterError("The base parameters are those of other columns: give those of this reduction, or none.")
    if not base.rank:
        raise IdentifiabilityError("The recordings excite no parameter: record a motion that moves the joints.")
    rows = reduction.rows(base.independent)
    theta, square = solve_factor(triangular(np.concatenate(rows)))
    solution = Solution(theta, square, np.empty((0, len(rows))), joint_grams(rows, square))
    ones = np.ones(len(rows))
    squares = np.array([np.sum((joint[:, -1] - joint[:, :-1] @ theta) ** 2) for joint in rows])
    sigma = noise_of_squares(squares, reduction.samples, leverage(solution, ones))
    cov = sandwich(solution, ones, white_scatter(solution, sigma**2))
    return ReducedFit(theta, cov, sigma, base, reduction.samples)
