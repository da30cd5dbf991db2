"""Weighted least squares: every joint counts by its own noise, which the fits before estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from identification.data.log import Log
from identification.estimators.fit import Fit, fit_from
from identification.estimators.linear.least_squares import base_of, solve
from identification.estimators.linear.scatter import joint_noise, leverage
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.errors import IdentifiabilityError
from phantom_dyn.model.robot import Robot

Array = np.ndarray

# A joint of small torque takes what others have left over in a fit without weights, and keeps much of it in the first
# fit with weights: fits go on until no joint's noise moves by a tenth against the others'.
_CHANGE = 0.1
PASSES = 8
"""Most fits there are, the one without weights included."""


def fit_wls(robot: Robot, logs: Log | Sequence[Log], effects: Sequence[EffectOnJoint] = ()) -> Fit:
    """Base parameters of the rigid body and the effects, each joint weighted by its noise.

    Args:
        robot: Gives the rigid body.
        logs: One recording or several.
        effects: What acts on the joints beside the rigid body.

    Raises:
        IdentifiabilityError: If the recording excites no parameter, or leaves no equation to judge the noise by.
    """
    return wls(torque_regressor(robot, logs, effects))


def wls(regressor: Regressor) -> Fit:
    """`fit_wls` on equations that are made already (`gap_regressor` for the effects alone).

    Args:
        regressor: The equations.

    Raises:
        IdentifiabilityError: If the recording excites no parameter, or leaves no equation to judge the noise by.
    """
    base = base_of(regressor)
    noise = sigma = np.ones(regressor.robot.nv)
    solution = solve(regressor, base, np.ones_like(regressor.y))
    for again in reversed(range(PASSES)):
        sigma = joint_noise(solution.residual, leverage(solution, noise**-2))
        following = floored(sigma, regressor)
        if not again or settled(noise, following):
            break
        noise = following
        solution = solve(regressor, base, np.broadcast_to(1 / noise, regressor.y.shape))
    return fit_from(
        "wls",
        regressor,
        base,
        solution,
        sigma=sigma,
        information=noise**-2,
        scatter=sigma**2 / noise**4,
        score=solution.residual,
    )


def settled(before: Float[Array, " nv"], after: Float[Array, " nv"]) -> bool:
    """True if another fit with the noise ``after`` would weigh the joints as the one with ``before`` did.

    Args:
        before: Noise of each joint that a fit was weighted by.
        after: Noise that it has left.
    """
    ratio = after / before
    return bool(ratio.max() <= (1.0 + _CHANGE) * ratio.min())


def floored(sigma: Float[Array, " nv"], regressor: Regressor) -> Float[Array, " nv"]:
    """Noise to weigh joints by: ``sigma``, but at least 1e-9 of the largest torque of any joint.

    A joint without noise (a simulation, or one that is not driven) would else get infinite weight.

    Args:
        sigma: Estimated noise of each joint.
        regressor: Gives the torques.

    Raises:
        IdentifiabilityError: If a noise is not known.
    """
    if np.isnan(sigma).any():
        raise IdentifiabilityError(
            f"{regressor.count} samples leave no equation to judge the noise by: record more, or use ordinary least "
            "squares."
        )
    largest = float(np.abs(regressor.measured).max())
    return np.maximum(sigma, 1e-9 * largest if largest > 0 else 1.0)
