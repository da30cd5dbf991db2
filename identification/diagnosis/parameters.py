"""From the coefficients of a fit to the parameters of the contract, with their deviations."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.base_parameters import base_parameters_of_matrix
from identification.diagnosis.columns import Term
from identification.diagnosis.fitting import Fitted
from identification.diagnosis.result import Value
from phantom_dyn.dynamics import rigid_body_regressor
from phantom_dyn.effects.inertial_parameters import InertialParameters
from phantom_dyn.effects.payload import Payload
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


def finding_parameters(robot: Robot, term: Term, found: Fitted) -> dict[str, Value]:
    """Parameters of one finding by name, each with value, standard deviation and unit.

    Deviations are those of the fit carried through the law to first order; they count the tolerances of the model and
    the colour of the noise. Of inertial parameters only a set that any motion can tell apart is given, with what the
    others add to it.
    """
    coefficients = found.theta[list(term.columns)]
    at = np.searchsorted(found.active, term.columns)
    cov = found.cov[np.ix_(at, at)]
    if isinstance(term.effect, InertialParameters):
        return _inertial(robot, term, coefficients, cov)
    if isinstance(term.effect, Payload):
        coefficients, cov = coefficients[:4], cov[:4, :4]
    values = term.effect.from_coefficients(robot, term.joint, coefficients, term.shape)
    slope = np.empty((len(values), len(coefficients)))
    for k in range(len(coefficients)):
        # A step of a hundredth of a deviation keeps the difference inside the linear range of every law.
        step = 0.01 * np.sqrt(max(cov[k, k], 1e-30))
        moved = coefficients.copy()
        moved[k] += step
        slope[:, k] = (term.effect.from_coefficients(robot, term.joint, moved, term.shape) - values) / step
    std = np.sqrt(np.maximum(np.diag(slope @ cov @ slope.T), 0.0))
    if not np.isnan(term.shape):
        # The shape is one of a grid: its neighbours are a fifth of a decade away, spread evenly in between.
        std[-1] = max(std[-1], 0.3 * term.shape)
    return {
        parameter.name: Value(float(value), float(deviation), parameter.unit)
        for parameter, value, deviation in zip(term.effect.parameters(robot, term.joint), values, std, strict=True)
    }


def _inertial(robot: Robot, term: Term, coefficients: Float[Array, " k"], cov: Float[Array, "k k"]) -> dict[str, Value]:
    """Base parameters among the free ones: independent columns of the regressor over random motions."""
    parameters = term.effect.parameters(robot, term.joint)
    rng = np.random.default_rng(20260104)
    motion = Motion(np.arange(200.0), *(rng.uniform(-3, 3, (200, robot.nv)) for _ in range(3)))
    effect = term.effect
    assert isinstance(effect, InertialParameters)
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
