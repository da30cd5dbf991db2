"""Least squares from a `Reduction`: no sample is looked at again, so that it takes milliseconds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from identification.estimators.linear.least_squares import Solution, joint_grams, solve_factor
from identification.estimators.linear.scatter import leverage, sandwich, white_scatter
from identification.regression.base_parameters import RANK_TOLERANCE, BaseParameters, base_parameters_of_matrix
from identification.regression.reduction import Reduction
from identification.regression.regressor import EffectOnJoint, torque_regressor
from identification.regression.triangular import triangular
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import IdentifiabilityError, ParameterError
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class ReducedFit:
    """Ordinary least squares of a reduction.

    Attributes:
        theta: Base parameters, shape ``(r,)``.
        cov: Covariance if every sample's noise were independent, ``(r, r)``: a reduction does not hold the
            memory of the noise, which makes the true one larger (see `coloured_scatter`).
        sigma: Noise of each joint's torque, times its weight if there is one, shape ``(nv,)``; nan where no equation
            is left over.
        base: The unknowns, and how all parameters regroup.
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
    """The reduction of each log, one log at a time: `identification.regression.reduction.combined` makes one of them.

    Args:
        robot: Gives the rigid body.
        logs: May be a generator that reads them one by one; none is kept.
        effects: What acts on the joints beside the rigid body.
    """
    for log in logs:
        yield torque_regressor(robot, log, effects).reduction


def base_of_reduction(reduction: Reduction, *, tolerance: float = RANK_TOLERANCE) -> BaseParameters:
    """Base parameters that a reduction determines.

    Args:
        reduction: Of one recording or several.
        tolerance: Share of the largest column of its unit that an independent column adds.
    """
    factor = reduction.factor()[:, :-1]
    return base_parameters_of_matrix(factor, reduction.names, reduction.units, tolerance=tolerance)


def refit(reduction: Reduction, base: BaseParameters | None = None) -> ReducedFit:
    """Ordinary least squares of all equations in a reduction.

    Args:
        reduction: Of one recording or several, with weights or without.
        base: The unknowns, if they are to stay those of another fit; by default those that this reduction determines.

    Raises:
        IdentifiabilityError: If it determines no parameter, or not those of ``base``.
        ParameterError: If ``base`` is of other columns.
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
    spare = reduction.samples - leverage(solution, ones)
    left = spare > 1e-6 * reduction.samples
    squares = np.array([np.sum((joint[:, -1] - joint[:, :-1] @ theta) ** 2) for joint in rows])
    sigma = np.sqrt(np.where(left, squares, np.nan) / np.where(left, spare, 1.0))
    return ReducedFit(
        theta, sandwich(solution, ones, white_scatter(solution, sigma**2)), sigma, base, reduction.samples
    )
