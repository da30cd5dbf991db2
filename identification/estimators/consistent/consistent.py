"""Weighted least squares with physically consistent parameters: positive masses, possible inertias, positive friction.

Base parameters do not determine the standard parameters. Of all consistent standard parameters with the fitted base
parameters, those nearest to the bodies of the given robot are returned.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.linalg import block_diag

from identification.estimators.consistent.consistent_bodies import reference_bodies
from identification.estimators.consistent.consistent_program import (
    CHOOSING,
    FREE,
    Program,
    ProgramSolution,
    is_possible,
    nearest_unconstrained,
    solve_program,
)
from identification.estimators.fit import Fit, relative_rms
from identification.estimators.linear.cautions import About, Caution, coefficient_bounds
from identification.estimators.linear.least_squares import base_blocks
from identification.estimators.weighted_least_squares import floored, wls
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from identification.regression.triangular import triangular
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import body_name
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class FullParameters:
    """All parameters of a robot, which are physically consistent.

    Attributes:
        names: Names of all ``p`` parameters.
        pi: Standard parameters of all bodies, then coefficients of the effects, shape ``(p,)``.
        shift: Base parameters of ``pi`` minus the fitted ones, in standard deviations of the fit, shape ``(r,)``.
    """

    names: tuple[str, ...]
    pi: Float[Array, " p"]
    shift: Float[Array, " r"]


def full_parameters(robot: Robot, fit: Fit) -> FullParameters:
    """Consistent parameters nearest to the fitted base parameters, in the metric of the fit's covariance.

    If several are equally near, those nearest to the parameters of the robot are returned.

    Args:
        robot: The robot that was fitted.
        fit: Fit of `torque_regressor` equations.

    Raises:
        ParameterError: If the fit has no rigid body or no covariance.
        EstimationError: If the solver finds no consistent parameters.
    """
    root = covariance_root(fit)
    program = _program(robot, fit, root)
    nearest = nearest_unconstrained(replace(program, factor=selection(fit.base), target=fit.theta))
    return _full(fit, nearest if is_possible(program, nearest) else solve_program(program).pi)


def covariance_root(fit: Fit) -> Float[Array, "r r"]:
    """Square root ``B`` of the information of base parameters: ``B^T B`` is the inverse of their covariance.

    Raises:
        ParameterError: If the fit has no covariance.
    """
    if not np.isfinite(fit.cov).all():
        raise ParameterError("The fit has no covariance, as it has no more equations than unknowns: record more.")
    # The floor avoids a division by zero: without noise the standard deviations are rounding errors or zero.
    size = np.abs(fit.theta).max(initial=0.0)
    deviation = np.maximum(fit.std(), 1e-12 * (size if size > 0 else 1.0))
    values, vectors = np.linalg.eigh(fit.cov / np.outer(deviation, deviation))
    return (vectors / np.sqrt(np.maximum(values, 1e-12))).T / deviation


def selection(base: BaseParameters) -> Float[Array, "r p"]:
    """Matrix that maps all parameters to base parameters."""
    out = np.zeros((base.rank, len(base.names)))
    out[range(base.rank), list(base.independent)] = 1.0
    out[:, list(base.dependent)] = base.grouping
    return out


def _program(robot: Robot, fit: Fit, root: Array) -> Program:
    """The program of parameters nearest to a fit, whose covariance has the inverse ``root^T root``."""
    standard = standard_parameters(robot)
    if fit.first_effect != len(standard):
        raise ParameterError(
            f"The fit has {fit.first_effect} standard parameters and {robot.name} {len(standard)}: give a fit of this "
            "robot with its rigid body among the unknowns."
        )
    lower, upper = coefficient_bounds(robot, fit.effects, fit.base.names[fit.first_effect :])
    return Program(root @ selection(fit.base), root @ fit.theta, reference_bodies(standard), lower, upper)


def _full(fit: Fit, pi: Array) -> FullParameters:
    """All parameters, with the change of the base parameters in standard deviations of the fit."""
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = (fit.base.values(pi) - fit.theta) / fit.std()
    return FullParameters(fit.base.names, pi, shift)


@dataclass(frozen=True, kw_only=True)
class ConsistentFit(Fit):
    """A `Fit` with physically consistent parameters.

    Attributes:
        pi: Standard parameters of all bodies, then coefficients of the effects, shape ``(p,)``. Parameters that the
            recording does not determine are near those of the robot.
        held: One sentence per body or coefficient with an active constraint.
    """

    pi: Float[Array, " p"]
    held: tuple[str, ...] = ()


def consistent(regressor: Regressor, *, prior: float | None = None) -> ConsistentFit:
    """Physically consistent parameters by least squares, each joint weighted by the inverse of its noise.

    Args:
        regressor: The equations, with inertial parameters among the unknowns. The prior is about the parameters of its
            robot.
        prior: Weight of the prior, see `Program`. By default the prior only decides among parameters that fit equally
            well.

    Raises:
        ParameterError: If inertial parameters are not among the unknowns.
        IdentifiabilityError: If the recording excites no parameter, or has too few equations to estimate the noise.
        EstimationError: If the solver fails.
    """
    if not regressor.rigid_body:
        raise ParameterError("The equations hold no rigid body: make them with torque_regressor.")
    free = replace(wls(regressor), estimator="consistent")
    kept = free.base.independent
    weighted = regressor.reduction.weighted(1 / floored(free.sigma, regressor))
    factor = triangular(np.concatenate(weighted.rows(kept)))[: len(kept), : len(kept)]
    robot = regressor.robot
    bounds = coefficient_bounds(robot, regressor.terms, regressor.names[regressor.first_effect :])
    bodies = reference_bodies(standard_parameters(robot))
    weight = CHOOSING if prior is None else prior
    program = Program(factor @ selection(free.base), factor @ free.theta, bodies, *bounds, weight)
    nearest = nearest_unconstrained(program)
    chosen = prior is None and is_possible(program, nearest)
    solution = ProgramSolution(nearest) if chosen else solve_program(program)
    return _constrained(free, regressor, program, solution, prior)


def _constrained(
    free: Fit, regressor: Regressor, program: Program, solution: ProgramSolution, prior: float | None
) -> ConsistentFit:
    """The unconstrained fit, with its parameters replaced by the solution of the constrained program."""
    held = _held_sentences(regressor, solution)
    fit = replace(free, theta=free.base.values(solution.pi))
    if held or prior is not None:
        residual = np.empty_like(regressor.y)
        for at, block in base_blocks(regressor, fit.base):
            residual[at] = regressor.y[at] - block @ fit.theta
        fit = replace(fit, relative_error=100 * relative_rms(residual, regressor.measured))
    if prior is not None:
        fit = replace(fit, cov=_shrunk(free, program, free.cov), cov_white=_shrunk(free, program, free.cov_white))
    if held:
        at_bound = {regressor.names[regressor.first_effect + at] for at in solution.held_bounds}
        without = "The deviations are those without these constraints: the true ones are smaller, and not symmetric."
        cautions = (
            # The sentences in `held` already state that a value is at its bound.
            *(one for one in free.cautions if one.about is not About.BOUND or at_bound.isdisjoint(one.names)),
            *map(Caution, (*held, without)),
        )
        fit = replace(fit, cautions=cautions)
    shared = {field.name: getattr(fit, field.name) for field in fields(Fit)}
    return ConsistentFit(**shared, pi=solution.pi, held=held)


def _shrunk(free: Fit, program: Program, covariance: Array) -> Array:
    r"""Covariance of an estimate with a prior, from the noise and from the error of the prior.

    With the information ``A`` of the equations and ``H`` of the prior, it is
    :math:`S (A + H)^{-1} (A_\theta C A_\theta + H) (A + H)^{-1} S^T`.
    """
    free_columns = program.factor.shape[1] - 10 * len(program.bodies)
    metrics = [np.sqrt(program.weight) * body.metric for body in program.bodies]
    prior = np.asarray(block_diag(*metrics, np.zeros((0, free_columns))))
    equations = program.factor * program.scale
    finite = FREE * np.eye(len(program.scale))[10 * len(program.bodies) :]
    # The triangular factor is inverted, not the normal matrix, whose entries would range from 1 to 1e18.
    triangle = np.linalg.qr(np.vstack([equations, prior, finite]), mode="r")
    inverse = np.linalg.inv(triangle)
    out = (selection(free.base) * program.scale) @ inverse
    # Scatter of the normal equations, A C A in base parameters.
    base_factor = program.factor[:, list(free.base.independent)]
    scatter = base_factor @ covariance @ base_factor.T
    by_noise = equations @ inverse
    by_prior = prior @ inverse
    total = out @ (by_noise.T @ scatter @ by_noise + by_prior.T @ by_prior) @ out.T
    return 0.5 * (total + total.T)


def _held_sentences(regressor: Regressor, solution: ProgramSolution) -> tuple[str, ...]:
    """One sentence per body or coefficient with an active constraint."""
    robot, names = regressor.robot, regressor.names[regressor.first_effect :]
    coefficients = solution.pi[regressor.first_effect :]
    out = [
        f"{body_name(robot, at + 1)}: the recording alone asks for a body that cannot exist; its mass distribution is "
        "held at the edge of the possible."
        for at in solution.held_bodies
    ]
    out += [
        f"{names[at]} is held at its bound of {coefficients[at] if abs(coefficients[at]) > 1e-9 else 0:g}: the "
        "recording alone asks for a value beyond it."
        for at in solution.held_bounds
    ]
    return tuple(out)
