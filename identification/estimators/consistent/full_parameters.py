"""All standard parameters from base parameters: those physically possible ones that are nearest to given bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.estimators.consistent.consistent_bodies import reference_bodies
from identification.estimators.consistent.consistent_program import (
    Program,
    is_possible,
    nearest_unconstrained,
    solve_program,
)
from identification.estimators.fit import Fit
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import RegressorTerm
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class FullParameters:
    """All parameters of a robot, physically possible.

    Attributes:
        names: Of all ``p`` columns of the fit.
        pi: Standard parameters of all bodies and coefficients of the effects, shape ``(p,)``.
        theta: Base parameters that they give, shape ``(r,)``.
        moved: How far these are from the fit's, in standard deviations, shape ``(r,)``.
    """

    names: tuple[str, ...]
    pi: Float[Array, " p"]
    theta: Float[Array, " r"]
    moved: Float[Array, " r"]

    def standard(self, first_effect: int) -> Float[Array, "b 10"]:
        """The bodies' part, one row per body in the order of `phantom_dyn.model.inertia.STANDARD_NAMES`."""
        return self.pi[:first_effect].reshape(-1, 10)


def full_parameters(robot: Robot, fit: Fit) -> FullParameters:
    """Possible parameters that fit base parameters best in the sense of their covariance, then nearest to the robot's.

    Args:
        robot: The robot that was fitted; its inertias are the reference.
        fit: Of `torque_regressor` equations.

    Raises:
        ParameterError: If the fit has no rigid body or no covariance.
        EstimationError: If there are none.
    """
    root = covariance_root(fit)
    program = _program(robot, fit, root)
    nearest = nearest_unconstrained(replace(program, factor=selection(fit.base), target=fit.theta))
    return _full(fit, nearest if is_possible(program, nearest) else solve_program(program).pi)


def covariance_root(fit: Fit) -> Float[Array, "r r"]:
    """``B`` with ``B^T B`` the inverse of the covariance of base parameters: equations in units of one deviation each.

    Raises:
        ParameterError: If the fit has no covariance.
    """
    if not np.isfinite(fit.cov).all():
        raise ParameterError("The fit has no covariance, as it has no more equations than unknowns: record more.")
    # A recording without noise leaves rounding errors as deviations, or none at all.
    size = np.abs(fit.theta).max(initial=0.0)
    deviation = np.maximum(fit.std(), 1e-12 * (size if size > 0 else 1.0))
    values, vectors = np.linalg.eigh(fit.cov / np.outer(deviation, deviation))
    return (vectors / np.sqrt(np.maximum(values, 1e-12))).T / deviation


def selection(base: BaseParameters) -> Float[Array, "r p"]:
    """Matrix that turns all parameters into base parameters, see `BaseParameters.values`."""
    out = np.zeros((base.rank, len(base.names)))
    out[range(base.rank), list(base.independent)] = 1.0
    out[:, list(base.dependent)] = base.grouping
    return out


def coefficient_bounds(
    robot: Robot, terms: Sequence[RegressorTerm], names: Sequence[str]
) -> tuple[Float[Array, " e"], Float[Array, " e"]]:
    """Physical bounds of the coefficients of terms, ``-inf`` and ``inf`` where there are none.

    Args:
        robot: Says what friction and rotor inertia is modelled already.
        terms: Of a regressor, in its order.
        names: Of all their coefficients.
    """
    given = []
    for term in terms:
        # The same effect may act twice with two shapes, under one name.
        same = sum(other.label == term.label for other in terms)
        count = sum(name.rpartition(".")[0] == term.label for name in names) // same
        bounds = term.effect.coefficient_bounds(robot, term.joint, term.shape)
        given += list(bounds) if len(bounds) == count else [(-np.inf, np.inf)] * count
    if len(given) != len(names):
        raise ParameterError(f"{len(names)} coefficients belong to terms with {len(given)}: give the terms of the fit.")
    pairs = np.array(given, dtype=float).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _program(robot: Robot, fit: Fit, root: Array) -> Program:
    standard = standard_parameters(robot)
    if fit.first_effect != len(standard):
        raise ParameterError(
            f"The fit has {fit.first_effect} standard parameters and {robot.name} {len(standard)}: give a fit of this "
            "robot with its rigid body among the unknowns."
        )
    lower, upper = coefficient_bounds(robot, fit.effects, fit.base.names[fit.first_effect :])
    return Program(root @ selection(fit.base), root @ fit.theta, reference_bodies(standard), lower, upper)


def _full(fit: Fit, pi: Array) -> FullParameters:
    theta = fit.base.values(pi)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = (theta - fit.theta) / fit.std()
    return FullParameters(fit.base.names, pi, theta, moved)
