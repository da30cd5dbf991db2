"""Regularised least squares on Gram matrices, with bounds and priors, scored on blocks held out of the fit.

Every fit works on products of columns (Gram matrices), never on samples. A row is one joint's torque. A nuisance is a
change of the model within its tolerances. A fold is a group of blocks that are held out together. The fit is linear
with two exceptions, which are solved by iteration. The gain of a wrong torque constant (the ratio of measured to true
torque) multiplies all torques of its row. The inertia of a point mass is not linear in mass and first moments.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.point_mass import (
    STEPS,
    PayloadMap,
    best_estimate,
    converged,
    load_jacobian,
    mass_bounds,
)
from identification.diagnosis.fit.possible_bodies import Body, positions_of_bodies, with_possible_bodies
from identification.diagnosis.fit.problem import Problem
from identification.engine.fits.bilinear import Products, Scaling, products_of
from identification.engine.fits.minimum import minimum_of
from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float, Int

# Smallest gain of a torque constant; smaller estimates are raised to it. At a gain of zero, the torques of its joint
# would vanish from the fit.
_LEAST_GAIN = 0.02


@dataclass(frozen=True)
class Fitted:
    """Result of one fit.

    Attributes:
        problem: The problem that was fitted.
        point: The estimate about which nonlinear laws were linearised.
        theta: All coefficients, ``(K,)``; zero for columns that are not fitted.
        active: Indices of the fitted columns, ``(k,)``.
        penalty: Cost of the nuisances: sum of their squares, each in standard deviations of its prior.
        objective: In-sample loss over all training blocks with all priors, up to a constant.
        loss: Weighted squared residual of each block's core, predicted by a fit to other blocks, ``(B,)``.
        fold_active: Coefficients of the fitted columns in the fit without each fold, ``(F, k)``.
        denied_gain: Decrease of the in-sample loss if physically impossible bodies were allowed.
    """

    problem: Problem
    point: LinearisationPoint
    theta: Float[Array, " K"]
    active: Int[Array, " k"]
    penalty: float
    objective: float
    loss: Float[Array, " B"]
    fold_active: Float[Array, "F k"]
    denied_gain: float = 0.0

    @property
    def total(self) -> float:
        """Held-out loss over all blocks plus the penalty."""
        return float(self.loss.sum()) + self.penalty

    def coefficients_of(self, term: Term) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
        """Coefficients of an effect, ``(n,)``, and their covariance, ``(n, n)``."""
        own = np.searchsorted(self.active, term.columns)
        return self.theta[list(term.columns)], self.cov[np.ix_(own, own)]

    @cached_property
    def row_losses(self) -> Float[Array, " nv"]:
        """Weighted squared residual of each row over the cores of all blocks, by the fit to all training blocks."""
        out, scales = [], {scaling.row: scaling.column for scaling in self.point.scalings}
        for j, row in enumerate(self.problem.grams.rows):
            theta, (a, b, c) = self.theta[row.index], row.core_total
            if j in scales:
                # A torque constant multiplies everything else on its row.
                theta *= np.where(row.index == scales[j], 1.0, 1.0 + self.theta[scales[j]])
            used = np.flatnonzero(theta)
            x = theta[used]
            out.append(c - 2 * b[used] @ x + x @ a[used[:, None], used] @ x)
        return np.array(out)

    @property
    def fold_theta(self) -> Float[Array, "F K"]:
        """All coefficients of the fit without each fold."""
        out = np.zeros((len(self.fold_active), len(self.theta)))
        out[:, self.active] = self.fold_active
        return out

    @property
    def expansion(self) -> Float[Array, "k n"] | None:
        """Derivative of the active coefficients with respect to the fitted parameters; None if both are the same.

        They differ if a payload's ten coefficients follow from its mass and first moments.
        """
        return None if self._payload_map is None else self._payload_map.jacobian_of_all

    @cached_property
    def cov(self) -> Float[Array, "k k"]:
        """Covariance of the active coefficients, including their priors; computed on demand, as few fits need it."""
        a, precision = products_of(self.problem, self.active, self.point.scalings, False).a, self.problem.precision
        payload_map = self._payload_map
        fitted = self.active if payload_map is None else self.active[payload_map.kept_columns]
        gram = a if payload_map is None else payload_map.reduced_gram(a)
        inverse = solve(gram + np.diag(precision[fitted]), np.eye(len(fitted)))
        return inverse if payload_map is None else payload_map.expanded(payload_map.expanded(inverse).T)

    @cached_property
    def _payload_map(self) -> PayloadMap | None:
        return None if self.point.payload is None else _payload_map_at(self.problem, self.active, self.point.payload)


@dataclass(frozen=True)
class LoadEstimate:
    """A payload and the estimate about which it is linearised.

    Attributes:
        term: The effect.
        start: Mass [kg] and first moments [kg m] about which its inertia is linearised, ``(4,)``.
    """

    term: Term
    start: Float[Array, " 4"]


@dataclass(frozen=True)
class LinearisationPoint:
    """The estimate about which nonlinear laws are linearised.

    Attributes:
        scalings: Gain of each wrong torque constant, with the coefficients of all other columns on its row.
        payload: The payload with its estimate; None if there is none.
    """

    scalings: tuple[Scaling, ...] = ()
    payload: LoadEstimate | None = None

    @property
    def iterated(self) -> bool:
        """True if a law is nonlinear, so that this estimate comes from an iteration."""
        return bool(self.scalings) or self.payload is not None


@dataclass(frozen=True)
class WarmStart:
    """Coefficients of a similar fit, from which the next fit starts.

    Attributes:
        theta: All coefficients, ``(K,)``; NaN for columns that are not in that fit.
        payload: Mass [kg] and first moments [kg m] of a payload, ``(4,)``; None if there is none.
    """

    theta: Float[Array, " K"]
    payload: Float[Array, " 4"] | None = None

    @staticmethod
    def empty(problem: Problem) -> WarmStart:
        """A start without any coefficients, for use if no similar fit is known."""
        return WarmStart(np.full(len(problem.precision), np.nan))

    def after(self, found: Fitted, terms: tuple[Term, ...]) -> WarmStart:
        """The start of the next fit, from a fit ``found`` of ``terms``; if it has no payload, the last one remains."""
        theta, payload = np.full(len(found.theta), np.nan), self.payload
        theta[found.active] = found.theta[found.active]
        for term in terms:
            if term.effect.inertial == "point mass":
                payload = found.theta[list(term.columns[:4])]
        return WarmStart(theta, payload)


def active_columns(problem: Problem, terms: tuple[Term, ...]) -> Int[Array, " k"]:
    """Indices of the columns of a fit, ascending: those of the nuisances that all fits contain, and of the terms."""
    chosen = sorted({column for term in terms for column in term.columns})
    return np.array([*problem.fitted_nuisances, *chosen], dtype=int)


def fit(
    problem: Problem,
    terms: tuple[Term, ...],
    *,
    held_out: bool = True,
    near: WarmStart | None = None,
    point: LinearisationPoint | None = None,
) -> Fitted:
    """Fit nuisances and terms together, on all blocks and once without each fold.

    Args:
        problem: Columns, products, priors.
        terms: The effects in the model.
        held_out: False skips the fits without each fold; `Fitted.loss` is then empty.
        near: Coefficients of a similar fit, from which this fit starts; None if there is none.
        point: The estimate about which to linearise; None to find it by iteration.
    """
    near = WarmStart.empty(problem) if near is None else near
    scaled = [term for term in terms if term.effect.scales_joint]
    if not scaled:
        return _fit_at_point(problem, terms, (), held_out, near, None if point is None else point.payload)
    # A torque constant multiplies everything else on its row. So the fit is repeated, linearised about the last gain.
    # In these fits its coefficient is the difference from the last gain; at the end, the gain minus one is added.
    columns = [term.columns[0] for term in scaled]
    rows = [sorted(problem.rows_of_column[column]) for column in columns]

    def scalings_at(gains: Float[Array, " s"], theta: Float[Array, " K"]) -> tuple[Scaling, ...]:
        """Linearisation of each row of the torque constants, at given gains and coefficients of the other columns."""
        others = np.where(np.isin(np.arange(len(theta)), columns), 0.0, np.nan_to_num(theta))
        return tuple(
            Scaling(row, column, float(gain), others)
            for own, column, gain in zip(rows, columns, gains, strict=True)
            for row in own
        )

    scalings = () if point is None else point.scalings
    known = {scaling.column: scaling.gain for scaling in scalings}
    gains = np.array([known.get(column, 1.0) for column in columns])
    if not scalings and np.isfinite(near.theta[columns]).any():
        gains = np.maximum(1.0 + np.nan_to_num(near.theta[columns]), _LEAST_GAIN)
        scalings = scalings_at(gains, near.theta)
    # Known gains need no iteration.
    for _ in range(0 if known else 4):
        found = _fit_at_point(_shifted_bounds(problem, columns, gains - 1.0), terms, scalings, False, near, None)
        # The next fit starts from this one, because nearly the same bounds are active there.
        near = near.after(found, ())
        step = found.theta[columns]
        gains = np.maximum(gains + step, _LEAST_GAIN)
        scalings = scalings_at(gains, found.theta)
        if np.all(np.abs(step) < 1e-3):
            break
    payload = None if point is None else point.payload
    found = _fit_at_point(_shifted_bounds(problem, columns, gains - 1.0), terms, scalings, held_out, near, payload)
    theta, fold_active = found.theta.copy(), found.fold_active.copy()
    theta[columns] += gains - 1.0
    fold_active[:, np.searchsorted(found.active, columns)] += gains - 1.0
    return replace(found, problem=problem, theta=theta, fold_active=fold_active)


def _shifted_bounds(problem: Problem, columns: list[int], origin: Float[Array, " k"]) -> Problem:
    """The problem in which some coefficients are differences from the values ``origin``: their bounds are shifted."""
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[columns] -= origin
    upper[columns] -= origin
    return replace(problem, lower=lower, upper=upper)


def predict(
    problem: Problem, terms: tuple[Term, ...], theta: Float[Array, " K"], log: int, part: slice = slice(None)
) -> Float[Array, "n nv"]:
    """Torque of a part of one log with nuisances and terms [N m or N], in the band of the fits, ``(n, nv)``."""
    columns = problem.columns
    of_gains = [term.columns[0] for term in terms if term.effect.scales_joint]
    others = theta.copy()
    others[of_gains] = 0.0
    model = columns.model_torque[log][part]
    out = np.empty_like(model)
    for j, index in enumerate(columns.rows):
        values = columns.values[log][j][part]
        fitted = values @ others[list(index)]
        out[:, j] = model[:, j] + fitted
        for column in set(of_gains) & set(index):
            # The gain scales its own column, which is the modelled torque, and all other fitted torques.
            out[:, j] += theta[column] * (values[:, index.index(column)] + fitted)
    return out


def _fit_at_point(
    problem: Problem,
    terms: tuple[Term, ...],
    scalings: tuple[Scaling, ...],
    held_out: bool,
    near: WarmStart,
    load: LoadEstimate | None,
) -> Fitted:
    """Fit at given gains of the torque constants, with a payload linearised about ``load`` or its best estimate."""
    payload = next((term for term in terms if term.effect.inertial == "point mass"), None)
    active = active_columns(problem, terms)
    products = products_of(problem, active, scalings, held_out)
    if payload is not None and load is None:
        load = LoadEstimate(payload, _point_mass(problem, active, replace(products, held_out=None), payload, near))
    return _fit_linear(problem, active, products, LinearisationPoint(scalings, load), near, problem.bodies_of(terms))


def _point_mass(
    problem: Problem,
    active: Int[Array, " k"],
    products: Products,
    payload: Term,
    near: WarmStart,
) -> Float[Array, " 4"]:
    """Mass [kg] and first moments [kg m] of the best point mass.

    The inertia ``(h.h 1 - h h^T) / m`` is not linear in mass ``m`` and first moments ``h``. So it is linearised
    repeatedly about the last estimate. If there is no similar fit with a payload, there are several starts:

    - a fit with free inertia, which suits a load far from the joint;
    - a fit without inertia;
    - the first moments of the latter, with the masses that they imply at distances of 3 cm to 1.5 m.

    All starts are iterated with the other columns eliminated. The best result is then iterated with all bounds.
    """
    # Linearised about zero mass, a point mass has no inertia.
    massless = LinearisationPoint(payload=LoadEstimate(payload, np.zeros(4)))
    without_inertia = _fit_linear(problem, active, products, massless, near)
    near = near.after(without_inertia, ())
    starts = [without_inertia.theta[list(payload.columns[:4])]]
    moments = starts[0][1:]
    moment = max(float(np.linalg.norm(moments)), 1e-9)
    free_inertia = _fit_linear(problem, active, products, LinearisationPoint(), near)
    parameters = free_inertia.theta[list(payload.columns)]
    trace = float(parameters[[4, 6, 9]].sum())
    least_mass = payload.effect.lightest(problem.session.robot)
    if trace != 0 and parameters[1:4].any():
        mass = float(parameters[1:4] @ parameters[1:4]) / trace
        starts.insert(0, np.array([max(mass, least_mass), *parameters[1:4]]))
    if near.payload is not None and near.payload[0] != 0:
        starts = [near.payload, starts[0]]
    else:
        starts += [np.array([moment / distance, *moments]) for distance in (0.03, 0.08, 0.2, 0.5, 1.5)]
        # The robot may lack a mass that the model has: negative masses at the same distances.
        possible = (distance for distance in (0.03, 0.08, 0.2, 0.5) if moment < -least_mass * distance)
        starts += [np.array([-moment / distance, *moments]) for distance in possible]
    estimate = best_estimate(problem, active, products, payload, free_inertia.theta, starts)
    for _ in range(STEPS):
        last = estimate
        found = _fit_linear(problem, active, products, LinearisationPoint(payload=LoadEstimate(payload, last)), near)
        near, estimate = near.after(found, ()), found.theta[list(payload.columns[:4])]
        if converged(estimate, last):
            break
    return estimate


def _fit_linear(
    problem: Problem,
    active: Int[Array, " k"],
    products: Products,
    point: LinearisationPoint,
    near: WarmStart,
    bodies: tuple[Body, ...] = (),
) -> Fitted:
    """Linear fit of all coefficients about a linearisation point.

    Args:
        problem: Columns, priors and bounds.
        active: Indices of the fitted columns.
        products: Products of these columns.
        point: The estimate about which torque constants and a payload are linearised.
        near: Coefficients from which the search for active bounds starts.
        bodies: Bodies that must be physically possible.
    """
    load, payload_map, fitted, held_out = point.payload, None, active, products.held_out
    gram, right_side, folds = products.a, products.b, None if held_out is None else (held_out.a, held_out.b)
    if load is not None:
        # The ten columns of the payload are combined to four: those of mass and first moments.
        payload_map = _payload_map_at(problem, active, load)
        fitted, gram, right_side = (
            active[payload_map.kept_columns],
            payload_map.reduced_gram(gram),
            payload_map.reduced_right_side(right_side),
        )
        folds = (
            None if folds is None else (payload_map.reduced_gram(folds[0]), payload_map.reduced_right_side(folds[1]))
        )
    precision, lower, upper, start = (x[fitted] for x in (problem.precision, problem.lower, problem.upper, near.theta))
    if load is not None:
        mass = len(fitted) - 4
        lower[mass], upper[mass] = mass_bounds(load.start[0], load.term.effect.lightest(problem.session.robot))
    unconstrained = minimum_of(gram, right_side, products.c, precision, (lower, upper), start, folds)
    positions = positions_of_bodies(fitted, bodies)
    found = with_possible_bodies(unconstrained, gram, right_side, precision, (lower, upper), folds, positions)
    theta = np.zeros(len(problem.precision))
    theta[active] = found.x if payload_map is None else payload_map.expanded(found.x)
    nuisances = slice(0, problem.nuisance_count)
    penalty = float(theta[nuisances] ** 2 @ problem.precision[nuisances])
    loss, fold_x = np.zeros(0), np.zeros((0, len(active)))
    if held_out is not None:
        fold_x = found.without if payload_map is None else payload_map.expanded(found.without)
        fold = problem.grams.fold
        # Blocks of recordings that no fit uses (fold -1) are predicted by the fit to all other blocks.
        loss = held_out.losses(np.where(fold[:, None] >= 0, fold_x[fold], theta[active]))
    denied_gain = found.objective - unconstrained.objective
    return Fitted(problem, point, theta, active, penalty, found.objective, loss, fold_x, denied_gain)


def _payload_map_at(problem: Problem, active: Int[Array, " k"], load: LoadEstimate) -> PayloadMap:
    """Map from the ten columns of a payload to four, linearised about the estimate ``load``."""
    jacobian = load_jacobian(problem.session.robot, load.term, load.start)
    return PayloadMap(np.searchsorted(active, load.term.columns), len(active), jacobian)
