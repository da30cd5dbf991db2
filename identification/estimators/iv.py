r"""Instrumental variables (IDIM-IV): least squares that noise in the motion does not bias.

Noise of the positions enters torque and regressor alike as soon as a controller closes the loop, and least squares
takes it for a property of the robot. Instruments :math:`Z`, the regressor of a simulated closed loop, have no noise:
:math:`Z^T S^{-1} (y - W \theta) = 0`.

References:
    A. Janot, P.-O. Vandanjon, M. Gautier, A generic instrumental variable approach for industrial robot
    identification, IEEE Transactions on Control Systems Technology 22(1), 2014.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from identification.data.log import Log
from identification.estimators.closed_loop.loop import Feedback
from identification.estimators.closed_loop.simulated_start import resimulated, start_of
from identification.estimators.fit import Fit, Status
from identification.estimators.judged_values import Judged, judged
from identification.estimators.linear.rows import base_rows, factor_of, influence_of
from identification.estimators.wls import floored
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.errors import EstimationError, IdentifiabilityError
from phantom_dyn.model.robot import Robot

Array = np.ndarray

_SETTLED = 0.05  # standard deviations: where no estimate moves by more, another simulation changes nothing
_TIED = 1e-9  # instruments that follow the regressor by less than this share are none


def fit_iv(
    robot: Robot,
    logs: Log | Sequence[Log],
    effects: Sequence[EffectOnJoint] = (),
    *,
    feedback: Feedback | None = None,
    iterations: int = 20,
    on_failure: Literal["raise", "return"] = "raise",
) -> Fit:
    """Base parameters of the rigid body and the effects by instrumental variables.

    Args:
        robot: Gives the rigid body and, in its actuators, the controllers.
        logs: One recording or several, with references.
        effects: What acts on the joints beside the rigid body.
        feedback: The controllers, where the robot does not state them.
        iterations: Most simulations of the recordings there may be.
        on_failure: What to do where the estimates do not settle.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the simulated robot cannot move, or the estimates do not settle and ``on_failure`` is
            ``raise``.
    """
    return iv(torque_regressor(robot, logs, effects), feedback=feedback, iterations=iterations, on_failure=on_failure)


def iv(
    regressor: Regressor,
    *,
    feedback: Feedback | None = None,
    iterations: int = 20,
    on_failure: Literal["raise", "return"] = "raise",
) -> Fit:
    """`fit_iv` on equations that are made already (`gap_regressor` for the effects alone).

    Args:
        regressor: The equations.
        feedback: See `fit_iv`.
        iterations: See `fit_iv`.
        on_failure: See `fit_iv`.

    Raises:
        LogError: See `fit_iv`.
        ParameterError: See `fit_iv`.
        IdentifiabilityError: See `fit_iv`.
        EstimationError: See `fit_iv`.
    """
    start = start_of(regressor, feedback)
    base = start.base
    found = with_instruments(regressor, base, start.simulation.rows(base), start.weights)
    for _ in range(iterations):
        before = found
        simulation = resimulated(regressor, start.loops, base, found.theta)
        found = with_instruments(regressor, base, simulation.rows(base), 1.0 / floored(before.sigma, regressor))
        # Where there is no noise, what rounding leaves of the torque settles it.
        still = np.abs(found.theta - before.theta) <= _SETTLED * found.std + 1e-9 * np.abs(found.theta)
        if still.all():
            return found.fit("iv", regressor, base, Status.SOLVED)
    if on_failure == "raise":
        raise EstimationError(f"{Status.NOT_SETTLED.value} ({iterations} simulations)")
    return found.fit("iv", regressor, base, Status.NOT_SETTLED)


def with_instruments(
    regressor: Regressor, base: BaseParameters, instruments: Float[Array, "N nv r"], weights: Float[Array, " nv"]
) -> Judged:
    """Solution of the equations of a regressor with given instruments.

    Args:
        regressor: The equations.
        base: The unknowns.
        instruments: Rows without noise.
        weights: One over the noise of each joint.

    Raises:
        IdentifiabilityError: If the instruments do not follow the regressor.
    """
    rows = base_rows(regressor, base)
    factor = factor_of(instruments, weights)
    influence = influence_of(instruments, factor, weights)
    link = np.einsum("njk,njl->kl", influence, rows, optimize=True)
    # The identity where instruments and regressor are the same.
    if np.linalg.svd(factor @ np.linalg.solve(factor.T, link.T).T, compute_uv=False)[-1] < _TIED:
        raise IdentifiabilityError(
            "The simulated motion does not follow the recorded one, so that it says nothing about it: check references "
            "and controllers."
        )
    influence = influence @ np.linalg.inv(link).T
    theta = np.einsum("njk,nj->k", influence, regressor.y, optimize=True)
    return judged(theta, rows, regressor.y, influence, factor, regressor.starts)
