"""From the coefficients of a fit to the parameters of the contract, with their deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.base_parameters import base_parameters_of_matrix
from identification.diagnosis.fitting import Fitted
from identification.diagnosis.result import Value
from identification.diagnosis.terms import Term
from phantom_dyn.dynamics import rigid_body_regressor
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.effects.inertial_parameters import InertialParameters
from phantom_dyn.effects.payload import Payload
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


@dataclass(frozen=True)
class Neighbour:
    """The same effect with another shape, and how well the whole model fits with it.

    Attributes:
        shape: Of the neighbour.
        objective: Loss in sample, in squared standard deviations.
        coefficients: Of the effect in that fit.
    """

    shape: float
    objective: float
    coefficients: Float[Array, " k"]


def finding_parameters(
    robot: Robot, term: Term, found: Fitted, neighbours: tuple[Neighbour, ...] = ()
) -> dict[str, Value]:
    """Parameters of one finding by name, each with value, standard deviation and unit.

    Deviations are those of the fit carried through the law to first order; they count the tolerances of the model and
    the colour of the noise. Of inertial parameters only a set that any motion can tell apart is given, with what the
    others add to it.

    Args:
        robot: The given model.
        term: The finding.
        found: Fit of the whole model.
        neighbours: Fits with other shapes of the same effect, which tell how well the shape is known.
    """
    effect = term.effect
    assert isinstance(effect, Effect)
    coefficients = found.theta[list(term.columns)]
    at = np.searchsorted(found.active, term.columns)
    cov = found.cov[np.ix_(at, at)]
    if isinstance(effect, InertialParameters):
        return _inertial(robot, term, coefficients, cov)
    if isinstance(effect, Payload):
        coefficients, cov = coefficients[:4], cov[:4, :4]
    shape, spread, drift = term.shape, 0.0, np.zeros(len(coefficients))
    if len(shape) == 1 and not effect.shape_is_estimate:
        best, spread, drift = _shape(shape[0], found.objective, coefficients, neighbours)
        coefficients = coefficients + drift * (best - shape[0])
        shape = (best,)
    cov = cov + np.outer(drift, drift) * spread**2
    values = effect.from_coefficients(robot, term.joint, coefficients, shape)
    slope = np.empty((len(values), len(coefficients)))
    for k in range(len(coefficients)):
        # A step of a hundredth of a deviation keeps the difference inside the linear range of every law.
        step = 0.01 * np.sqrt(max(cov[k, k], 1e-30))
        moved = coefficients.copy()
        moved[k] += step
        slope[:, k] = (effect.from_coefficients(robot, term.joint, moved, shape) - values) / step
    std = np.sqrt(np.maximum(np.diag(slope @ cov @ slope.T), 0.0))
    if spread > 0:
        step = 0.01 * spread
        moved = effect.from_coefficients(robot, term.joint, coefficients, (shape[0] + step,))
        std = np.hypot(std, np.abs(moved - values) / 0.01)
    return _named(effect.parameters(robot, term.joint), values, std)


def _named(parameters: tuple[Parameter, ...], values: Float[Array, " p"], std: Float[Array, " p"]) -> dict[str, Value]:
    """Values by name; where there are several of each parameter, one after the other, each is a list."""
    each = len(values) // len(parameters)
    if each <= 1:
        return {p.name: Value(float(v), float(s), p.unit) for p, v, s in zip(parameters, values, std, strict=True)}
    return {
        p.name: Value(values[k * each : (k + 1) * each].tolist(), std[k * each : (k + 1) * each].tolist(), p.unit)
        for k, p in enumerate(parameters)
    }


def _shape(
    shape: float, objective: float, coefficients: Float[Array, " k"], neighbours: tuple[Neighbour, ...]
) -> tuple[float, float, Float[Array, " k"]]:
    """Best shape, its deviation and how the coefficients follow it, from a parabola through its neighbours' losses."""
    below = max((n for n in neighbours if n.shape < shape), key=lambda n: n.shape, default=None)
    above = min((n for n in neighbours if n.shape > shape), key=lambda n: n.shape, default=None)
    if below is None or above is None:
        # At the end of the grid nothing is known of the other side.
        return shape, 0.5 * abs(shape), np.zeros(len(coefficients))
    h, k = shape - below.shape, above.shape - shape
    left, right = (objective - below.objective) / h, (above.objective - objective) / k
    curvature = 2 * (right - left) / (h + k)
    drift = (above.coefficients - below.coefficients) / (h + k)
    if curvature <= 0:
        return shape, max(h, k), drift
    slope = (left * k + right * h) / (h + k)
    best = float(np.clip(shape - slope / curvature, below.shape, above.shape))
    return best, float(min(np.sqrt(2.0 / curvature), abs(shape))), drift


def _inertial(robot: Robot, term: Term, coefficients: Float[Array, " k"], cov: Float[Array, "k k"]) -> dict[str, Value]:
    """Base parameters among the free ones: independent columns of the regressor over random motions."""
    rng = np.random.default_rng(20260104)
    motion = Motion(np.arange(200.0), *(rng.uniform(-3, 3, (200, robot.nv)) for _ in range(3)))
    effect = term.effect
    assert isinstance(effect, InertialParameters)
    parameters = effect.parameters(robot, term.joint)
    columns = list(effect.columns_of(robot, term.joint))
    w = rigid_body_regressor(robot, motion)[:, :, columns].reshape(-1, len(columns))
    base = base_parameters_of_matrix(w, [p.name for p in parameters], [p.unit for p in parameters])
    mix = np.zeros((base.rank, len(columns)))
    mix[np.arange(base.rank), list(base.independent)] = 1.0
    mix[:, list(base.dependent)] = base.grouping
    values = mix @ coefficients
    std = np.sqrt(np.maximum(np.diag(mix @ cov @ mix.T), 0.0))
    return {
        parameters[k].name: Value(float(value), float(deviation), parameters[k].unit)
        for k, value, deviation in zip(base.independent, values, std, strict=True)
    }
