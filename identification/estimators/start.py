"""Where estimators that simulate closed loops begin: the recordings again, by the robot that least squares finds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.base_parameters import BaseParameters
from identification.estimators.closed_loop import Feedback, Loop
from identification.estimators.fit import Fit
from identification.estimators.least_squares import base_of
from identification.estimators.plant import model_parameters
from identification.estimators.resimulation import Resimulation, loops_of, resimulated
from identification.estimators.wls import floored, wls
from identification.regressor import Regressor
from phantom_dyn.errors import EstimationError

Array = np.ndarray


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
