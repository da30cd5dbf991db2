"""Weighted least squares among what is physically possible: no negative mass, no impossible inertia or friction."""

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
from identification.estimators.consistent.full_parameters import coefficient_bounds, selection
from identification.estimators.fit import Fit
from identification.estimators.linear.cautions import About, Caution
from identification.estimators.linear.least_squares import base_blocks
from identification.estimators.weighted_least_squares import floored, wls
from identification.regression.regressor import Regressor
from identification.regression.triangular import triangular
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import body_name


@dataclass(frozen=True, kw_only=True)
class ConsistentFit(Fit):
    """A `Fit` whose base parameters belong to bodies that can exist.

    Attributes:
        pi: Standard parameters of all bodies, then the coefficients of the effects, shape ``(p,)``; those that the
            recording cannot tell apart are nearest to the robot's.
        held: One sentence per body or coefficient that a constraint holds; empty where none acts.
    """

    pi: Float[Array, " p"]
    held: tuple[str, ...] = ()


def consistent(regressor: Regressor, *, prior: float | None = None) -> ConsistentFit:
    """Physically possible parameters, each joint weighted by its noise; friction and rotor inertia is not negative.

    Args:
        regressor: The equations, with the rigid body among the unknowns; its robot is the reference of the prior.
        prior: How strongly bodies are drawn to the robot's, see `Program`; None: only among those that fit equally
            well.

    Raises:
        ParameterError: If the rigid body is not among the unknowns.
        IdentifiabilityError: If the recording excites no parameter, or leaves no equation to judge the noise by.
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
    return _moved(free, regressor, program, solution, prior)


def _moved(
    free: Fit, regressor: Regressor, program: Program, solution: ProgramSolution, prior: float | None
) -> ConsistentFit:
    """The unconstrained fit, moved to the solution of the program."""
    held = _held_sentences(regressor, solution)
    fit = replace(free, theta=free.base.values(solution.pi))
    if held or prior is not None:
        fit = replace(fit, relative_error=_relative_error(regressor, fit))
    if prior is not None:
        fit = replace(fit, cov=_shrunk(free, program, free.cov), cov_white=_shrunk(free, program, free.cov_white))
    if held:
        moved = {regressor.names[regressor.first_effect + at] for at in solution.held_bounds}
        without = "The deviations are those without these constraints: the true ones are smaller, and not symmetric."
        cautions = (
            # That the free value is at its bound says the same as the sentence on the constraint.
            *(one for one in free.cautions if one.about is not About.BOUND or moved.isdisjoint(one.names)),
            *map(Caution, (*held, without)),
        )
        fit = replace(fit, cautions=cautions)
    shared = {field.name: getattr(fit, field.name) for field in fields(Fit)}
    return ConsistentFit(**shared, pi=solution.pi, held=held)


def _relative_error(regressor: Regressor, fit: Fit) -> Float[Array, " nv"]:
    """Root mean square of a fit's residual over that of the measured torque [%]; nan for a joint without torque."""
    residual = np.empty_like(regressor.y)
    for at, block in base_blocks(regressor, fit.base):
        residual[at] = regressor.y[at] - block @ fit.theta
    sizes = np.linalg.norm(regressor.measured, axis=0)
    error = np.full(len(sizes), np.nan)
    return np.divide(100 * np.linalg.norm(residual, axis=0), sizes, out=error, where=sizes > 0)


def _shrunk(free: Fit, program: Program, covariance: Array) -> Array:
    r"""Covariance of an estimate that a prior draws: what is left of the noise, and how far the prior may be off.

    With the information ``A`` of the equations and ``H`` of the prior in all parameters, both to second order:
    :math:`S (A + H)^{-1} (A_\theta C A_\theta + H) (A + H)^{-1} S^T`.
    """
    free_columns = program.factor.shape[1] - 10 * len(program.bodies)
    metrics = [np.sqrt(program.weight) * body.metric for body in program.bodies]
    prior = np.asarray(block_diag(*metrics, np.zeros((0, free_columns))))
    equations = program.factor * program.scale
    finite = FREE * np.eye(len(program.scale))[10 * len(program.bodies) :]
    # Through a triangular factor, as the square of 1e9 cannot be inverted beside one of 1.
    triangle = np.linalg.qr(np.vstack([equations, prior, finite]), mode="r")
    inverse = np.linalg.inv(triangle)
    out = (selection(free.base) * program.scale) @ inverse
    # The equations' information is that of base parameters: their scatter there is A C A.
    base_factor = program.factor[:, list(free.base.independent)]
    scatter = base_factor @ covariance @ base_factor.T
    pulled = equations @ inverse
    drawn = prior @ inverse
    total = out @ (pulled.T @ scatter @ pulled + drawn.T @ drawn) @ out.T
    return 0.5 * (total + total.T)


def _held_sentences(regressor: Regressor, solution: ProgramSolution) -> tuple[str, ...]:
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
