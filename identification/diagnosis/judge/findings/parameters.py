"""Parameters of findings with their standard deviations, from the fit of the whole model."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.full_fit import FullFit
from identification.diagnosis.result import Value
from identification.excitation.closable import ordinary_postures, solved_numerically, with_start_between
from identification.notes import Code, Note
from identification.regression.base_parameters import BaseParameters, base_parameters_of_matrix
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.dynamics.moving_base import any_base_motion
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.random_streams import random_stream

# The recording does not determine a number whose standard deviation is more than this share of that of its prior.
_LARGEST_SHARE_OF_PRIOR_STD = 0.5
_SAMPLES = 200  # random postures; they give far more rows than an effect has base parameters


def finding_parameters(robot: Robot, term: Term, fitted: FullFit) -> dict[str, Value]:
    """Parameters of one finding by name, each with value, standard deviation and unit.

    Standard deviations come from the fit of all parameters, propagated through the law to first order. Those above half
    the standard deviation of the prior are infinite: the recordings hardly determine these numbers. Of inertial
    parameters only the base parameters are returned, because motion determines no others. If the parameters of an
    effect are lists, so are their values and standard deviations.

    Args:
        robot: The given model.
        term: The finding.
        fitted: Fit of the whole model.
    """
    effect, at = term.effect, fitted.slices_of(term).indices
    assert isinstance(effect, Effect)
    parameters, values, slope = _stated_law(robot, term, fitted)
    std = np.sqrt(np.maximum(np.diag(slope @ fitted.cov[np.ix_(at, at)] @ slope.T), 0.0))
    of_prior = np.linalg.norm(slope * np.sqrt(fitted.prior[at]), axis=1)
    std = np.where(std > _LARGEST_SHARE_OF_PRIOR_STD * of_prior, np.inf, std)
    return _values_by_name(parameters, values, std, lists=effect.takes_lists(robot, term.joint))


def finding_loadings(robot: Robot, term: Term, fitted: FullFit) -> tuple[tuple[float, ...], ...]:
    """Rows of one finding's parameters in a square root of the covariance of all findings' parameters.

    There is one row for each parameter (each entry of a list), in the order of `finding_parameters`. The covariance of
    any two parameters, also of different findings, is the inner product of their rows.

    Args:
        robot: The given model.
        term: The finding.
        fitted: Fit of the whole model.
    """
    squares, axes = np.linalg.eigh(0.5 * (fitted.cov + fitted.cov.T))
    # The symmetric root is unique; other roots depend on the rounding of the matrix.
    root = (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T
    _, _, slope = _stated_law(robot, term, fitted)
    return tuple(tuple(row) for row in (slope @ root[fitted.slices_of(term).indices]).tolist())


def _stated_law(
    robot: Robot, term: Term, fitted: FullFit
) -> tuple[tuple[Parameter, ...], Float[Array, " p"], Float[Array, "p k"]]:
    """Parameters as the report states them, their values, and their derivatives by the fitted parameters."""
    effect, slices = term.effect, fitted.slices_of(term)
    at, count = slices.indices, slices.count
    assert isinstance(effect, Effect)
    x, cov = fitted.x[at], fitted.cov[np.ix_(at, at)]
    if effect.inertial == "free":
        parameters, mix = base_parameters(robot, term)
        return parameters, mix @ x, mix
    std = np.sqrt(np.maximum(np.diag(cov)[:count], 0.0))
    parameters, law = effect.stated_law(robot, term.joint, term.shape, std, x[:count])
    values = law(x)
    slope = np.empty((len(values), len(x)))
    for k in range(len(x)):
        # Every law is nearly linear over a hundredth of a standard deviation.
        step = 0.01 * np.sqrt(max(cov[k, k], 1e-30))
        shifted = x.copy()
        shifted[k] += step
        slope[:, k] = (law(shifted) - values) / step
    return parameters, values, slope


def _values_by_name(
    parameters: tuple[Parameter, ...], values: Float[Array, " p"], std: Float[Array, " p"], *, lists: bool
) -> dict[str, Value]:
    """Value of each parameter by name; if ``lists``, each parameter has an equal number of consecutive values."""
    if not lists:
        return {p.name: Value(float(v), float(s), p.unit) for p, v, s in zip(parameters, values, std, strict=True)}
    each = len(values) // len(parameters)
    return {
        p.name: Value(values[k * each : (k + 1) * each].tolist(), std[k * each : (k + 1) * each].tolist(), p.unit)
        for k, p in enumerate(parameters)
    }


def base_parameters(robot: Robot, term: Term) -> tuple[tuple[Parameter, ...], Float[Array, "r k"]]:
    """Base parameters of bodies with free inertial parameters, and the matrix that maps all parameters to them.

    Args:
        robot: The given model.
        term: A finding of free inertial parameters.
    """
    base, parameters = _base_of_bodies(robot, term)
    mix = np.zeros((base.rank, len(parameters)))
    mix[np.arange(base.rank), list(base.independent)] = 1.0
    mix[:, list(base.dependent)] = base.grouping
    return tuple(parameters[k] for k in base.independent), mix


def sum_notes(robot: Robot, term: Term) -> tuple[Note, ...]:
    """A note on the sums that base parameters stand for; none if each is a parameter of its own.

    Args:
        robot: The given model.
        term: A finding of free inertial parameters.
    """
    base = _base_of_bodies(robot, term)[0]
    sums = {base.names[base.independent[row]]: whole for row, whole in base.sums().items()}
    return (Note(Code.SUMS, term.joint, {"sums": sums}),) if sums else ()


def _base_of_bodies(robot: Robot, term: Term) -> tuple[BaseParameters, tuple[Parameter, ...]]:
    """Base parameters of bodies with free inertial parameters, by a regressor at random motions; all parameters."""
    effect = term.effect
    assert isinstance(effect, Effect)
    parameters = effect.parameters(robot, term.joint)
    columns = list(effect.regressor_columns(robot, term.joint))
    w = _random_regressor(robot)[:, :, columns].reshape(-1, len(columns))
    return base_parameters_of_matrix(w, [p.name for p in parameters], [p.unit for p in parameters]), parameters


def _random_regressor(robot: Robot) -> Float[Array, "N nv p"]:
    """Regressor at independent random samples; for a linkage, in postures that its loops allow."""
    rng = random_stream("draws of parameters")
    q, v, a = (rng.uniform(-3, 3, (_SAMPLES, robot.nv)) for _ in range(3))
    if not solved_numerically(robot):
        base = any_base_motion(rng, _SAMPLES) if robot.floating else None
        return rigid_body_regressor(robot, Motion(np.arange(float(_SAMPLES)), q, v, a, base=base))
    # Every other posture is a start from which the loops can be closed at the next posture; starts are left out below.
    q = with_start_between(robot, ordinary_postures(robot, _SAMPLES))
    v, a = (np.repeat(part, 2, axis=0)[: len(q)] for part in (v, a))
    return rigid_body_regressor(robot, Motion(np.arange(float(len(q))), q, v, a))[1::2]
