"""Equations on simulated motion: what the instruments and the regressors of simulating estimators are made of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identification.base_parameters import BaseParameters
from identification.estimators.closed_loop import Feedback, Loop, feedback_of, loop_of, simulated_log
from identification.estimators.plant import all_parameters, plant_of, require_simulable
from identification.estimators.rows import base_rows
from identification.regressor import Regressor

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
