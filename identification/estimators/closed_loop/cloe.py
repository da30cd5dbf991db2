"""Closed-loop output error (CLOE): the simulated loop's torques and positions are fitted to the recorded ones.

No derivative of a position and no regressor on recorded motion: Gauss and Newton's method on the simulation itself,
with the states at the start of every stretch of a few seconds as unknowns (multiple shooting), so that what the model
lacks in one stretch does not spoil the next. A controller soon forgets the state at a start, often before the band has
its first sample: the recorded states count, loosely, as measurements, see `Shooting.state_trust`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from identification.data.log import Log
from identification.estimators.closed_loop.loop import Feedback
from identification.estimators.closed_loop.shooting import Shooting, stretches_of
from identification.estimators.closed_loop.simulated_start import start_of
from identification.estimators.fit import Estimate, Fit, Status, fit_of
from identification.estimators.linear.scatter import autocorrelation, correlation_factor
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.errors import EstimationError, IdentifiabilityError, ParameterError
from phantom_dyn.model.robot import Robot

Array = np.ndarray

_SETTLED = 0.05  # standard deviations, see `identification.estimators.iv`
_HALVINGS = 8  # of a step that does not lower the error
# Where a step lowers the error by less than this share, and slopes promise hardly more, what is left is the roughness
# that dry friction gives the simulation; where slopes promise much and no step keeps it, the fit has failed.
_FLAT, _PROMISED = 1e-3, 0.1
# Share of a channel below which its error is that of the integration, which dry friction makes rough, and not noise:
# no encoder is as good.
_EXACT = 1e-5
_LEAST = 1e-9  # a column that adds less than this share of its norm to those before it is not determined


def fit_cloe(
    robot: Robot,
    logs: Log | Sequence[Log],
    effects: Sequence[EffectOnJoint] = (),
    *,
    feedback: Feedback | None = None,
    stretch: float = 5.0,
    iterations: int = 20,
    on_failure: Literal["raise", "return"] = "raise",
) -> Fit:
    """Base parameters of the rigid body and the effects by closed-loop output error.

    Args:
        robot: Gives the rigid body and, in its actuators, the controllers.
        logs: One recording or several, with references.
        effects: What acts on the joints beside the rigid body.
        feedback: The controllers, where the robot does not state them.
        stretch: Length of the stretches that start from states of their own [s].
        iterations: Most steps there may be.
        on_failure: What to do where the estimates do not settle.

    Returns:
        The fit; ``others`` holds the states at the start of each recording.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the simulated robot cannot move, or the estimates do not settle and ``on_failure`` is
            ``raise``.
    """
    regressor = torque_regressor(robot, logs, effects)
    return cloe(regressor, feedback=feedback, stretch=stretch, iterations=iterations, on_failure=on_failure)


def cloe(
    regressor: Regressor,
    *,
    feedback: Feedback | None = None,
    stretch: float = 5.0,
    iterations: int = 20,
    on_failure: Literal["raise", "return"] = "raise",
) -> Fit:
    """`fit_cloe` on equations that are made already (`gap_regressor` for the effects alone).

    Args:
        regressor: The equations.
        feedback: See `fit_cloe`.
        stretch: See `fit_cloe`.
        iterations: See `fit_cloe`.
        on_failure: See `fit_cloe`.

    Raises:
        LogError: See `fit_cloe`.
        ParameterError: See `fit_cloe`.
        IdentifiabilityError: See `fit_cloe`.
        EstimationError: See `fit_cloe`.
    """
    if not stretch > 0:
        raise ParameterError(f"The stretches were asked to last {stretch:g} s: give a time above 0.")
    start = start_of(regressor, feedback)
    base = start.base
    shooting = Shooting(regressor, base, start.loops, stretches_of(start.loops, stretch))
    measured = shooting.measured()
    point = _point(shooting, measured, start.theta, shooting.first_states())
    for _ in range(iterations):
        weights = _weights(point.left, measured)
        slopes = shooting.slopes(point.theta, point.states, point.outputs)
        step, factor, left = _step(slopes, point, weights)
        inverse = solve_triangular(factor, np.eye(len(factor)))
        std = np.linalg.norm(inverse, axis=1)[-base.rank :]
        error = point.error(weights)
        point = _taken(shooting, measured, point, step, weights)
        small = np.abs(step[-base.rank :]) <= _SETTLED * std + 1e-6 * np.abs(point.theta)
        flat = point.error(weights) >= (1.0 - _FLAT) * error
        if small.all() or (flat and left >= (1.0 - _PROMISED) * error):
            return _fit(shooting, measured, point, Status.SOLVED)
        if point.error(weights) >= error:
            break
    if on_failure == "raise":
        raise EstimationError(f"{Status.NOT_SETTLED.value} (at most {iterations} steps)")
    return _fit(shooting, measured, point, Status.NOT_SETTLED)


@dataclass(frozen=True)
class _Point:
    """Parameters and states, their simulation, and what it leaves of torques and positions.

    In the order of the slopes: by how much the recorded states differ from these (off), and may differ (trust).
    """

    theta: Float[Array, " r"]
    states: Float[Array, "s 2 nv"]
    outputs: list[Array]
    left: Float[Array, "N c"]
    off: Float[Array, " k"]
    trust: Float[Array, " k"]

    def error(self, weights: Float[Array, " c"]) -> float:
        """What is minimised."""
        return float(np.sum((self.left * weights) ** 2) + np.sum((self.off / self.trust) ** 2))


def _point(shooting: Shooting, measured: Array, theta: Array, states: Array) -> _Point:
    outputs = shooting.outputs(theta, states)
    off = (shooting.first_states() - states).transpose(1, 2, 0).ravel()
    trust = shooting.state_trust().ravel()
    return _Point(theta, states, outputs, measured - shooting.in_band(outputs), off, trust)


def _weights(left: Float[Array, "N c"], measured: Float[Array, "N c"]) -> Float[Array, " c"]:
    """One over the error of each channel; a channel that never moves counts for nothing."""
    size = np.sqrt(np.mean(measured**2, axis=0))
    noise = np.maximum(np.sqrt(np.mean(left**2, axis=0)), _EXACT * size)
    return np.divide(1.0, noise, out=np.zeros_like(noise), where=noise > 0)


def _step(slopes: Float[Array, "N c p"], point: _Point, weights: Float[Array, " c"]) -> tuple[Array, Array, float]:
    """Step, triangular factor, and the error that is left where slopes tell the truth."""
    p, k = slopes.shape[2], len(point.off)
    rows = np.column_stack([(slopes * weights[:, None]).reshape(-1, p), (point.left * weights).reshape(-1)])
    recorded = np.column_stack([np.eye(k, p) / point.trust[:, None], point.off / point.trust])
    R = np.asarray(np.linalg.qr(np.concatenate([rows, recorded]), mode="r"))
    factor = R[:p, :p]
    norms = np.linalg.norm(factor, axis=0)
    if len(R) < p or not norms.all() or (np.abs(np.diag(factor)) < _LEAST * norms).any():
        raise IdentifiabilityError(
            f"{len(rows)} equations do not determine {p} parameters and states: record more or give longer stretches."
        )
    return solve_triangular(factor, R[:p, p]), factor, float(np.sum(R[p:, p] ** 2))


def _taken(
    shooting: Shooting, measured: Array, point: _Point, step: Float[Array, " p"], weights: Float[Array, " c"]
) -> _Point:
    """The point after as much of a step as lowers the error, or the same."""
    r, error = shooting.base.rank, point.error(weights)
    _, _, nv = point.states.shape
    # Columns come state by state and, within one, stretch by stretch.
    states = step[:-r].reshape(2, nv, -1).transpose(2, 0, 1)
    for k in range(_HALVINGS):
        share = 0.5**k
        try:
            tried = _point(shooting, measured, point.theta + share * step[-r:], point.states + share * states)
        except EstimationError:
            continue
        if tried.error(weights) < error:
            return tried
    return point


def _fit(shooting: Shooting, measured: Array, point: _Point, status: Status) -> Fit:
    regressor, base, r = shooting.regressor, shooting.base, shooting.base.rank
    weights = _weights(point.left, measured)
    slopes = shooting.slopes(point.theta, point.states, point.outputs)
    _, factor, _ = _step(slopes, point, weights)
    rho = [autocorrelation(column, regressor.starts) for column in point.left.T]
    memory = np.array([correlation_factor(lags) for lags in rho])
    inverse = solve_triangular(factor, np.eye(len(factor)))
    scores = np.einsum("ncp,nc->np", slopes, point.left * weights**2, optimize=True) @ inverse
    N, p = scores.shape
    white = inverse @ inverse.T
    # A term more for every parameter that the noise was judged without.
    spare = N * slopes.shape[1] / max(N * slopes.shape[1] - p, 1)
    recorded = inverse[: len(point.trust)] / point.trust[:, None]
    scatter = _remembered(scores, int(np.ceil(4 * memory.max()))) + recorded.T @ recorded
    cov = spare * inverse @ scatter @ inverse.T
    nv = regressor.robot.nv
    std = np.sqrt(np.diag(cov))
    return fit_of(
        "cloe",
        regressor,
        base,
        point.theta,
        cov=cov[-r:, -r:],
        cov_white=white[-r:, -r:],
        sigma=np.sqrt(np.mean(point.left[:, :nv] ** 2, axis=0)),
        correlation=memory[:nv],
        residual=point.left[:, :nv],
        factor=factor[-r:, -r:],
        status=status,
        others=_starts(shooting, point, std[:-r]),
    )


def _remembered(scores: Float[Array, "N p"], longest: int) -> Float[Array, "p p"]:
    """Covariance of a sum of scores that depend on each other over time (Newey and West); at least that without."""
    longest = min(longest, len(scores) // 4)
    out = scores.T @ scores
    for lag in range(1, longest + 1):
        shared = (1.0 - lag / (longest + 1)) * scores[lag:].T @ scores[:-lag]
        out += shared + shared.T
    return out


def _starts(shooting: Shooting, point: _Point, std: Float[Array, " k"]) -> tuple[Estimate, ...]:
    robot, count = shooting.regressor.robot, len(shooting.stretches)
    deviations = std.reshape(2, robot.nv, count)
    out = []
    for k, s in enumerate(shooting.stretches):
        if s.start == 0:
            for i, name in enumerate("qv"):
                for j, joint in enumerate(robot.joint_names):
                    unit = robot.position_units[j] + ("/s" if i else "")
                    label = f"{shooting.loops[s.log].log.file}.{name}0.{joint}"
                    out.append(Estimate(label, float(point.states[k, i, j]), float(deviations[i, j, k]), unit))
    return tuple(out)
