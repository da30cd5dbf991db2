"""Least squares with physically possible bodies.

A body is possible if its pseudo-inertia has no negative eigenvalue and its centre of mass is within reach, in a box
around its link. A quadratic loss is minimised over inertial parameters and other coefficients within bounds
[Wensing]_. Only bodies that are impossible in the unconstrained fit are constrained: `cone_minimum` finds their
parameters in the cone of possible bodies, with all other coefficients eliminated.

References:
    .. [Wensing] P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
       parameter identification, IEEE Robotics and Automation Letters 3(1), 2018. The minima are checked against cvxpy
       in tests/identification/diagnosis/fit/test_possible_bodies.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.cone_minimum import best_bodies
from identification.engine.fits.minimum import Minimum
from identification.engine.numerics.bounded import bounded_solve, solve
from identification.estimators.consistent.consistent_bodies import ReferenceBody, pseudo_inertia, reference_body
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.model.robot import Robot

# A body is possible if no eigenvalue is below zero by more than this share of the body's size, because numbers in files
# are rounded.
_ROUNDING_SHARE = 1e-6
# Penalty in squared standard deviations on a change as large as the given body. It determines the combinations of
# parameters that the data do not determine.
_CHANGE_PENALTY = 1e-4
# Factor by which the box around a link is enlarged, and its smallest side as a share of the largest.
_BOX_FACTOR, _THINNEST_SIDE = 1.5, 0.5
# Reach of a link if the model has no lengths at all [m].
_DEFAULT_REACH = 0.3
# An active bound is released if the squared slope over the curvature is above this, in squared standard deviations.
_LEAST_GAIN = 1e-6
# Largest number of changes of the set of active constraints; two or three are enough nearly always.
_MOST_ROUNDS = 12


@dataclass(frozen=True)
class Body:
    """A body whose ten inertial parameters a fit changes, with the constraints on a possible body.

    Attributes:
        name: Name of the joint that moves the body.
        columns: Columns of the changes of its parameters in a fit.
        given: The body of the model, or the nearest possible body if the model's is impossible.
        reach: Rows of ``reach @ parameters >= 0``, which holds if the centre of mass is within reach.
    """

    name: str
    columns: tuple[int, ...]
    given: ReferenceBody
    reach: Float[Array, "F 10"]

    @cached_property
    def scaled(self) -> tuple[Float[Array, " 10"], Float[Array, "F 10"]]:
        """Given body and rows of its reach in the units of ``given.scale``, with a largest entry of one in each row."""
        reach = self.reach * self.given.scale
        return self.given.standard / self.given.scale, reach / np.abs(reach).max(axis=1, keepdims=True)

    def is_possible(self, change: Float[Array, "*b 10"]) -> Array:
        """True where the given body with a change is possible up to rounding, ``(*b,)``; False if it is not finite."""
        finite: Array = np.asarray(np.isfinite(change).all(axis=-1, keepdims=True))
        parameters = (self.given.standard + np.where(finite, change, 0.0)) / self.given.scale
        least = np.linalg.eigvalsh(pseudo_inertia(parameters))[..., 0]
        within = parameters @ (self.reach * self.given.scale).T
        allowed = -_ROUNDING_SHARE * np.abs(self.reach[:, 1:4]).max(initial=1.0)
        return finite[..., 0] & (least >= -_ROUNDING_SHARE) & (within >= allowed).all(axis=-1)


@dataclass(frozen=True)
class ActiveConstraints:
    """The constraints that are active at a minimum.

    Attributes:
        bodies: For each body, True if it would be impossible without a constraint.
        low, high: True for coefficients at their lower or at their upper bounds, ``(k,)``.
    """

    bodies: tuple[bool, ...]
    low: Bool[Array, " k"]
    high: Bool[Array, " k"]


def bodies_of_term(robot: Robot, term: Term) -> tuple[Body, ...]:
    """Bodies whose inertial parameters a term changes freely."""
    own = term.effect.regressor_columns(robot, term.joint)
    return tuple(body_of(robot, own[at] // 10 + 1, term.columns[at : at + 10]) for at in range(0, len(own), 10))


def body_of(robot: Robot, index: int, columns: tuple[int, ...]) -> Body:
    """The body that a joint moves.

    Its centre of mass must be in a box around its own joint, the next joints and the given centre of mass. The box is
    enlarged by half; the box of a last link reaches at least as far as the longest link of the robot.

    Args:
        robot: The given model.
        index: Pinocchio's index of the joint.
        columns: Columns of the changes of the body's parameters in a fit.
    """
    model = robot.model
    given = model.inertias[index]
    points = [np.zeros(3), np.array(given.lever) if given.mass > 0 else np.zeros(3)]
    points += [model.jointPlacements[child].translation for child in model.children[index]]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    half = 0.5 * (high - low)
    half = np.maximum(half, _THINNEST_SIDE * half.max())
    if len(model.children[index]) == 0:
        longest = max(float(np.linalg.norm(placement.translation)) for placement in model.jointPlacements)
        half = np.maximum(half, longest or float(np.abs(points[1]).max()) or _DEFAULT_REACH)
    middle, half = 0.5 * (low + high), _BOX_FACTOR * np.maximum(half, 1e-3)
    reach = np.zeros((6, 10))
    for axis in range(3):
        reach[2 * axis, [0, 1 + axis]] = middle[axis] + half[axis], -1.0
        reach[2 * axis + 1, [0, 1 + axis]] = half[axis] - middle[axis], 1.0
    return Body(model.names[index], columns, _reference_body(robot, index), reach)


def _reference_body(robot: Robot, index: int) -> ReferenceBody:
    """The body of the model with its units; if it has no mass, its unit of mass is the mean mass of the others."""
    given = robot.model.inertias[index]
    mass = float(given.mass)
    if mass <= 0:
        masses = np.array([inertia.mass for inertia in robot.model.inertias[1:]])
        mass = float(masses[masses > 0].mean()) if np.any(masses > 0) else 1.0
    return reference_body(given.toDynamicParameters(), mass=mass)


def impossible_bodies(bodies: Iterable[Body], theta: Float[Array, " K"]) -> tuple[str, ...]:
    """Names of the bodies that are impossible with the coefficients ``theta`` of all columns."""
    return tuple(body.name for body in bodies if not body.is_possible(theta[list(body.columns)]))


def positions_of_bodies(fitted: Int[Array, " n"], bodies: tuple[Body, ...]) -> list[tuple[Body, Int[Array, " 10"]]]:
    """Each body with the positions of its columns among the fitted columns."""
    # The columns of a load come last, so ``fitted`` is not in ascending order.
    order = np.argsort(fitted)
    return [(body, order[np.searchsorted(fitted, body.columns, sorter=order)]) for body in bodies]


def with_possible_bodies(
    found: Minimum,
    gram: Float[Array, "n n"],
    right_side: Float[Array, " n"],
    precision: Float[Array, " n"],
    bounds: tuple[Float[Array, " n"], Float[Array, " n"]],
    folds: tuple[Float[Array, "F n n"], Float[Array, "F n"]] | None,
    bodies: list[tuple[Body, Int[Array, " 10"]]],
) -> Minimum:
    """The fit constrained to possible bodies, on all blocks and without each fold.

    If the bodies of the unconstrained fit are possible, it is also the constrained fit, and nothing is computed.

    Args:
        found: The unconstrained fit.
        gram: Products of columns with columns.
        right_side: Products of columns with the residual.
        precision: Prior precision of each coefficient.
        bounds: Lower and upper bounds of the coefficients.
        folds: Part of each fold in ``gram`` and ``right_side``; None if nothing is held out.
        bodies: Each body with the positions of its changes among the coefficients.
    """

    def possible(x: Float[Array, " n"]) -> bool:
        return all(body.is_possible(x[at]) for body, at in bodies)

    if not bodies:
        return found
    with_prior = gram + np.diag(precision)
    x, objective, without, active = found.x, found.objective, found.without.copy(), None
    if not possible(x):
        x, active = possible_minimum(with_prior, right_side, bounds, found.x, bodies)
        objective += _loss_of(with_prior, right_side, x) - _loss_of(with_prior, right_side, found.x)
    for k in range(len(without)):
        if folds is not None and not possible(without[k]):
            a, b = with_prior - folds[0][k], right_side - folds[1][k]
            without[k], _ = possible_minimum(a, b, bounds, without[k], bodies, active)
    return Minimum(x, objective, without)


def _loss_of(a: Float[Array, "n n"], b: Float[Array, " n"], x: Float[Array, " n"]) -> float:
    """Loss of some coefficients, up to a constant."""
    return float(x @ a @ x - 2.0 * b @ x)


def possible_minimum(
    a: Float[Array, "k k"],
    b: Float[Array, " k"],
    bounds: tuple[Float[Array, " k"], Float[Array, " k"]],
    x: Float[Array, " k"],
    bodies: Sequence[tuple[Body, Int[Array, " 10"]]],
    start: ActiveConstraints | None = None,
) -> tuple[Float[Array, " k"], ActiveConstraints]:
    """Minimum of ``x a x / 2 - b x`` within bounds and with possible bodies, by an active-set method.

    In each round, coefficients are fixed at their active bounds, and constrained bodies are computed in the cone of
    possible bodies, with all other coefficients eliminated. Then violated bounds and impossible bodies become active.
    Active bounds are released if the loss falls towards the inside. If nothing changes, the minimum is found, because
    the problem is convex.

    Args:
        a: Quadratic part, positive definite.
        b: Linear part.
        bounds: Lower and upper bounds; infinite for the bodies' coefficients.
        x: The minimum within the bounds, without constraints on bodies.
        bodies: Each body with the positions of its changes among the coefficients.
        start: Active constraints at the minimum of a similar loss, which are tried first; None if there is none.

    Returns:
        The minimum, and the constraints that are active there.
    """
    lower, upper = bounds
    of_bodies = np.zeros(len(b), dtype=bool)
    of_bodies[np.concatenate([at for _, at in bodies])] = True
    if start is None:
        constrained, low, high = tuple(not body.is_possible(x[at]) for body, at in bodies), x <= lower, x >= upper
    else:
        constrained, low, high = start.bodies, start.low, start.high
        x = np.where(low, lower, np.where(high, upper, x))
    fixed = ~of_bodies & (low | high)
    for _ in range(_MOST_ROUNDS):
        x = _minimum_in_cone(a, b, x, fixed, [pair for pair, active in zip(bodies, constrained, strict=True) if active])
        slope = a @ x - b
        # True where the loss falls away from the bound: upwards from a lower one, downwards from an upper one.
        inwards = np.where(x <= lower, slope < 0.0, slope > 0.0) & (slope**2 > _LEAST_GAIN * np.diag(a))
        released, outside = fixed & inwards & (lower < upper), ~fixed & ((x < lower) | (x > upper))
        impossible = [
            not active and not body.is_possible(x[at]) for (body, at), active in zip(bodies, constrained, strict=True)
        ]
        if not released.any() and not outside.any() and not any(impossible):
            return x, ActiveConstraints(constrained, fixed & (x <= lower), fixed & (x >= upper))
        x, fixed = np.clip(x, lower, upper), (fixed & ~released) | outside
        constrained = tuple(active or new for active, new in zip(constrained, impossible, strict=True))
    # The active bounds of nearly equal columns may alternate forever. Then all bodies are constrained and computed
    # first, and the other coefficients are solved for afterwards.
    x, others = np.clip(_minimum_in_cone(a, b, x, fixed, bodies), lower, upper), ~of_bodies
    right_side = b[others] - a[np.ix_(others, of_bodies)] @ x[of_bodies]
    x[others] = bounded_solve(a[np.ix_(others, others)], right_side, lower[others], upper[others])
    return x, ActiveConstraints((True,) * len(bodies), others & (x <= lower), others & (x >= upper))


def _minimum_in_cone(
    a: Float[Array, "k k"],
    b: Float[Array, " k"],
    x: Float[Array, " k"],
    fixed: Bool[Array, " k"],
    bodies: Sequence[tuple[Body, Int[Array, " 10"]]],
) -> Float[Array, " k"]:
    """The minimum if some coefficients are fixed, ``bodies`` are in the cone, and all other coefficients are free."""
    at = np.concatenate([positions for _, positions in bodies])
    is_free = ~fixed
    is_free[at] = False
    free, x = np.flatnonzero(is_free), x.copy()
    right_side, rows = b - a @ np.where(fixed, x, 0.0), a[free]
    cross = rows[:, at]
    # The free coefficients are linear functions of those of the bodies.
    eliminated = solve(rows[:, free], np.column_stack([cross, right_side[free]]))
    scale = np.concatenate([body.given.scale for body, _ in bodies])
    gram = (a[np.ix_(at, at)] - cross.T @ eliminated[:, :-1]) * np.outer(scale, scale)
    gram += _CHANGE_PENALTY * np.eye(len(at))
    given, reach = (np.array(part) for part in zip(*(body.scaled for body, _ in bodies), strict=True))
    x[at] = scale * best_bodies(gram, (right_side[at] - cross.T @ eliminated[:, -1]) * scale, given, reach)
    x[free] = eliminated[:, -1] - eliminated[:, :-1] @ x[at]
    return x
