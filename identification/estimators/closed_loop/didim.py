r"""Direct and inverse identification (DIDIM): the torque of a simulated closed loop is fitted to the measured one.

Positions enter through the simulation alone, so that only references and torques are needed. The torque of the
simulated loop depends on the parameters through the simulated motion, too, but little, as the controllers hold the
motion: its slope is the regressor on the simulated motion, and a few linear fits settle.

References:
    M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method for parameter identification of robot
    dynamics, IEEE Transactions on Control Systems Technology 21(2), 2013.
"""

from __future__ import annotations

import numpy as np

from identification.estimators.closed_loop.loop import Feedback, Loop, Resimulation, not_settled, resimulated, start_of
from identification.estimators.closed_loop.stated_controllers import require_own_controllers
from identification.estimators.fit import Fit, fit_of, values_of_influence
from identification.estimators.linear.least_squares import factor_of, influence_of, least_squares
from identification.estimators.linear.scatter import residual_noise
from identification.estimators.weighted_least_squares import floored
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import EstimationError

_SETTLED = 0.05  # standard deviations, see `identification.estimators.iv`
_HALVINGS = 6  # of a step after which the robot cannot move


def didim(regressor: Regressor, *, feedback: Feedback | None = None, iterations: int = 20) -> Fit:
    """Base parameters from references and torques.

    Args:
        regressor: The equations.
        feedback: The controllers, where the robot does not state them.
        iterations: Most simulations of the recordings there may be.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the simulated robot cannot move, or the estimates do not settle.
    """
    start = start_of(regressor, feedback)
    require_own_controllers(start.loops)
    base, theta, simulation, weights = start.base, start.theta, start.simulation, start.weights
    for _ in range(iterations):
        rows, target = simulation.rows(base), _target(regressor, simulation)
        found, factor = least_squares(rows, target, weights)
        influence = influence_of(rows, factor, weights)
        weights = 1.0 / floored(residual_noise(rows, influence, target - rows @ found), regressor)
        std = np.sqrt(np.einsum("njk,j->k", influence**2, weights**-2))
        step = found - theta
        theta, simulation = _damped_step(regressor, start.loops, base, theta, step)
        if (np.abs(step) <= _SETTLED * std + 1e-9 * np.abs(theta)).all():
            return _fit(regressor, base, theta, simulation, weights)
    raise not_settled(iterations)


def _target(regressor: Regressor, simulation: Resimulation) -> Float[Array, "N nv"]:
    """Measured torque minus the torque of the simulated motion that does not depend on the unknowns."""
    return regressor.measured - (simulation.regressor.measured - simulation.regressor.y)


def _damped_step(
    regressor: Regressor,
    loops: tuple[Loop, ...],
    base: BaseParameters,
    theta: Float[Array, " r"],
    step: Float[Array, " r"],
) -> tuple[Float[Array, " r"], Resimulation]:
    """The estimates after a step, or as much of it as leaves a robot that can move, and their simulation."""
    for _ in range(_HALVINGS):
        try:
            return theta + step, resimulated(regressor, loops, base, theta + step)
        except EstimationError:
            step = 0.5 * step
    return theta + step, resimulated(regressor, loops, base, theta + step)


def _fit(
    regressor: Regressor,
    base: BaseParameters,
    theta: Float[Array, " r"],
    simulation: Resimulation,
    weights: Float[Array, " nv"],
) -> Fit:
    rows = simulation.rows(base)
    factor = factor_of(rows, weights)
    target, influence = _target(regressor, simulation), influence_of(rows, factor, weights)
    values = values_of_influence(theta, rows, target, influence, factor, regressor.starts)
    return fit_of("didim", regressor, base, values)
