r"""Direct and inverse dynamic identification (DIDIM): fits the torque of a simulated closed loop to the measured one.

Only references and torques are used; positions come from the simulation. The simulated motion depends little on the
parameters, because the controllers keep it near the reference. Therefore the derivative of the simulated torque is
nearly the regressor on the simulated motion, and a few linear fits converge. A recording is refused if its torque is
not that of the stated controllers.

References:
    M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method for parameter identification of robot
    dynamics, IEEE Transactions on Control Systems Technology 21(2), 2013.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.data.signals import align_held_torque
from identification.estimators.closed_loop.loop import (
    MOST_SIMULATIONS,
    Feedback,
    Loop,
    Resimulation,
    not_settled,
    resimulated,
    start_of,
)
from identification.estimators.fit import Fit, fit_of, values_of_influence
from identification.estimators.linear.least_squares import factor_of, influence_of, least_squares
from identification.estimators.linear.scatter import residual_noise
from identification.estimators.weighted_least_squares import floored
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import EstimationError, LogError

_SETTLED = 0.05  # largest step of a converged estimate, in its standard deviations
_HALVINGS = 6  # largest number of halvings of a step with which the simulation diverges
# A recording is refused if the relative difference between recorded and commanded torque is larger. Velocity noise and
# held samples cause smaller differences.
_LARGEST_MISFIT = 0.5
# The message states fitted gains if the relative difference with these gains is smaller.
_FITTED_GAINS = 0.2


def didim(regressor: Regressor, *, feedback: Feedback | None = None) -> Fit:
    """Base parameters from references and torques, by simulations of the closed loop.

    Args:
        regressor: The equations.
        feedback: The controllers; by default those of ``robot.yaml``.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the simulation diverges, or the estimates do not converge.
    """
    start = start_of(regressor, feedback)
    require_own_controllers(start.loops)
    base, theta, simulation, weights = start.base, start.theta, start.simulation, start.weights
    for _ in range(MOST_SIMULATIONS):
        rows, target = simulation.rows(base), _target(regressor, simulation)
        found, factor = least_squares(rows, target, weights)
        influence = influence_of(rows, factor, weights)
        weights = 1.0 / floored(residual_noise(rows, influence, target - rows @ found), regressor)
        std = np.sqrt(np.einsum("njk,j->k", influence**2, weights**-2))
        step = found - theta
        theta, simulation = _damped_step(regressor, start.loops, base, theta, step)
        if (np.abs(step) <= _SETTLED * std + 1e-9 * np.abs(theta)).all():
            return _fit(regressor, base, theta, simulation, weights)
    raise not_settled()


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
    """The estimates after a step, and the simulation with them; the step is halved while the simulation diverges."""
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
    """The fit with converged estimates, from the simulation with these."""
    rows = simulation.rows(base)
    factor = factor_of(rows, weights)
    target, influence = _target(regressor, simulation), influence_of(rows, factor, weights)
    values = values_of_influence(theta, rows, target, influence, factor, regressor.starts)
    return fit_of("didim", regressor, base, values)


def require_own_controllers(loops: Iterable[Loop]) -> None:
    """Raise an error for a recording whose torque differs much from the torque that the stated controllers command.

    Args:
        loops: Recordings with their controllers and references.

    Raises:
        LogError: The message names the joint and the difference. If some gains reproduce the torque, it names them.
    """
    for loop in loops:
        log, feedback = loop.log, loop.feedback
        if log.q_ref is None:
            continue
        error, v = log.q_ref - log.motion.q, log.motion.v
        commanded = _torque_in_band(
            loop, np.clip(feedback.kp * error - feedback.kd * v, -feedback.limit, feedback.limit)
        )
        parts = np.stack([_torque_in_band(loop, error), _torque_in_band(loop, -v)], axis=2)
        recorded = Regressor.in_band(log, log.tau)
        for j, joint in enumerate(log.joint_names):
            tau = recorded[:, j]
            share = _relative_rms(tau - commanded[:, j], tau)
            if feedback.kp[j] == 0.0 or share <= _LARGEST_MISFIT:
                continue
            gains = np.linalg.lstsq(parts[:, j], tau, rcond=None)[0]
            hint = ""
            if _relative_rms(tau - parts[:, j] @ gains, tau) < _FITTED_GAINS:
                if np.all(gains > 0.0):
                    hint = f"; kp = {gains[0]:.3g} and kd = {gains[1]:.3g} would give it"
                elif np.all(gains < 0.0):
                    entry = f"tau.{joint}: {{from: tau.{joint}, sign: -1}}"
                    hint = f"; the other sign is nearer: write {entry} into a column map"
            raise LogError(
                f"{log.file}: the stated controller of {joint} (kp {feedback.kp[j]:.3g}, kd {feedback.kd[j]:.3g}) asks "
                f"for another torque than was recorded, {100 * share:.0f} % of it apart{hint}: state the controller "
                "that moved the robot, or use an estimator without simulation, such as wls."
            )


def _torque_in_band(loop: Loop, commanded: Float[Array, "N nv"]) -> Float[Array, "n nv"]:
    """Torque that the controllers command, with the delay and hold of the loop, in the band."""
    t, late = loop.log.motion.t, loop.feedback.delay
    if late:
        commanded = np.stack([np.interp(t - late, t, column) for column in commanded.T], axis=1)
    return Regressor.in_band(loop.log, align_held_torque(commanded) if loop.align else commanded)


def _relative_rms(part: Float[Array, " n"], whole: Float[Array, " n"]) -> float:
    """Root mean square of a part divided by that of the whole; zero if the whole is zero."""
    size = float(np.sqrt(np.mean(whole**2)))
    return float(np.sqrt(np.mean(part**2))) / size if size > 0.0 else 0.0
