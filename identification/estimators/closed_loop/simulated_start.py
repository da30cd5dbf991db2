"""Where estimators that simulate closed loops begin: the recordings again, by the robot that least squares finds.

Equations on simulated motion: what the instruments and the regressors of simulating estimators are made of.

Where estimators that simulate closed loops begin: the recordings again, by the robot that least squares finds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identification.estimators.closed_loop.loop import Feedback, Loop, feedback_of, loop_of, simulated_log
from identification.estimators.closed_loop.plant import all_parameters, model_parameters, plant_of, require_simulable
from identification.estimators.fit import Fit
from identification.estimators.linear.least_squares import base_of
from identification.estimators.linear.rows import base_rows
from identification.estimators.weighted_least_squares import floored, wls
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from phantom_dyn.errors import EstimationError

Array = np.ndarray


@dataclass(frozen=True)
class Resimulation:
    """Simulated motion of all recordings at one set of parameters.

    Attributes:
        full: Values of all columns.
        regressor: Equations on the simulated motion and the simulated torque.
    """

    full: Float[Array, " p"]
    regressor: Regressor

    def rows(self, base: BaseParameters) -> Float[Array, "N nv r"]:
        """Rows of the base parameters on the simulated motion."""
        return base_rows(self.regressor, base)


def loops_of(regressor: Regressor, feedback: Feedback | None) -> tuple[Loop, ...]:
    """The closed loops around the recordings of a regressor.

    Args:
        regressor: Gives robot and logs.
        feedback: The controllers; those that the robot states by default.

    Raises:
        ParameterError: If robot or effects cannot be simulated, or a controller is not stated.
        LogError: If a log has no references.
    """
    require_simulable(regressor)
    stated = feedback_of(regressor.robot) if feedback is None else feedback
    return tuple(loop_of(regressor.robot, log, stated) for log in regressor.logs)


def resimulated(
    regressor: Regressor, loops: tuple[Loop, ...], base: BaseParameters, theta: Float[Array, " r"]
) -> Resimulation:
    """The recordings again, by a robot with these base parameters.

    Args:
        regressor: Gives robot, terms and recordings.
        loops: See `loops_of`.
        base: The unknowns.
        theta: Their values.

    Raises:
        EstimationError: If the robot cannot move with these parameters.
    """
    plant = plant_of(regressor, base, theta)
    logs = tuple(simulated_log(loop, plant) for loop in loops)
    return Resimulation(all_parameters(regressor, base, theta), replace(regressor, logs=logs))


@dataclass(frozen=True)
class Start:
    """A first simulation of all recordings.

    Attributes:
        loops: Around the recordings.
        simulation: By a robot with the parameters that least squares finds, or as given where that one cannot move.
        base: Base parameters that the simulated motion excites, which no noise excites.
        theta: Their values in that robot.
        weights: One over the noise of each joint that least squares leaves.
    """

    loops: tuple[Loop, ...]
    simulation: Resimulation
    base: BaseParameters
    theta: Float[Array, " r"]
    weights: Float[Array, " nv"]


def start_of(regressor: Regressor, feedback: Feedback | None) -> Start:
    """The first simulation of the recordings of a regressor.

    Args:
        regressor: The equations.
        feedback: The controllers; those that the robot states by default.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter, or leaves no equation to judge the noise by.
        EstimationError: If neither the robot of least squares nor the given one can move.
    """
    loops = loops_of(regressor, feedback)
    first = wls(regressor)
    simulation = _simulated(regressor, loops, first)
    base = base_of(simulation.regressor)
    weights = 1.0 / floored(first.sigma, regressor)
    return Start(loops, simulation, base, base.values(simulation.full), weights)


def _simulated(regressor: Regressor, loops: tuple[Loop, ...], first: Fit) -> Resimulation:
    try:
        return resimulated(regressor, loops, first.base, first.theta)
    except EstimationError:
        return resimulated(regressor, loops, first.base, first.base.values(model_parameters(regressor)))
