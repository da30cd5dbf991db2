"""Regularised least squares on Gram matrices, with bounds and priors, scored on blocks held out of the fit.

Every fit works on products of columns (Gram matrices), never on samples. Two nonlinear cases are iterated: a torque
constant rescales its whole row, and a point mass is linearised about the last estimate of its mass and first moments.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from identification.diagnosis.fit.point_mass import STEPS, load_map, mass_bounds, reduced_load, settled
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.fit.products import Products, Scaling, products_of
from identification.diagnosis.model.terms import Term
from identification.diagnosis.numerics.bounded import bounded_solve, bounded_solve_without, solve

Array = np.ndarray


# Torque asked for over torque needed below which a row would vanish from a fit.
_LEAST_GAIN = 0.02


@dataclass(frozen=True)
class Fitted:
    """Result of one fit.

    Attributes:
        theta: All coefficients, zero where a column is not in the model, ``(K,)``.
        active: Columns in the model.
        normal: Products of what was fitted, priors counted, ``(n, n)``.
        expand: Active coefficients that a unit of each number that was fitted moves, None if they are the same.
        penalty: What the moves of the nuisances cost: their squares in sigmas, summed.
        objective: Loss over all training blocks with penalty and priors, in sample, up to a constant.
        loss: Weighted squared residual of each block's core, each predicted by a fit that has not seen it, ``(B,)``.
        fold_theta: Coefficients of the fit that has not seen each fold, ``(F, K)``.
    """

    theta: Float[Array, " K"]
    active: Int[Array, " k"]
    normal: Float[Array, "n n"]
    expand: Float[Array, "k n"] | None
    penalty: float
    objective: float
    loss: Float[Array, " B"]
    fold_theta: Float[Array, "F K"]

    @property
    def total(self) -> float:
        """Held-out loss over all blocks, and what the moves of the nuisances cost."""
        return float(self.loss.sum()) + self.penalty

    @cached_property
    def cov(self) -> Float[Array, "k k"]:
        """Covariance of the active coefficients with priors; computed on demand, as few fits need it."""
        inverse = solve(self.normal, np.eye(len(self.normal)))
        return inverse if self.expand is None else self.expand @ inverse @ self.expand.T


@dataclass(frozen=True)
class Near:
    """Coefficients of a similar fit, from which the next one starts.

    Attributes:
        theta: All coefficients, NaN where a column is not in it, ``(K,)``.
        payload: Mass and first moments of a payload, ``(4,)``; None if there was none.
    """

    theta: Float[Array, " K"]
    payload: Float[Array, " 4"] | None = None

    @staticmethod
    def nothing(problem: Problem) -> Near:
        """The start of a fit without a similar one."""
        return Near(np.full(len(problem.precision), np.nan))

    def after(self, found: Fitted, terms: tuple[Term, ...]) -> Near:
        """A fit of these terms, and the payload of the last fit that had one."""
        theta, payload = np.full(len(found.theta), np.nan), self.payload
        theta[found.active] = found.theta[found.active]
        for term in terms:
            if term.effect.inertial == "point mass":
                payload = found.theta[list(term.columns[:4])]
        return Near(theta, payload)


def active_columns(problem: Problem, terms: tuple[Term, ...]) -> Int[Array, " k"]:
    """Sorted indices of the nuisance columns and of the columns of the terms."""
    chosen = sorted({column for term in terms for column in term.columns})
    return np.array([*range(problem.nuisances), *chosen], dtype=int)


def fit(problem: Problem, terms: tuple[Term, ...], *, held_out: bool = True, near: Near | None = None) -> Fitted:
    """Fit nuisances and terms together, on all blocks and once without each fold.

    Args:
        problem: Columns, products, priors.
        terms: The effects in the model.
        held_out: False leaves the fits without folds out; the loss is then that of the one fit, in sample.
        near: A similar fit, to start from.
    """
    near = Near.nothing(problem) if near is None else near
    scaled = [term for term in terms if term.effect.scales_joint]
    if not scaled:
        return _fit_at_point(problem, terms, (), held_out, near)
    # A torque constant multiplies everything else on its row: refit about the last gain.
    columns = [term.columns[0] for term in scaled]
    rows = [next(j for j, row in enumerate(problem.columns.rows) if column in row) for column in columns]
    gains, scalings = np.ones(len(scaled)), ()
    for _ in range(4):
        found = _fit_at_point(_beyond(problem, columns, gains - 1.0), terms, scalings, False, near)
        step = found.theta[columns]
        gains = np.maximum(gains + step, _LEAST_GAIN)
        theta = found.theta.copy()
        theta[columns] = 0.0
        scalings = tuple(
            Scaling(row, column, float(gain), theta) for row, column, gain in zip(rows, columns, gains, strict=True)
        )
        if np.all(np.abs(step) < 1e-3):
            break
    found = _fit_at_point(_beyond(problem, columns, gains - 1.0), terms, scalings, held_out, near)
    theta, fold_theta = found.theta.copy(), found.fold_theta.copy()
    theta[columns] += gains - 1.0
    if len(fold_theta):
        fold_theta[:, columns] += gains - 1.0
    return replace(found, theta=theta, fold_theta=fold_theta)


def _beyond(problem: Problem, columns: list[int], part: Float[Array, " k"]) -> Problem:
    """The same problem with bounds for what some coefficients have beyond a part of them."""
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[columns] -= part
    upper[columns] -= part
    return replace(problem, lower=lower, upper=upper)


def predict(
    problem: Problem, terms: tuple[Term, ...], theta: Float[Array, " K"], log: int, part: slice = slice(None)
) -> Float[Array, "n nv"]:
    """Torque of the given model with nuisances and terms, in the band, on a part of one log, ``(n, nv)``."""
    columns = problem.columns
    own = [term.columns[0] for term in terms if term.effect.scales_joint]
    others = theta.copy()
    others[own] = 0.0
    model = columns.model_torque[log][part]
    out = np.empty_like(model)
    for j, index in enumerate(columns.rows):
        values = columns.values[log][j][part]
        beside = values @ others[list(index)]
        out[:, j] = model[:, j] + beside
        for column in set(own) & set(index):
            # The gain scales what its column shows of the modelled torque, and all that is fitted beside it.
            out[:, j] += theta[column] * (values[:, index.index(column)] + beside)
    return out


def _fit_at_point(
    problem: Problem,
    terms: tuple[Term, ...],
    scalings: tuple[Scaling, ...],
    held_out: bool,
    near: Near,
) -> Fitted:
    """Fit with the torque constants linear; a payload is linearised about its own last estimate."""
    payload = next((term for term in terms if term.effect.inertial == "point mass"), None)
    active = active_columns(problem, terms)
    products = products_of(problem, active, scalings, held_out)
    if payload is None:
        return _fit_linear(problem, active, products, None, near)
    start = _point_mass(problem, active, replace(products, held_out=None), payload, near)
    return _fit_linear(problem, active, products, (payload, start), near)


def _point_mass(
    problem: Problem,
    active: Int[Array, " k"],
    products: Products,
    payload: Term,
    near: Near,
) -> Float[Array, " 4"]:
    """Mass and first moments of the best point mass.

    The inertia ``(h.h 1 - h h^T) / m`` makes the fit quadratic, so it is linearised about the last estimate, from
    several starts: a fit whose inertia is free, which a load far out needs, one without inertia, and its first moments
    at distances of 3 cm to 1.5 m. All starts are followed with the other columns eliminated; the best one is followed
    to its end with all bounds.
    """
    first = _fit_linear(problem, active, products, (payload, np.zeros(4)), near)
    moments = first.theta[list(payload.columns[1:4])]
    far = max(float(np.linalg.norm(moments)), 1e-9)
    # Where no lever shows, the mass does by itself.
    starts = [first.theta[list(payload.columns[:4])]]
    whole = _fit_linear(problem, active, products, None, near)
    free = whole.theta[list(payload.columns)]
    inertia = float(free[[4, 6, 9]].sum())
    least = payload.effect.lightest(problem.session.robot)
    if inertia != 0 and free[1:4].any():
        mass = float(free[1:4] @ free[1:4]) / inertia
        starts.insert(0, np.array([max(mass, least), *free[1:4]]))
    if near.payload is not None and near.payload[0] != 0:
        starts = [near.payload, starts[0]]
    else:
        starts += [np.array([far / distance, *moments]) for distance in (0.03, 0.08, 0.2, 0.5, 1.5)]
        # What the model carries and the robot does not, at such distances too.
        missing = (distance for distance in (0.03, 0.08, 0.2, 0.5) if far < -least * distance)
        starts += [np.array([-far / distance, *moments]) for distance in missing]
    reduced = reduced_load(problem, active, products, payload, whole.theta)
    start = min((reduced.followed(start) for start in starts), key=reduced.loss)
    for _ in range(STEPS):
        last = start
        start = _fit_linear(problem, active, products, (payload, last), near).theta[list(payload.columns[:4])]
        if settled(start, last):
            break
    return start


def _fit_linear(
    problem: Problem,
    active: Int[Array, " k"],
    products: Products,
    point: tuple[Term, Float[Array, " 4"]] | None,
    near: Near,
) -> Fitted:
    """Fit with every coefficient linear; a payload through `load_map` about the given start."""
    precision, lower, upper, bound = (x[active] for x in (problem.precision, problem.lower, problem.upper, near.theta))
    expand, shift = None, 0.0
    total_a, total_b, constant = products.a, products.b, products.c
    if point is not None:
        term, start = point
        jacobian, offset = load_map(problem, term, start)
        at = np.searchsorted(active, term.columns)
        others = np.setdiff1d(np.arange(len(active)), at)
        expand = np.zeros((len(active), len(others) + 4))
        expand[others, np.arange(len(others))] = 1.0
        expand[at[:, None], len(others) + np.arange(4)] = jacobian
        shift = np.zeros(len(active))
        shift[at] = offset
        constant += float(shift @ total_a @ shift - 2 * total_b @ shift)
        total_b = (total_b - total_a @ shift) @ expand
        total_a = expand.T @ total_a @ expand
        keep = np.concatenate([others, at[:4]])
        precision, lower, upper, bound = precision[keep], lower[keep], upper[keep], bound[keep]
        lower[len(others)], upper[len(others)] = mass_bounds(start[0], term.effect.lightest(problem.session.robot))
    with_prior = total_a.copy()
    with_prior.flat[:: len(with_prior) + 1] += precision
    x = bounded_solve(with_prior, total_b, lower, upper, near=bound)
    theta = np.zeros(len(problem.precision))
    theta[active] = x if expand is None else expand @ x + shift
    moves = slice(0, problem.nuisances)
    penalty = float(theta[moves] ** 2 @ problem.precision[moves])
    objective = float(constant - 2 * total_b @ x + x @ total_a @ x + precision @ x**2)
    held_out = products.held_out
    if held_out is None:
        return Fitted(theta, active, with_prior, expand, penalty, objective, np.zeros(0), np.zeros((0, 0)))
    less_a, less_b = held_out.a, held_out.b
    if expand is not None:
        less_a, less_b = expand.T @ less_a @ expand, (less_b - less_a @ shift) @ expand
    fold_x = bounded_solve_without(with_prior, total_b, less_a, less_b, lower, upper, x)
    if expand is not None:
        fold_x = fold_x @ expand.T + shift
    fold = problem.grams.fold
    loss = held_out.losses(np.where(fold[:, None] >= 0, fold_x[fold], theta[active]))
    fold_theta = np.zeros((len(fold_x), len(theta)))
    fold_theta[:, active] = fold_x
    return Fitted(theta, active, with_prior, expand, penalty, objective, loss, fold_theta)
