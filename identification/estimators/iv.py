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
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from identification.base_parameters import BaseParameters
from identification.estimators.closed_loop import Feedback
from identification.estimators.fit import Fit, Status, fit_of
from identification.estimators.noise import joint_noise
from identification.estimators.resimulation import first_resimulation, loops_of, resimulated, simulated_base
from identification.estimators.rows import base_rows, covariances, factor_of, influence_of, least_squares
from identification.estimators.wls import PASSES, floored, settled
from identification.log import Log
from identification.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.errors import EstimationError, IdentifiabilityError
from phantom_dyn.robot import Robot

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
    loops = loops_of(regressor, feedback)
    first, theta, weights = starting_point(regressor)
    simulation = first_resimulation(regressor, loops, first, theta)
    base, _ = simulated_base(simulation)
    found = with_instruments(regressor, base, simulation.rows(base), weights)
    for _ in range(iterations):
        before = found
        simulation = resimulated(regressor, loops, base, found.theta)
        found = with_instruments(regressor, base, simulation.rows(base), 1.0 / floored(before.sigma, regressor))
        # Where there is no noise, what rounding leaves of the torque settles it.
        still = np.abs(found.theta - before.theta) <= _SETTLED * found.std + 1e-9 * np.abs(found.theta)
        if still.all():
            return found.fit(regressor, base, Status.SOLVED)
    if on_failure == "raise":
        raise EstimationError(f"{Status.NOT_SETTLED.value} ({iterations} simulations)")
    return found.fit(regressor, base, Status.NOT_SETTLED)


@dataclass(frozen=True)
class Instrumented:
    """Solution of equations with instruments.

    Attributes:
        theta: Base parameters, shape ``(r,)``.
        cov: Covariance with the memory of the residual.
        cov_white: Covariance if every sample's noise were independent.
        sigma: Noise of each joint.
        correlation: Samples per independent sample of each joint's residual.
        residual: Torque that is left.
        influence: By how much the noise of each joint at each sample moves each estimate.
        factor: Triangular factor of the weighted instruments.
    """

    theta: Float[Array, " r"]
    cov: Float[Array, "r r"]
    cov_white: Float[Array, "r r"]
    sigma: Float[Array, " nv"]
    correlation: Float[Array, " nv"]
    residual: Float[Array, "N nv"]
    influence: Float[Array, "N nv r"]
    factor: Float[Array, "r r"]

    @property
    def std(self) -> Float[Array, " r"]:
        """Standard deviations; zero where they are not known."""
        return np.sqrt(np.nan_to_num(np.diag(self.cov)))

    def fit(self, regressor: Regressor, base: BaseParameters, status: Status) -> Fit:
        """As the common result."""
        return fit_of(
            "iv",
            regressor,
            base,
            self.theta,
            cov=self.cov,
            cov_white=self.cov_white,
            sigma=self.sigma,
            correlation=self.correlation,
            residual=self.residual,
            factor=self.factor,
            status=status,
        )


def with_instruments(
    regressor: Regressor, base: BaseParameters, instruments: Float[Array, "N nv r"], weights: Float[Array, " nv"]
) -> Instrumented:
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
    residual = regressor.y - rows @ theta
    used = np.einsum("njk,njk->j", influence, rows, optimize=True)
    sigma = joint_noise(residual, used)
    cov, white, correlation = covariances(influence, residual, sigma, regressor.starts)
    return Instrumented(theta, cov, white, sigma, correlation, residual, influence, factor)


def starting_point(regressor: Regressor) -> tuple[BaseParameters, Float[Array, " r"], Float[Array, " nv"]]:
    """Base parameters of the recording, their values and the weights of joints by weighted least squares.

    Args:
        regressor: The equations.

    Raises:
        IdentifiabilityError: If the recording excites no parameter, or leaves no equation to judge the noise by.
    """
    from identification.estimators.least_squares import base_of

    base = base_of(regressor)
    rows = base_rows(regressor, base)
    noise = np.ones(regressor.robot.nv)
    theta = np.zeros(base.rank)
    for _ in range(PASSES):
        before = noise
        theta, factor = least_squares(rows, regressor.y, 1.0 / before)
        used = np.einsum("njk,njk->j", influence_of(rows, factor, 1.0 / before), rows, optimize=True)
        noise = floored(joint_noise(regressor.y - rows @ theta, used), regressor)
        if settled(before, noise):
            break
    return base, theta, 1.0 / noise
