# pyright: reportAttributeAccessIssue=false
"""The convex program of physically consistent parameters: what is minimised, and its solution.

Where no constraint is active the solution is a closed form; else cvxpy states the program and Clarabel solves it. The
program sees the recording through a triangular factor alone, so that its size does not depend on the number of samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.estimators.consistent.consistent_bodies import PSEUDO, ReferenceBody, Region, pseudo_inertia
from identification.estimators.consistent.stated_program import Shape, Values, stated
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import EstimationError, ParameterError

FREE = 1e-3
"""Prior distance of a coefficient whose torque is as large as that of all bodies together; that of a body as far from
its reference as the reference is large is 1. Where a recording cannot separate the two, the coefficient gives way."""

_ATTEMPTS = ((1e7, 1e-10), (1e7, 1e-9), (1e7, 1e-7), (1e5, 1e-7), (1e4, 1e-6), (1e3, 1e-6))
"""Attempts in turn: the largest root of the information that a recording is taken to have, and Clarabel's tolerance in
units of the log-likelihood. Without noise the information is 1e9 and more, beside which a solver in double precision
does not see a prior."""

_AT_EDGE = 1e-5  # slack of an inequality, in units of its row, up to which it is active
_PUSHED = 1e-3  # multiplier (gain of the log-likelihood per unit of slack) from which an active inequality matters


@dataclass(frozen=True)
class Prior:
    r"""How strongly parameters are drawn towards those of reference bodies.

    Attributes:
        weight: In units of the log-likelihood: ``1 / s^2`` if the bodies are known to a share ``s`` (one sigma). The
            default only chooses among parameters that the recording cannot tell apart.
        kind: ``pullback``: :math:`\tfrac{1}{2} |P_0^{-1/2} (P - P_0) P_0^{-1/2}|_F^2`, a square; ``entropic``:
            :math:`\mathrm{tr}(P_0^{-1} P) - \log\det(P_0^{-1} P) - 4`, the Bregman divergence of the log-determinant
            ([Lee]_), which keeps bodies away from the edge of the possible.

    References:
        .. [Lee] T. Lee, P. M. Wensing, F. C. Park, Geometric robot dynamic identification: a convex programming
           approach, IEEE Transactions on Robotics 36(2), 2020. Checked against cvxpy in
           tests/identification/estimators/consistent/test_consistent_cone.py.
    """

    weight: float = 1e-6
    kind: str = "pullback"

    def __post_init__(self):
        if self.kind not in ("pullback", "entropic"):
            raise ParameterError(f"A prior of kind '{self.kind}' is unknown: give 'pullback' or 'entropic'.")
        if not (np.isfinite(self.weight) and self.weight > 0):
            raise ParameterError(f"The weight of a prior is {self.weight:g}: give a finite one above zero.")


@dataclass(frozen=True)
class Program:
    """Minimise ``|factor pi - target|^2 / 2`` plus the prior, among what is physically possible.

    The first ten columns per body are its standard parameters, the others free or bounded coefficients.

    Attributes:
        factor: Shape ``(k, p)``.
        target: Shape ``(k,)``.
        bodies: References, one per body.
        regions: Where the mass of each body is, or None.
        lower: Bounds of the coefficients after the bodies', ``-inf`` for none.
        upper: ``inf`` for none.
        prior: Towards the references.
        margin: Smallest eigenvalue of each pseudo-inertia in units of the reference's mass and radius of gyration; by
            default a thickness of one per mil of the radius, about what a file's digits can state.
        exact: True if ``factor pi == target`` is to hold, so that the prior alone is minimised.
    """

    factor: Float[Array, "k p"]
    target: Float[Array, " k"]
    bodies: tuple[ReferenceBody, ...]
    regions: tuple[Region | None, ...]
    lower: Float[Array, " e"]
    upper: Float[Array, " e"]
    prior: Prior = Prior()
    margin: float = 1e-6
    exact: bool = False

    @property
    def scale(self) -> Float[Array, " p"]:
        """Unit of each column: the reference's; of a coefficient, what makes its column as large as all bodies'."""
        own = np.concatenate([np.zeros(0), *(body.scale for body in self.bodies)])
        rest = np.linalg.norm(self.factor[:, len(own) :], axis=0)
        size = float(np.linalg.norm(self.factor[:, : len(own)] * own)) or float(rest.max(initial=0.0)) or 1.0
        return np.concatenate([own, np.where(rest > 0, size / np.where(rest > 0, rest, 1.0), 1.0)])


@dataclass(frozen=True)
class ProgramSolution:
    """Solution of a `Program`.

    Attributes:
        pi: Shape ``(p,)``.
        held_bodies: Indices of bodies whose pseudo-inertia is at its margin.
        held_regions: Indices of bodies that are at the edge of their region.
        held_bounds: Indices of coefficients, from 0 after the bodies, that are at a bound.
    """

    pi: Float[Array, " p"]
    held_bodies: tuple[int, ...] = ()
    held_regions: tuple[int, ...] = ()
    held_bounds: tuple[int, ...] = ()


def is_possible(program: Program, pi: Float[Array, " p"]) -> bool:
    """True if all bodies, regions and bounds of a program allow these parameters."""
    n = len(program.bodies)
    scaled = pi / program.scale
    if n and np.linalg.eigvalsh(pseudo_inertia(scaled[: 10 * n].reshape(n, 10)))[:, 0].min() < program.margin:
        return False
    given = [(region, pi[10 * k : 10 * k + 10]) for k, region in enumerate(program.regions) if region is not None]
    if any((region.rows() @ standard < 0).any() for region, standard in given):
        return False
    coefficients = pi[10 * n :]
    return bool((coefficients >= program.lower).all() and (coefficients <= program.upper).all())


def nearest_unconstrained(program: Program) -> Float[Array, " p"]:
    """Parameters nearest to the reference that solve the equations best, possible or not: a closed form."""
    from scipy.linalg import block_diag

    roots = [_root(body) for body in program.bodies]
    free = program.factor.shape[1] - 10 * len(program.bodies)
    inverse = np.asarray(block_diag(*roots, np.eye(free) / FREE))
    scale = program.scale
    start = np.concatenate([*(body.standard for body in program.bodies), np.zeros(free)])
    rows = program.factor * scale @ inverse
    sizes = np.linalg.norm(rows, axis=1)
    sizes[sizes == 0] = 1.0
    step = np.linalg.lstsq(rows / sizes[:, None], (program.target - program.factor @ start) / sizes, rcond=None)[0]
    return start + scale * (inverse @ step)


def _root(body: ReferenceBody) -> Array:
    """``U`` with ``|U^-1 d|`` the distance of a change ``d`` in units of the reference's scale."""
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(np.linalg.qr(body.metric, mode="r"), np.eye(10)))


def solve_program(program: Program) -> ProgramSolution:
    """The parameters that a program asks for.

    Raises:
        EstimationError: If there are none, or the solver does not get to them.
    """
    # In units of the prior where that is strong: a solver wants an objective of order one.
    strength = max(1.0, program.prior.weight)
    root = np.sqrt(strength)
    prior = replace(program.prior, weight=program.prior.weight / strength)
    scaled = program if program.exact else replace(
        program, factor=program.factor / root, target=program.target / root, prior=prior
    )  # fmt: skip
    status = ""
    for largest, tolerance in _ATTEMPTS:
        solution, status = _attempt(scaled, largest, tolerance)
        if solution is not None:
            return solution
    if "infeasible" in status:
        raise EstimationError(
            "No physically possible bodies satisfy these equations within their regions and bounds: widen the regions, "
            "or fit with a covariance instead of exactly."
        )
    raise EstimationError(f"The solver of consistent parameters ended with {status}: give a stronger prior.")


def _attempt(program: Program, largest: float, tolerance: float) -> tuple[ProgramSolution | None, str]:
    p = program.factor.shape[1]
    n = len(program.bodies)
    scale = program.scale
    start, back, equations, left = _coordinates(program, largest)
    if program.prior.kind == "pullback" and is_possible(program, start * scale):
        return ProgramSolution(start * scale), ""
    own, rows, least = _inequalities(program, scale)
    cones = _Cones(start, back, equations, left, rows, least)
    change, forces, pushes, status = _minimised(program, cones, tolerance)
    if status not in ("optimal", "optimal_inaccurate"):
        return None, status
    x = start + back @ change
    pushed = set(own[(rows @ x - least <= _AT_EDGE) & (forces > _PUSHED)].tolist())
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(x[: 10 * n].reshape(n, 10)))[:, 0]
    if n and eigenvalues.min() < 0.5 * program.margin:
        return None, "a body that cannot exist"
    near = eigenvalues <= 10 * program.margin
    held = [at for at in range(n) if near[at] and np.abs(pushes[at]).max() > _PUSHED]
    regions = tuple(at for at in range(n) if at in pushed)
    bounds = tuple(at for at in range(p - 10 * n) if n + at in pushed)
    return ProgramSolution(x * scale, tuple(held), regions, bounds), status


@dataclass(frozen=True)
class _Cones:
    """A program in the coordinates of `_coordinates`, with its inequalities ``rows @ x >= least``."""

    start: Array
    back: Array
    equations: Array
    left: Array
    rows: Array
    least: Array


def _minimised(program: Program, cones: _Cones, tolerance: float) -> tuple[Array, Array, list[Array], str]:
    """Coordinates at the minimum, what each inequality and each body pushes with, and the solver's status."""
    entropic = program.prior.kind == "entropic"
    weight = (1.0 if program.exact else program.prior.weight) if entropic else None
    # Where no equation is exact, coordinates are those of a triangular factor, and few have to do with the last bodies.
    first = tuple(0 if program.exact else 10 * body for body in range(len(program.bodies)))
    shape = Shape(cones.back.shape[1], first, len(cones.least), len(cones.left), weight)
    # A log-determinant measures in units of its reference; a square knows no reference.
    units = [reference.whitening if entropic else np.eye(4) for reference in program.bodies]
    slopes, constants, margins = [np.zeros((0, 16, shape.unknowns))], [np.zeros((0, 4, 4))], [np.zeros((0, 4, 4))]
    for body, unit in enumerate(units):
        at = slice(10 * body, 10 * body + 10)
        matrices = unit @ np.einsum("kd,kij->dij", cones.back[at], PSEUDO) @ unit.T
        slopes.append(matrices.reshape(-1, 16).T[None])
        constants.append((unit @ pseudo_inertia(cones.start[at]) @ unit.T)[None])
        margins.append(program.margin * (unit @ unit.T)[None])
    values = Values(
        cones.equations,
        cones.left,
        cones.rows @ cones.back,
        cones.least - cones.rows @ cones.start,
        np.concatenate(slopes),
        np.concatenate(constants),
        np.concatenate(margins),
    )
    change, forces, pushes, status = stated(shape).solved(values, tolerance)
    return change, forces, [unit.T @ push @ unit for unit, push in zip(units, pushes, strict=False)], status


def _coordinates(program: Program, largest: float) -> tuple[Array, Array, Array, Array]:
    """Scaled parameters as ``start + back @ u``, where equations and prior together are ``|u|^2 / 2`` and a constant.

    In these coordinates parameters that are known to 1e-8 and others that are not known at all are alike to a solver.
    An entropic prior counts with its second order.

    Returns:
        ``start``, ``back``, and the equations' own part: its rows per ``u``, and what they leave at ``start``.
    """
    from scipy.linalg import block_diag, null_space

    n, p = len(program.bodies), len(program.scale)
    columns = program.factor * program.scale
    known = np.concatenate([*(body.standard for body in program.bodies), np.zeros(p - 10 * n)]) / program.scale
    drawn = np.asarray(block_diag(*(body.metric for body in program.bodies), FREE * np.eye(p - 10 * n)))
    if program.exact:
        start = nearest_unconstrained(program) / program.scale
        free = np.asarray(null_space(columns))
        # Orthonormal in the metric of the prior.
        triangle = np.linalg.qr(drawn @ free, mode="r")
        back = np.linalg.solve(triangle.T, free.T).T
        return (
            start + back @ (drawn @ back).T @ (drawn @ (known - start)),
            back,
            np.zeros((0, back.shape[1])),
            np.zeros(0),
        )
    shrunk = min(1.0, largest / max(float(np.linalg.norm(columns)), 1.0))
    drawn *= np.sqrt(program.prior.weight)
    q, triangle = np.linalg.qr(np.vstack([shrunk * columns, drawn]))
    left = np.concatenate([shrunk * (program.target - columns @ known), np.zeros(len(drawn))])
    start = known + np.linalg.solve(triangle, q.T @ left)
    # The prior's part in between is replaced by the log-determinant where there is one.
    own = np.r_[: len(columns), len(columns) + 16 * n : len(q)]
    left = np.concatenate([shrunk * (columns @ start - program.target), drawn[16 * n :] @ start])
    return start, np.linalg.inv(triangle), q[own], left


def _inequalities(program: Program, scale: Array) -> tuple[Array, Array, Array]:
    """Whose each inequality is (body, or number of bodies + coefficient), its row of norm one, and its least value."""
    n, p = len(program.bodies), len(scale)
    own, rows, least = [np.zeros(0, dtype=int)], [np.zeros((0, p))], [np.zeros(0)]
    for body, region in enumerate(program.regions):
        if region is not None:
            given = region.rows() * program.bodies[body].scale
            wide = np.zeros((len(given), p))
            wide[:, 10 * body : 10 * body + 10] = given / np.linalg.norm(given, axis=1, keepdims=True)
            own, rows, least = [*own, np.full(len(given), body)], [*rows, wide], [*least, np.zeros(len(given))]
    for sign, bounds in ((1.0, program.lower), (-1.0, program.upper)):
        at = np.flatnonzero(np.isfinite(bounds))
        own, rows = [*own, n + at], [*rows, sign * np.eye(p)[10 * n + at]]
        least = [*least, sign * bounds[at] / scale[10 * n + at]]
    return np.concatenate(own), np.concatenate(rows), np.concatenate(least)
