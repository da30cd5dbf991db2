# pyright: reportAttributeAccessIssue=false
"""The convex program (least squares with matrix inequalities) for physically consistent parameters, and its solution.

If no constraint is active, the solution has a closed form. Otherwise the program is stated in cvxpy and solved by
Clarabel. The recording enters as a triangular factor, so that the size of the program does not depend on the number of
samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, null_space, solve_triangular

from identification.estimators.consistent.cone_program import Shape, cone_program
from identification.estimators.consistent.consistent_bodies import PSEUDO, ReferenceBody, pseudo_inertia
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import EstimationError

FREE = 1e-3
"""Prior distance of a coefficient that alone produces as much torque as all bodies together. In comparison, a change of
a body by its own size has a prior distance of 1. If a recording does not separate a coefficient from bodies, mainly the
coefficient therefore changes."""

CHOOSING = 1e-6
"""Weight of a prior that only chooses among parameters that the recording cannot distinguish."""

_ATTEMPTS = ((1e7, 1e-10), (1e7, 1e-9), (1e7, 1e-7), (1e5, 1e-7), (1e4, 1e-6), (1e3, 1e-6))
"""Settings of successive attempts: the largest norm of the equations, to which they are scaled down, and Clarabel's
tolerance in units of the log-likelihood. The equations are in units of the noise: if there is almost none, their norm
is 1e9 or more, and the prior would be lost to rounding."""

_ACTIVE_SLACK = 1e-5  # largest slack of a bound that counts as active, in units of `Program.scale`
_LEAST_MULTIPLIER = 1e-3  # smallest multiplier (gain of the log-likelihood per unit of slack) of an active constraint


@dataclass(frozen=True)
class Program:
    """Minimise ``|factor pi - target|^2 / 2`` plus the prior over physically consistent parameters ``pi``.

    The first ten columns per body are its standard parameters; the other columns are coefficients.

    Attributes:
        factor: Matrix of the equations, shape ``(k, p)``.
        target: Right-hand side of the equations, shape ``(k,)``.
        bodies: Reference of each body.
        lower: Lower bounds of the coefficients, ``-inf`` without a bound.
        upper: Upper bounds of the coefficients, ``inf`` without a bound.
        weight: Weight of the prior, which is half the squared distance from the references. It is ``1 / s^2`` if the
            bodies are known with a relative standard deviation ``s``. The default only chooses among parameters that
            the recording cannot distinguish.
        margin: Smallest eigenvalue of each pseudo-inertia, in units of the reference's mass and squared radius of
            gyration. The default is a thickness of one per mil of that radius, about the precision of numbers in files.
        exact: True if ``factor pi == target`` has to hold exactly, so that only the prior is minimised.
    """

    factor: Float[Array, "k p"]
    target: Float[Array, " k"]
    bodies: tuple[ReferenceBody, ...]
    lower: Float[Array, " e"]
    upper: Float[Array, " e"]
    weight: float = CHOOSING
    margin: float = 1e-6
    exact: bool = False

    @property
    def scale(self) -> Float[Array, " p"]:
        """Unit of each parameter.

        For a body it is that of the reference body; for a coefficient it is the value that produces as much torque as
        all bodies together.
        """
        body_scales = np.concatenate([np.zeros(0), *(body.scale for body in self.bodies)])
        norms = np.linalg.norm(self.factor[:, len(body_scales) :], axis=0)
        size = (
            float(np.linalg.norm(self.factor[:, : len(body_scales)] * body_scales))
            or float(norms.max(initial=0.0))
            or 1.0
        )
        return np.concatenate([body_scales, np.where(norms > 0, size / np.where(norms > 0, norms, 1.0), 1.0)])


@dataclass(frozen=True)
class ProgramSolution:
    """Solution of a `Program`.

    Attributes:
        pi: Parameters, shape ``(p,)``.
        held_bodies: Indices of bodies with an active constraint.
        held_bounds: Indices of coefficients at a bound; index 0 is the first coefficient after the bodies.
    """

    pi: Float[Array, " p"]
    held_bodies: tuple[int, ...] = ()
    held_bounds: tuple[int, ...] = ()


def is_possible(program: Program, pi: Float[Array, " p"]) -> bool:
    """True if parameters satisfy the constraints of all bodies and all bounds of a program."""
    n = len(program.bodies)
    scaled = pi / program.scale
    if n and np.linalg.eigvalsh(pseudo_inertia(scaled[: 10 * n].reshape(n, 10)))[:, 0].min() < program.margin:
        return False
    coefficients = pi[10 * n :]
    return bool((coefficients >= program.lower).all() and (coefficients <= program.upper).all())


def nearest_unconstrained(program: Program) -> Float[Array, " p"]:
    """Least-squares solution of the equations that is nearest to the reference, without constraints.

    Each equation is divided by the length of its row, so that large and small equations count alike if not all can
    hold.
    """
    # With the root U of a body, |U^-1 d| is the prior distance of a change d in units of the reference's scale.
    roots = [solve_triangular(np.linalg.qr(body.metric, mode="r"), np.eye(10)) for body in program.bodies]
    free = program.factor.shape[1] - 10 * len(program.bodies)
    inverse = np.asarray(block_diag(*roots, np.eye(free) / FREE))
    scale = program.scale
    start = np.concatenate([*(body.standard for body in program.bodies), np.zeros(free)])
    rows = program.factor * scale @ inverse
    sizes = np.linalg.norm(rows, axis=1)
    sizes[sizes == 0] = 1.0
    step = np.linalg.lstsq(rows / sizes[:, None], (program.target - program.factor @ start) / sizes, rcond=None)[0]
    return start + scale * (inverse @ step)


def solve_program(program: Program) -> ProgramSolution:
    """Solution of a program.

    Raises:
        EstimationError: If there is no solution, or the solver does not find it.
    """
    if program.weight > 1.0 and not program.exact:
        # The solver needs an objective of order one: with a strong prior the objective is divided by its weight.
        root = np.sqrt(program.weight)
        program = replace(program, factor=program.factor / root, target=program.target / root, weight=1.0)
    status = ""
    for largest, tolerance in _ATTEMPTS:
        solution, status = _attempt(program, largest, tolerance)
        if solution is not None:
            return solution
    if "infeasible" in status:
        raise EstimationError(
            "No physically possible bodies satisfy these equations within their bounds: fit with a covariance instead "
            "of exactly."
        )
    raise EstimationError(f"The solver of consistent parameters ended with {status}: give a stronger prior.")


def _attempt(program: Program, largest: float, tolerance: float) -> tuple[ProgramSolution | None, str]:
    """Solution with one entry of `_ATTEMPTS`, or None, and the status of the solver."""
    n, scale = len(program.bodies), program.scale
    start, back = _coordinates(program, largest)
    if is_possible(program, start * scale):
        return ProgramSolution(start * scale), ""
    at, rows, least = _inequalities(program, scale)
    # Unless the equations are exact, the map from coordinates to parameters is upper triangular: a body depends only on
    # the coordinates from its own first parameter on.
    first = tuple(0 if program.exact else 10 * body for body in range(n))
    numbers = [rows @ back, least - rows @ start] if len(least) else []
    for body, constant in enumerate(pseudo_inertia(start[: 10 * n].reshape(n, 10))):
        slopes = np.einsum("kd,kij->ijd", back[10 * body : 10 * body + 10, first[body] :], PSEUDO)
        numbers += [slopes.reshape(16, -1), constant, program.margin * np.eye(4)]
    solve = cone_program(Shape(back.shape[1], first, len(least))).solved
    change, bound_multipliers, body_multipliers, status = solve(numbers, tolerance)
    if status not in ("optimal", "optimal_inaccurate"):
        return None, status
    x = start + back @ change
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(x[: 10 * n].reshape(n, 10)))[:, 0]
    if n and eigenvalues.min() < 0.5 * program.margin:
        return None, "a body that cannot exist"
    near = eigenvalues <= 10 * program.margin
    held = [body for body in range(n) if near[body] and np.abs(body_multipliers[body]).max() > _LEAST_MULTIPLIER]
    active = (rows @ x - least <= _ACTIVE_SLACK) & (bound_multipliers > _LEAST_MULTIPLIER)
    bounds = sorted(set(at[active].tolist()))
    return ProgramSolution(x * scale, tuple(held), tuple(bounds)), status


def _coordinates(program: Program, largest: float) -> tuple[Array, Array]:
    """Coordinates ``u`` in which the objective is ``|u|^2 / 2`` plus a constant.

    In these coordinates the objective has the same curvature in all directions, which the solver needs: some directions
    are determined by the equations, others only by the prior.

    Args:
        program: The program.
        largest: Largest norm of the equations, to which they are scaled down.

    Returns:
        ``start`` and ``back``: scaled parameters are ``start + back @ u``.
    """
    n, p = len(program.bodies), len(program.scale)
    columns = program.factor * program.scale
    reference = np.concatenate([*(body.standard for body in program.bodies), np.zeros(p - 10 * n)]) / program.scale
    prior = np.asarray(block_diag(*(body.metric for body in program.bodies), FREE * np.eye(p - 10 * n)))
    if program.exact:
        start = nearest_unconstrained(program) / program.scale
        free = np.asarray(null_space(columns))
        # The columns of `back` are orthonormal in the metric of the prior.
        triangle = np.linalg.qr(prior @ free, mode="r")
        back = np.linalg.solve(triangle.T, free.T).T
        return start + back @ (prior @ back).T @ (prior @ (reference - start)), back
    shrunk = min(1.0, largest / max(float(np.linalg.norm(columns)), 1.0))
    prior *= np.sqrt(program.weight)
    q, triangle = np.linalg.qr(np.vstack([shrunk * columns, prior]))
    target = np.concatenate([shrunk * (program.target - columns @ reference), np.zeros(len(prior))])
    start = reference + np.linalg.solve(triangle, q.T @ target)
    return start, np.linalg.inv(triangle)


def _inequalities(program: Program, scale: Array) -> tuple[Array, Array, Array]:
    """Bounds of the coefficients as inequalities ``rows @ x >= least``: index of the coefficient, row, right side."""
    first, units = 10 * len(program.bodies), np.eye(len(scale))
    lower, upper = (np.flatnonzero(np.isfinite(bounds)) for bounds in (program.lower, program.upper))
    least = np.concatenate([program.lower[lower], -program.upper[upper]])
    at = np.concatenate([lower, upper])
    return at, np.concatenate([units[first + lower], -units[first + upper]]), least / scale[first + at]
