"""Ordinary least squares: every row counts the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.data.log import Log
from identification.estimators.fit import Fit, fit_from
from identification.estimators.linear.least_squares import base_of, solve
from identification.estimators.linear.scatter import joint_noise, leverage
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.model.robot import Robot


def fit_ols(robot: Robot, logs: Log | Sequence[Log], effects: Sequence[EffectOnJoint] = ()) -> Fit:
    """Base parameters of the rigid body and the effects by ordinary least squares.

    Args:
        robot: Gives the rigid body.
        logs: One recording or several.
        effects: What acts on the joints beside the rigid body.

    Raises:
        IdentifiabilityError: If the recording excites no parameter.
    """
    return ols(torque_regressor(robot, logs, effects))


def ols(regressor: Regressor) -> Fit:
    """`fit_ols` on equations that are made already (`gap_regressor` for the effects alone).

    Args:
        regressor: The equations.

    Raises:
        IdentifiabilityError: If the recording excites no parameter.
    """
    base = base_of(regressor)
    solution = solve(regressor, base, np.ones_like(regressor.y))
    information = np.ones(regressor.robot.nv)
    sigma = joint_noise(solution.residual, leverage(solution, information))
    return fit_from(
        "ols",
        regressor,
        base,
        solution,
        sigma=sigma,
        information=information,
        scatter=sigma**2,
        score=solution.residual,
    )
