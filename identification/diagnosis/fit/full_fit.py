"""Gauss-Newton over all parameters of a diagnosis: tolerance parameters, coefficients and shapes.

A term is one effect on one joint. Its torque is linear in its coefficients, and not linear in its shape, such as a
delay. The search takes shapes from a grid and solves for the coefficients (variable projection). Here a few
Gauss-Newton steps change shapes and coefficients together.

The covariance includes sources of error that the search neglects: the correlation of shapes with coefficients, the
tolerances of the model, scatter from block to block beyond the modelled noise, and residuals that repeat at the same
state because the laws are not exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.one_recording_effects import OneRecordingEffect
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.covariance import covariance, free_parameters
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.other_law import other_law_shift
from identification.diagnosis.fit.possible_bodies import Body, possible_minimum
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.fit.repeated_error import equations, repeated_covariance
from identification.diagnosis.fit.whole_model import (
    Linearised,
    ModelLayout,
    TermSlices,
    columns_of,
    in_band,
    lay_out,
    linearised,
    torque_change,
    weighted_products,
)
from identification.engine.numerics.bounded import bounded_solve, solve
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.random_streams import random_stream

# A parameter is unobservable if its information (inverse variance), in its own units, is below this.
_LEAST_INFORMATION = 1e-200
# Largest number of steps of a fit.
_STEPS = 4
# Columns that depend on the model are computed again if a tolerance parameter changes by more sigmas than this.
_SAME_MODEL_CHANGE = 0.3
# Decrease of the loss [squared standard deviations] below which no further step is taken.
_LEAST_GAIN = 0.02
# Number of models that are drawn for the covariance from columns that depend on the uncertain model.
_MODEL_DRAWS = 4
# Number of parameter vectors that are drawn, and least number of them within the tolerances. With that many, a standard
# deviation is accurate to a tenth; with fewer, the covariance is not restricted to the tolerances.
_TOLERANCE_DRAWS, _LEAST_INSIDE = 2000, 100
# Name of the effect of a rotor's inertia; standard deviation of the inertia of a rotor that the model does not state,
# as a share of the inertia that the joint carries; number of postures over which the carried inertia is averaged.
_ROTOR_EFFECT, _ROTOR_SHARE, _POSTURES = "rotor_inertia", 0.5, 20
# Standard deviation of the radius of gyration of a load [m], for weights and tools of some kilograms; indices of the
# three moments of inertia among the ten parameters of a body.
_RADIUS_OF_GYRATION, _MOMENTS_OF_INERTIA = 0.04, [4, 6, 9]
# Bounds of a tolerance parameter restrict the draws only if its correlation with another parameter is larger than this.
_CORRELATED = 0.1


@dataclass(frozen=True)
class FullFit:
    """Parameters and covariance of a Gauss-Newton fit over all parameters.

    Attributes:
        term_slices: Slices of each term's parameters in the vector.
        x: All parameters.
        cov: Their covariance.
        prior: Prior variance of each parameter.
        law_covariances: For each term, the part of ``cov`` from other laws that the effect may follow.
    """

    term_slices: tuple[TermSlices, ...]
    x: Float[Array, " p"]
    cov: Float[Array, "p p"]
    prior: Float[Array, " p"]
    law_covariances: tuple[Float[Array, "p p"], ...]

    def slices_of(self, term: Term) -> TermSlices:
        """Slices of the parameters of one term."""
        return next(slices for slices in self.term_slices if slices.term is term)

    def presence_covariance(self, term: Term) -> Float[Array, "k k"]:
        """Covariance of the coefficients and the shape of one term, for the test whether the effect is present.

        For this test it does not matter which of its laws the effect follows, so this uncertainty is left out. That of
        the laws of other effects is included.
        """
        slices = self.slices_of(term)
        own = np.ix_(slices.indices, slices.indices)
        return (self.cov - self.law_covariances[self.term_slices.index(slices)])[own]

    def coefficients(self, term: Term) -> Float[Array, " k"]:
        """Coefficients of one term."""
        return self.x[self.slices_of(term).coefficients]


def full_fit(problem: Problem, terms: tuple[Term, ...], found: Fitted) -> FullFit:
    """Fit tolerance parameters, coefficients and shapes together, starting from a fit with fixed shapes.

    Args:
        problem: Columns of the recordings in the judged band, their priors and bounds.
        terms: The effects in the model.
        found: Their fit with fixed shapes.
    """
    layout, x = lay_out(problem, terms, found)
    precision, lower, upper = _priors_and_bounds(layout, x)
    nuisances = slice(0, problem.nuisance_count)
    start = x[nuisances]
    layout = layout.adjusted(start) if layout.depends_on_model else layout
    x, model, (a, b, _) = _gauss_newton(layout, x, precision, lower, upper)
    if layout.depends_on_model and np.any(precision[nuisances] * (x[nuisances] - start) ** 2 > _SAME_MODEL_CHANGE**2):
        layout = layout.adjusted(x[nuisances])
        x, model, (a, b, _) = _gauss_newton(layout, x, precision, lower, upper)
    # Unobservable parameters keep their values: for example, an inertia of a link that never turns about that axis.
    precision = np.where(np.einsum("bkk->k", a) + precision < _LEAST_INFORMATION, 1.0, precision)
    total, free = a.sum(axis=0) + np.diag(precision), free_parameters(b, precision, x, (lower, upper))
    linear, repeated = equations(layout, model), np.zeros((len(x), len(x)))
    repeated[np.ix_(free, free)] = repeated_covariance(
        linear.slopes[:, free], linear.residual, total[np.ix_(free, free)], linear.states, linear.blocks
    )
    # The scatter between some blocks says little about the correlations of the ten parameters of a body.
    together = tuple(
        slice(slices.coefficients.start, slices.shape.stop)
        for slices in layout.term_slices
        if slices.term.effect.inertial is None
    )
    cov = covariance(a, b, precision, x, free, repeated, together)
    if layout.depends_on_model:
        cov = cov + _model_covariance(layout, model, x, cov, total)
    cov = within_tolerances(x, cov, problem.nuisance_count, lower, upper)
    # A term may follow another law. The shift of all parameters under that law is taken as a standard deviation.
    by_law: list[Array] = []
    limits = (precision, lower, upper)
    for slices in layout.term_slices:
        effect, at = slices.term.effect, slices.coefficients
        by_other_laws = (other_law_shift(layout, model, x, slices, law, limits) for law in effect.other_laws)
        shifts = (_share_shift(slices, x), *by_other_laws)
        by_law.append(sum((np.outer(shift, shift) for shift in shifts), np.zeros_like(cov)))
        if effect.inertial == "point mass":
            # The extent of the load and missing rotors add to the uncertainty of the load alone.
            shift = load_extent_shift(layout, model, x, slices, total)
            by_law[-1][at, at] += (np.outer(shift, shift) + rotor_covariance(layout, model, total))[at, at]
    prior = 1.0 / np.maximum(precision, _LEAST_INFORMATION)
    return FullFit(layout.term_slices, x, cov + sum(by_law), prior, tuple(by_law))


def within_tolerances(
    x: Float[Array, " p"],
    cov: Float[Array, "p p"],
    nuisance_count: int,
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
) -> Float[Array, "p p"]:
    """Covariance of all parameters if every tolerance parameter is within its bounds.

    Parameters are drawn from the given covariance, and draws outside the bounds are discarded. So near a bound of a
    tolerance parameter the standard deviations of all parameters that correlate with it become smaller. The tolerance
    parameters themselves keep their standard deviations.

    Args:
        x: All parameters, the tolerance parameters first.
        cov: Their covariance.
        nuisance_count: Number of tolerance parameters.
        lower: Lower bounds of all parameters.
        upper: Upper bounds of all parameters.
    """
    std = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    rng = random_stream("sizes within the tolerances")
    # In standard deviations, as the parameters have different units.
    correlation = cov / np.outer(std, std)
    correlated = np.flatnonzero(
        np.abs(correlation[:nuisance_count, nuisance_count:]).max(axis=1, initial=0.0) > _CORRELATED
    )
    values, vectors = np.linalg.eigh(correlation)
    # The symmetric root is unique: with another root the draws would depend on the rounding of the matrix.
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    drawn = rng.standard_normal((_TOLERANCE_DRAWS, len(x))) @ root
    low, high = ((end - x)[correlated] / std[correlated] for end in (lower, upper))
    inside = ((drawn[:, correlated] >= low) & (drawn[:, correlated] <= high)).all(axis=1)
    if inside.sum() < _LEAST_INSIDE:
        return cov
    factor = np.minimum(drawn[inside].std(axis=0) / np.maximum(drawn.std(axis=0), 1e-300), 1.0)
    factor[:nuisance_count] = 1.0
    return cov * np.outer(factor, factor)


def _share_shift(slices: TermSlices, x: Float[Array, " p"]) -> Float[Array, " p"]:
    """Shift of all parameters by the first-order error of a term's shape: its coefficient should be one, but is not.

    Some effects, such as a backlash gap or a limit, have no size but their shape. If a coefficient other than one fits
    best, the shape is wrong by about the same share. For all other effects the shift is zero.
    """
    shift = np.zeros(len(x))
    if slices.term.effect.seen_by != "coefficient":
        shift[slices.shape] = (1.0 - x[slices.coefficients]) * x[slices.shape]
    return shift


def rotor_covariance(layout: ModelLayout, model: Linearised, total: Float[Array, "p p"]) -> Float[Array, "p p"]:
    """Covariance of all parameters from the unknown inertia of rotors that the model does not state.

    Models often lack rotors, whose inertia behind a gear is as large as that of the links. Parameters of a load that
    are identified by its inertia alone, such as the mass of a pendulum of known first moment, are then uncertain.
    Rotors that the model states are left out, because their inertia has a tolerance. Rotors that are an effect in this
    fit are left out, because their inertia is fitted. If recordings are compared with each other, stated rotors are
    included: a different delay of the torque in one recording looks like an inertia.
    """
    robot = layout.problem.session.robot
    fitted = {slices.term.joint for slices in layout.term_slices if slices.term.effect.name == _ROTOR_EFFECT}
    of_difference = any(isinstance(slices.term.effect, OneRecordingEffect) for slices in layout.term_slices)
    without_rotors = total.copy()
    for row, joint in enumerate(robot.joint_names):
        if joint in fitted or (robot.rotor_inertia[row] > 0.0 and not of_difference):
            continue
        column = []
        for log, operation in enumerate(layout.operations):
            postures = operation.q[:: max(len(operation.q) // _POSTURES, 1)]
            carried_inertia = float(np.mean(mass_matrix(robot, postures)[:, row, row]))
            torque = np.zeros_like(operation.a)
            torque[:, row] = _ROTOR_SHARE * carried_inertia * operation.a[:, row]
            column.append(in_band(layout, log, torque))
        # The column of the rotor, with a prior deviation of one, is eliminated.
        _, across, own = weighted_products(layout, model, tuple(column))
        without_rotors -= np.outer(across.sum(axis=0), across.sum(axis=0)) / (own.sum() + 1.0)
    identity = np.eye(layout.size)
    return solve(without_rotors, identity) - solve(total, identity)


def load_extent_shift(
    layout: ModelLayout, model: Linearised, x: Float[Array, " p"], slices: TermSlices, total: Float[Array, "p p"]
) -> Float[Array, " p"]:
    """Shift of all parameters if a load is not a point mass, but has an inertia about its own centre."""
    mass = float(x[slices.coefficients][0])
    columns = tuple(np.array(slices.term.columns)[_MOMENTS_OF_INERTIA].tolist())
    additional = tuple(
        mass * _RADIUS_OF_GYRATION**2 * columns_of(layout.problem, columns, log).sum(axis=2)
        for log in range(len(layout.operations))
    )
    return solve(total, weighted_products(layout, model, additional)[1].sum(axis=0))


def _gauss_newton(
    layout: ModelLayout,
    x: Float[Array, " p"],
    precision: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
) -> tuple[Array, Linearised, tuple[Array, Array, Array]]:
    """Parameters after Gauss-Newton steps within bounds, with the linearised model and its products at that point."""
    model = linearised(layout, x)
    products = weighted_products(layout, model)
    bodies = _bodies(layout)
    for _ in range(_STEPS):
        a, b, c = products
        total, gradient = a.sum(axis=0) + np.diag(precision), b.sum(axis=0) - precision * x
        step = bounded_solve(total, gradient, lower - x, upper - x)
        if not all(body.is_possible((x + step)[at]) for body, at in bodies):
            # Unobservable parameters would make the matrix singular.
            regular = total + np.diag(np.where(np.diag(total) < _LEAST_INFORMATION, 1.0, 0.0))
            best, _ = possible_minimum(regular, gradient + regular @ x, (lower, upper), x + step, bodies)
            step = best - x
        if 2 * gradient @ step - step @ total @ step < _LEAST_GAIN:
            break
        loss = c.sum() + precision @ x**2
        # A step that does not lower the loss is shortened once. If this does not help, the last point is the result.
        for shorter in (1.0, 0.3):
            candidate = x + shorter * step
            at_candidate = linearised(layout, candidate)
            new_products = weighted_products(layout, at_candidate)
            if new_products[2].sum() + precision @ candidate**2 < loss:
                x, model, products = candidate, at_candidate, new_products
                break
        else:
            break
    return x, model, products


def _bodies(layout: ModelLayout) -> list[tuple[Body, Int[Array, " 10"]]]:
    """Bodies whose inertial parameters are free, with the positions of their changes in the parameter vector."""
    terms = [slices.term for slices in layout.term_slices if slices.term.effect.inertial == "free"]
    where = {
        column: slices.coefficients.start + k
        for slices in layout.term_slices
        if slices.term.effect.inertial == "free"
        for k, column in enumerate(slices.term.columns)
    }
    return [(body, np.array([where[column] for column in body.columns])) for body in layout.problem.bodies_of(terms)]


def _model_covariance(
    layout: ModelLayout, model: Linearised, x: Float[Array, " p"], cov: Float[Array, "p p"], total: Float[Array, "p p"]
) -> Float[Array, "p p"]:
    """Covariance of all parameters from columns that depend on the uncertain model.

    A few models are drawn from the covariance of the tolerance parameters, and the columns are computed for each.
    """
    count = layout.problem.nuisance_count
    rng = random_stream("models within the tolerances")
    shifts = []
    for draw in rng.multivariate_normal(np.zeros(count), cov[:count, :count], _MODEL_DRAWS, method="eigh"):
        adjusted = layout.adjusted(x[:count] + draw)
        _, b, _ = weighted_products(layout, model, torque_change(layout, adjusted, x))
        shifts.append(solve(total, b.sum(axis=0)))
    return np.einsum("sp,sk->pk", np.array(shifts), np.array(shifts)) / _MODEL_DRAWS


def _priors_and_bounds(layout: ModelLayout, x: Float[Array, " p"]) -> tuple[Array, Array, Array]:
    """Prior precision and bounds of all parameters; a shape stays within a factor of two of its value in the search."""
    problem = layout.problem
    precision, lower, upper = np.zeros(layout.size), np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    nuisances = slice(0, problem.nuisance_count)
    for out, values in ((precision, problem.precision), (lower, problem.lower), (upper, problem.upper)):
        out[nuisances] = values[nuisances]
        for slices in layout.term_slices:
            out[slices.coefficients] = values[list(slices.term.columns[: slices.count])]
    for slices in layout.term_slices:
        if slices.term.effect.inertial == "point mass":
            # The mass keeps its sign (load or missing part), because the inertia has a pole at a mass of zero.
            at, least = slices.coefficients.start, slices.term.effect.lightest(problem.session.robot)
            lower[at], upper[at] = (0.0, np.inf) if x[at] >= 0 else (least, 0.0)
        ends = np.sort([0.5 * x[slices.shape], 2.0 * x[slices.shape]], axis=0)
        lower[slices.shape], upper[slices.shape] = ends
    return precision, lower, upper
