# pyright: reportAttributeAccessIssue=false
"""Least squares with bodies that can exist: pseudo-inertias without a negative eigenvalue, centres within reach.

A quadratic loss is minimised over inertial parameters and other coefficients within bounds [Wensing]_, by Clarabel's
interior-point method. Other coefficients that no bound holds are eliminated.

References:
    .. [Wensing] P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
       parameter identification, IEEE Robotics and Automation Letters 3(1), 2018. The minima are checked against cvxpy
       in tests/identification/diagnosis/fit/test_possible_bodies.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.engine.fits.minimum import Minimum
from identification.engine.numerics.bounded import bounded_solve, solve
from identification.estimators.consistent.consistent_bodies import PSEUDO, ReferenceBody, pseudo_inertia, reference_body
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.model.robot import Robot

# Share of a body by which an eigenvalue may lie below zero: rounding of files.
_ROUNDING = 1e-6
# Loss that a change as large as the given body itself costs, in squared deviations: it decides what no data show.
_HELD = 1e-4
# Half widths of the box about a link by which it is widened, and the shortest one as a share of the longest.
_WIDER, _THINNEST = 1.5, 0.5
# Reach of a link of a robot without any length [m].
_SOME_LENGTH = 0.3
# Accuracy of the solver, in squared deviations and of the cone.
_ACCURACY = 1e-6
# Squared deviations that bodies which can exist cost, up to which similar fits go the same way to them.
_LITTLE_DENIED = 10.0
# Times that the other coefficients are found again beside the bodies.
_ROUNDS = 4
# Parts of a way into the cone that are tried, the closest about its end.
_PARTS = np.array([0.25, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0, 1.02, 1.05, 1.1, 1.2, 1.4, 1.7, 2.0, 3.0, 4.0])
# Order of the entries of a symmetric matrix in Clarabel's cone: columns of the upper triangle.
_TRIANGLE = tuple((i, j) for j in range(4) for i in range(j + 1))
_ROOT_TWO = np.array([1.0 if i == j else np.sqrt(2.0) for i, j in _TRIANGLE])
# Ten parameters of a body in the cone's order, ``(10, 10)``.
_CONE = np.stack([PSEUDO[:, i, j] for i, j in _TRIANGLE], axis=1).T * _ROOT_TWO[:, None]


@dataclass(frozen=True)
class Body:
    """A body whose ten parameters a fit changes, and which of these changes make a body that can exist.

    Attributes:
        name: Of the joint that moves it.
        columns: Of its changes, among those of a fit.
        given: The body of the model, the nearest possible one where that cannot exist.
        reach: Rows ``reach @ parameters >= 0`` of bodies whose centre is within reach.
    """

    name: str
    columns: tuple[int, ...]
    given: ReferenceBody
    reach: Float[Array, "F 10"]

    def exists(self, change: Float[Array, "*b 10"]) -> Array:
        """True where the given body with a change can exist, to rounding, ``(*b,)``."""
        parameters = (self.given.standard + change) / self.given.scale
        least = np.linalg.eigvalsh(pseudo_inertia(parameters))[..., 0]
        within = parameters @ (self.reach * self.given.scale).T
        allowed = -_ROUNDING * np.abs(self.reach[:, 1:4]).max(initial=1.0)
        return (least >= -_ROUNDING) & (within >= allowed).all(axis=-1)


def bodies_of_terms(robot: Robot, terms: Iterable[Term]) -> tuple[Body, ...]:
    """Bodies whose inertial parameters some effects set free, each once."""
    out: dict[int, Body] = {}
    for term in terms:
        if term.effect.inertial != "free":
            continue
        own = term.effect.regressor_columns(robot, term.joint)
        for at in range(0, len(own), 10):
            index = own[at] // 10 + 1
            out[index] = body_of(robot, index, term.columns[at : at + 10])
    return tuple(out[index] for index in sorted(out))


def body_of(robot: Robot, index: int, columns: tuple[int, ...]) -> Body:
    """The body of a joint by Pinocchio's index, with the columns of its changes.

    Its centre lies in the box about its own joint, the next ones and the given centre, with the sides widened by half;
    a last link reaches as far as the longest link of the robot.
    """
    model = robot.model
    given = model.inertias[index]
    points = [np.zeros(3), np.array(given.lever) if given.mass > 0 else np.zeros(3)]
    points += [model.jointPlacements[child].translation for child in model.children[index]]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    half = 0.5 * (high - low)
    half = np.maximum(half, _THINNEST * half.max())
    if len(model.children[index]) == 0:
        longest = max(float(np.linalg.norm(placement.translation)) for placement in model.jointPlacements)
        half = np.maximum(half, longest or float(np.abs(points[1]).max()) or _SOME_LENGTH)
    middle, half = 0.5 * (low + high), _WIDER * np.maximum(half, 1e-3)
    reach = np.zeros((6, 10))
    for axis in range(3):
        reach[2 * axis, [0, 1 + axis]] = middle[axis] + half[axis], -1.0
        reach[2 * axis + 1, [0, 1 + axis]] = half[axis] - middle[axis], 1.0
    return Body(model.names[index], columns, _given(robot, index), reach)


def _given(robot: Robot, index: int) -> ReferenceBody:
    """The body of the model with units; one without mass is measured by the mean of the others."""
    given = robot.model.inertias[index]
    mass = float(given.mass)
    if mass <= 0:
        masses = np.array([inertia.mass for inertia in robot.model.inertias[1:]])
        mass = float(masses[masses > 0].mean()) if np.any(masses > 0) else 1.0
    return reference_body(given.toDynamicParameters(), mass=mass)


def impossible(bodies: Iterable[Body], theta: Float[Array, " K"]) -> tuple[str, ...]:
    """Names of the bodies that cannot exist with these coefficients of all columns."""
    return tuple(body.name for body in bodies if not body.exists(theta[list(body.columns)]))


def places_among(kept: Int[Array, " n"], bodies: tuple[Body, ...]) -> list[tuple[Body, Int[Array, " 10"]]]:
    """Bodies with the places of their changes among what is fitted."""
    # A load's columns come last, so that what is fitted is not in the order of its columns.
    order = np.argsort(kept)
    return [(body, order[np.searchsorted(kept, body.columns, sorter=order)]) for body in bodies]


def among_possible_bodies(
    found: Minimum,
    square: Float[Array, "n n"],
    line: Float[Array, " n"],
    precision: Float[Array, " n"],
    bounds: tuple[Float[Array, " n"], Float[Array, " n"]],
    folds: tuple[Float[Array, "F n n"], Float[Array, "F n"]] | None,
    bodies: list[tuple[Body, Int[Array, " 10"]]],
    way: Float[Array, " n"] | None,
) -> Minimum:
    """A fit again among bodies that can exist, on all blocks and without each fold, where its own cannot.

    A fit whose bodies exist is the best of all that do, so that nothing is computed there. Where the data hardly show
    what is impossible, the way to bodies that can exist hardly changes: fits without a fold take that of all blocks.

    Args:
        found: The fit without that limit.
        square: Columns times columns.
        line: Columns times residual.
        precision: Prior precision of each coefficient.
        bounds: Of each coefficient.
        folds: What each fold has of ``square`` and ``line``, None if nothing is held out.
        bodies: Bodies with the places of their changes.
        way: From a similar fit to one whose bodies can exist, None to search for the nearest one.
    """

    def exist(x: Float[Array, " n"]) -> bool:
        return all(body.exists(x[at]) for body, at in bodies)

    if not bodies:
        return found
    with_prior = square + np.diag(precision)
    x, objective = found.x, found.objective
    if not exist(x):
        before = _loss_of(with_prior, line, x)
        led = None if way is None or not way.any() else led_into_cone(x, way, bounds, bodies)
        if led is None or _loss_of(with_prior, line, led) - before > _LITTLE_DENIED:
            led = possible_minimum(with_prior, line, bounds, x, bodies)
        x = led
        objective += _loss_of(with_prior, line, x) - before
    little, without = objective - found.objective < _LITTLE_DENIED, found.without.copy()
    for k in range(len(without)):
        if folds is not None and not exist(without[k]):
            led = led_into_cone(without[k], x - found.x, bounds, bodies) if little else None
            less, other = with_prior - folds[0][k], line - folds[1][k]
            without[k] = possible_minimum(less, other, bounds, without[k], bodies) if led is None else led
    return Minimum(x, objective, without)


def _loss_of(a: Float[Array, "n n"], b: Float[Array, " n"], x: Float[Array, " n"]) -> float:
    """Loss of coefficients, up to what no coefficient changes."""
    return float(x @ a @ x - 2.0 * b @ x)


def possible_minimum(
    a: Float[Array, "k k"],
    b: Float[Array, " k"],
    bounds: tuple[Float[Array, " k"], Float[Array, " k"]],
    x: Float[Array, " k"],
    bodies: Sequence[tuple[Body, Int[Array, " 10"]]],
) -> Float[Array, " k"]:
    """Minimum of ``x a x / 2 - b x`` within bounds, with bodies that can exist.

    Args:
        a: Quadratic part, positive definite.
        b: Linear part.
        bounds: Lower and upper bounds; infinite for the bodies' coefficients.
        x: The minimum within the bounds alone.
        bodies: Each with the places of its changes among the coefficients.
    """
    at = np.concatenate([places for _, places in bodies])
    rest = np.ones(len(b), dtype=bool)
    rest[at] = False
    others = np.flatnonzero(rest)
    lower, upper = bounds
    x, near = x.copy(), np.zeros(len(b), dtype=bool)
    for _ in range(_ROUNDS):
        at_bound = rest & ((x <= lower) | (x >= upper))
        if not np.any(at_bound & ~near) and near.any():
            break
        near |= at_bound
        near[at] = True
        kept, free = np.flatnonzero(near), np.flatnonzero(~near)
        cross = a[np.ix_(free, kept)]
        made = solve(a[np.ix_(free, free)], np.column_stack([cross, b[free]]))
        square, left = a[np.ix_(kept, kept)] - cross.T @ made[:, :-1], b[kept] - cross.T @ made[:, -1]
        own = [(body, np.searchsorted(kept, places)) for body, places in bodies]
        x[kept] = _in_cone(square, left, (lower[kept], upper[kept]), own)
        x[others] = bounded_solve(
            a[np.ix_(others, others)], b[others] - a[np.ix_(others, at)] @ x[at], lower[others], upper[others]
        )
    return x


def led_into_cone(
    x: Float[Array, " k"],
    way: Float[Array, " k"],
    bounds: tuple[Float[Array, " k"], Float[Array, " k"]],
    bodies: Sequence[tuple[Body, Int[Array, " 10"]]],
) -> Float[Array, " k"] | None:
    """The first coefficients along a way from which on bodies can exist, None if that is too far.

    Args:
        x: Where it begins, with bodies that cannot exist.
        way: Straight ahead; its length is a usual one.
        bounds: Lower and upper bounds of the coefficients, at which those beyond them are held.
        bodies: Each with the places of its changes among the coefficients.
    """
    along = np.clip(x + _PARTS[:, None] * way, *bounds)
    exist = np.logical_and.reduce([body.exists(along[:, at]) for body, at in bodies])
    return along[np.argmax(exist)] if exist.any() else None


def _in_cone(
    a: Float[Array, "m m"],
    b: Float[Array, " m"],
    bounds: tuple[Float[Array, " m"], Float[Array, " m"]],
    bodies: Sequence[tuple[Body, Int[Array, " 10"]]],
) -> Float[Array, " m"]:
    """Changes of bodies that can exist, and other coefficients within bounds, at the minimum of ``x a x / 2 - b x``."""
    import clarabel
    from scipy import sparse

    scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
    held = np.zeros(len(b))
    for body, at in bodies:
        scale[at], held[at] = body.given.scale, _HELD
    square = a * np.outer(scale, scale) + np.diag(held)
    # In coordinates in which the loss is half their square about the minimum without a cone: what data show well and
    # what they do not show differ by twelve orders of magnitude.
    root = np.linalg.cholesky(0.5 * (square + square.T))
    back = np.linalg.solve(root.T, np.eye(len(b)))
    start = back @ np.linalg.solve(root, b * scale)
    rows, least, cones = [], [], []
    for sign, bound in ((1.0, bounds[0]), (-1.0, bounds[1])):
        ends = np.flatnonzero(np.isfinite(bound))
        rows.append(-sign * back[ends])
        least.append(sign * (start - bound / scale)[ends])
        cones.append(clarabel.NonnegativeConeT(len(ends)))
    for body, at in bodies:
        here = body.given.standard / body.given.scale + start[at]
        reach = body.reach * body.given.scale
        reach = reach / np.abs(reach).max(axis=1, keepdims=True)
        for cone, kind in ((reach, clarabel.NonnegativeConeT(len(reach))), (_CONE, clarabel.PSDTriangleConeT(4))):
            rows.append(-cone @ back[at])
            least.append(cone @ here)
            cones.append(kind)
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _ACCURACY
    solver = clarabel.DefaultSolver(
        sparse.identity(len(b), format="csc"),
        np.zeros(len(b)),
        sparse.csc_matrix(np.concatenate(rows)),
        np.concatenate(least),
        cones,
        settings,
    )
    found = np.array(solver.solve().x)
    x = start + back @ found if np.isfinite(found).all() else np.zeros(len(b))
    for body, at in bodies:
        x[at] = _inside(x[at], body)
    return x * scale


def _inside(x: Float[Array, " 10"], body: Body) -> Float[Array, " 10"]:
    """The same change of a body, in its units, shortened by what the solver left outside of the cone."""
    shorter = 1.0
    while shorter > 0.0 and not body.exists(shorter * x * body.given.scale):
        shorter = shorter - 1e-4 if shorter > 0.999 else shorter - 0.05
    return max(shorter, 0.0) * x
