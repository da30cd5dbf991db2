"""Least squares with bodies that can exist: pseudo-inertias without a negative eigenvalue, centres within reach.

A quadratic loss is minimised over inertial parameters and other coefficients within bounds [Wensing]_. Bodies that are
impossible without that limit are found in the cone, by `cone_minimum`; all else is eliminated.

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

# How far an eigenvalue may lie below zero, as a share of the body's size: rounding of files.
_ROUNDING = 1e-6
# Weak prior, in squared deviations: loss of a change as large as the given body. It decides what the data do not.
_HELD = 1e-4
# Factor by which the box about a link is widened, and its smallest side as a share of the largest.
_WIDER, _THINNEST = 1.5, 0.5
# Reach of a link of a robot without any length [m].
_SOME_LENGTH = 0.3
# Squared deviations that releasing a bound has to gain.
_ACCURACY = 1e-6
# Times that bounds and bodies are exchanged; two or three are enough nearly always.
_EXCHANGES = 12


@dataclass(frozen=True)
class Body:
    """A body whose ten parameters a fit changes, and which of these changes make a body that can exist.

    Attributes:
        name: Name of the joint that moves it.
        columns: Columns of its changes, among those of a fit.
        given: The body of the model, the nearest possible one where that cannot exist.
        reach: Rows ``reach @ parameters >= 0`` of bodies whose centre is within reach.
    """

    name: str
    columns: tuple[int, ...]
    given: ReferenceBody
    reach: Float[Array, "F 10"]

    @cached_property
    def in_units(self) -> tuple[Float[Array, " 10"], Float[Array, "F 10"]]:
        """The given body and the rows of its reach in the body's own units, rows with a largest entry of one."""
        reach = self.reach * self.given.scale
        return self.given.standard / self.given.scale, reach / np.abs(reach).max(axis=1, keepdims=True)

    def exists(self, change: Float[Array, "*b 10"]) -> Array:
        """True where the given body with a change can exist, to rounding, ``(*b,)``; false where it is not finite."""
        finite: Array = np.asarray(np.isfinite(change).all(axis=-1, keepdims=True))
        parameters = (self.given.standard + np.where(finite, change, 0.0)) / self.given.scale
        least = np.linalg.eigvalsh(pseudo_inertia(parameters))[..., 0]
        within = parameters @ (self.reach * self.given.scale).T
        allowed = -_ROUNDING * np.abs(self.reach[:, 1:4]).max(initial=1.0)
        return finite[..., 0] & (least >= -_ROUNDING) & (within >= allowed).all(axis=-1)


@dataclass(frozen=True)
class Binding:
    """What binds at a minimum: bodies that would be impossible without their cone, and coefficients at their bounds.

    Attributes:
        bodies: Whether each is held in its cone.
        low, high: Coefficients at their lower and upper bounds, ``(k,)``.
    """

    bodies: tuple[bool, ...]
    low: Bool[Array, " k"]
    high: Bool[Array, " k"]


def bodies_of_term(robot: Robot, term: Term) -> tuple[Body, ...]:
    """Bodies whose inertial parameters an effect sets free."""
    own = term.effect.regressor_columns(robot, term.joint)
    return tuple(body_of(robot, own[at] // 10 + 1, term.columns[at : at + 10]) for at in range(0, len(own), 10))


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
    """The body of the model with its units; a body without mass has the mean mass of the others as its unit."""
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
    # Columns of a load come last, so that fitted columns are not in ascending order.
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
) -> Minimum:
    """A fit again among bodies that can exist, on all blocks and without each fold, where its own cannot.

    A fit whose bodies exist is the best of all that do, so that nothing is computed there.

    Args:
        found: The fit without that limit.
        square: Columns times columns.
        line: Columns times residual.
        precision: Prior precision of each coefficient.
        bounds: Bounds of each coefficient.
        folds: What each fold has of ``square`` and ``line``, None if nothing is held out.
        bodies: Bodies with the places of their changes.
    """

    def exist(x: Float[Array, " n"]) -> bool:
        return all(body.exists(x[at]) for body, at in bodies)

    if not bodies:
        return found
    with_prior = square + np.diag(precision)
    x, objective, without, binding = found.x, found.objective, found.without.copy(), None
    if not exist(x):
        x, binding = possible_minimum(with_prior, line, bounds, found.x, bodies)
        objective += _loss_of(with_prior, line, x) - _loss_of(with_prior, line, found.x)
    for k in range(len(without)):
        if folds is not None and not exist(without[k]):
            less, other = with_prior - folds[0][k], line - folds[1][k]
            without[k], _ = possible_minimum(less, other, bounds, without[k], bodies, binding)
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
    binding: Binding | None = None,
) -> tuple[Float[Array, " k"], Binding]:
    """Minimum of ``x a x / 2 - b x`` within bounds, with bodies that can exist.

    Coefficients are held at the bounds that bind, and bodies that cannot exist are found in the cone, with all else
    eliminated. Bounds and bodies that are then violated are taken in and bounds that pull the wrong way released, until
    there are none: that is the minimum, as the problem is convex.

    Args:
        a: Quadratic part, positive definite.
        b: Linear part.
        bounds: Lower and upper bounds; infinite for the bodies' coefficients.
        x: The minimum within the bounds alone.
        bodies: Each with the places of its changes among the coefficients.
        binding: What binds at the minimum of a similar loss, where there is one: it binds here, too, nearly always.

    Returns:
        The minimum, and what binds there.
    """
    lower, upper = bounds
    free_bodies = np.zeros(len(b), dtype=bool)
    free_bodies[np.concatenate([at for _, at in bodies])] = True
    if binding is None:
        within, low, high = tuple(not body.exists(x[at]) for body, at in bodies), x <= lower, x >= upper
    else:
        within, low, high = binding.bodies, binding.low, binding.high
        x = np.where(low, lower, np.where(high, upper, x))
    held = ~free_bodies & (low | high)
    for _ in range(_EXCHANGES):
        x = _in_cone(a, b, x, held, [one for one, taken in zip(bodies, within, strict=True) if taken])
        slope = a @ x - b
        inwards = np.where(x <= lower, slope < 0.0, slope > 0.0) & (slope**2 > _ACCURACY * np.diag(a))
        released, outside = held & inwards & (lower < upper), ~held & ((x < lower) | (x > upper))
        wrong = [not taken and not body.exists(x[at]) for (body, at), taken in zip(bodies, within, strict=True)]
        if not released.any() and not outside.any() and not any(wrong):
            return x, Binding(within, held & (x <= lower), held & (x >= upper))
        x, held = np.clip(x, lower, upper), (held & ~released) | outside
        within = tuple(taken or new for taken, new in zip(within, wrong, strict=True))
    # Near twins can exchange their bounds without end: all bodies in the cone, and the best of the rest beside them.
    x, others = np.clip(_in_cone(a, b, x, held, bodies), lower, upper), ~free_bodies
    beside = b[others] - a[np.ix_(others, free_bodies)] @ x[free_bodies]
    x[others] = bounded_solve(a[np.ix_(others, others)], beside, lower[others], upper[others])
    return x, Binding((True,) * len(bodies), others & (x <= lower), others & (x >= upper))


def _in_cone(
    a: Float[Array, "k k"],
    b: Float[Array, " k"],
    x: Float[Array, " k"],
    held: Bool[Array, " k"],
    bodies: Sequence[tuple[Body, Int[Array, " 10"]]],
) -> Float[Array, " k"]:
    """The minimum with some coefficients held and some bodies that can exist, all others free."""
    at = np.concatenate([places for _, places in bodies])
    rest = ~held
    rest[at] = False
    free, x = np.flatnonzero(rest), x.copy()
    line, rows = b - a @ np.where(held, x, 0.0), a[free]
    cross = rows[:, at]
    made = solve(rows[:, free], np.column_stack([cross, line[free]]))
    scale = np.concatenate([body.given.scale for body, _ in bodies])
    square = (a[np.ix_(at, at)] - cross.T @ made[:, :-1]) * np.outer(scale, scale) + _HELD * np.eye(len(at))
    given, reach = (np.array(part) for part in zip(*(body.in_units for body, _ in bodies), strict=True))
    x[at] = scale * best_bodies(square, (line[at] - cross.T @ made[:, -1]) * scale, given, reach)
    x[free] = made[:, -1] - made[:, :-1] @ x[at]
    return x
