"""Closed-loop output error (CLOE): the simulated loop's torques and positions are fitted to the recorded ones.

No derivative of a position and no regressor on recorded motion: Gauss and Newton's method on the simulation itself,
with the states at the start of every stretch of a few seconds as unknowns (multiple shooting), so that what the model
lacks in one stretch does not spoil the next. A controller soon forgets the state at a start, often before the band has
its first sample: the recorded states count, loosely, as measurements, see `Shooting.state_std`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.linalg import solve_triangular

from identification.data.log import Log
from identification.engine.autocorrelation import samples_per_independent
from identification.estimators.closed_loop.loop import Feedback, Loop, simulated, start_of
from identification.estimators.closed_loop.plant import plant_of
from identification.estimators.closed_loop.stated_controllers import require_own_controllers
from identification.estimators.fit import Estimate, Fit, Status, Values, fit_of
from identification.estimators.linear.scatter import autocorrelation
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import EstimationError, IdentifiabilityError, ParameterError
from phantom_dyn.model.robot import Robot

# Share of a signal by which a parameter or a state is moved for a finite difference: dry friction makes those of less
# rough.
_INCREMENT = 1e-4
_TRUST = 1e-2  # share of a signal by which a recorded state may be off: many times the noise of any encoder

_SETTLED = 0.05  # standard deviations, see `identification.estimators.iv`
_HALVINGS = 8  # of a step that does not lower the error
# Where a step lowers the error by less than this share, and slopes promise hardly more, what is left is the roughness
# that dry friction gives the simulation; where slopes promise much and no step keeps it, the fit has failed.
_FLAT, _PROMISED = 1e-3, 0.1
# Share of a channel below which its error is that of the integration, which dry friction makes rough, and not noise:
# no encoder is as good.
_EXACT = 1e-5
_LEAST = 1e-9  # a column that adds less than this share of its norm to those before it is not determined


@dataclass(frozen=True)
class Stretch:
    """Samples ``start`` to ``stop`` of recording ``log``."""

    log: int
    start: int
    stop: int


def stretches_of(loops: tuple[Loop, ...], seconds: float) -> tuple[Stretch, ...]:
    """Stretches of about this length, a recording at least one.

    Args:
        loops: The closed loops.
        seconds: Wanted length [s].
    """
    out = []
    for k, loop in enumerate(loops):
        N = len(loop.log.motion.t)
        edges = np.linspace(0, N, max(1, round(N * loop.dt / seconds)) + 1).round().astype(int)
        out += [Stretch(k, int(a), int(b)) for a, b in pairwise(edges)]
    return tuple(out)


@dataclass(frozen=True)
class Shooting:
    """What is simulated and compared: torque, then position, of every joint in the band.

    Attributes:
        regressor: Gives robot, terms and recordings.
        base: The unknown parameters.
        loops: The closed loops.
        stretches: Each with an unknown state at its start.
    """

    regressor: Regressor
    base: BaseParameters
    loops: tuple[Loop, ...]
    stretches: tuple[Stretch, ...]

    def first_states(self) -> Float[Array, "s 2 nv"]:
        """Positions and velocities at the starts as they were recorded."""
        logs = [loop.log for loop in self.loops]
        return np.array([[logs[s.log].motion.q[s.start], logs[s.log].motion.v[s.start]] for s in self.stretches])

    def measured(self) -> Float[Array, "N c"]:
        """Recorded torques and positions in the band, shape ``(N, 2 nv)``."""
        logs = [loop.log for loop in self.loops]
        positions = [log.motion.q if log.raw_q is None else log.raw_q for log in logs]
        return self._banded([np.hstack([log.tau, q]) for log, q in zip(logs, positions, strict=True)])

    def outputs(self, theta: Float[Array, " r"], states: Float[Array, "s 2 nv"]) -> list[Float[Array, "_ c"]]:
        """Simulated torques and positions of each recording at the full rate.

        Args:
            theta: Base parameters.
            states: At the starts.

        Raises:
            EstimationError: If the robot cannot move with these parameters.
        """
        plant = plant_of(self.regressor, self.base, theta)
        out = [np.zeros((len(loop.log.motion.t), 2 * self.regressor.robot.nv)) for loop in self.loops]
        for s, (q0, v0) in zip(self.stretches, states, strict=True):
            motion, tau = simulated(self.loops[s.log], plant, s.start, s.stop, q0, v0)
            out[s.log][s.start : s.stop] = np.hstack([tau, motion.q])
        return out

    def in_band(self, outputs: list[Float[Array, "_ c"]]) -> Float[Array, "N c"]:
        """Full-rate outputs in the band, valid samples only."""
        return self._banded(outputs)

    def _banded(self, values: list[Array]) -> Array:
        return np.concatenate([Regressor.in_band(loop.log, one) for loop, one in zip(self.loops, values, strict=True)])

    def slopes(
        self, theta: Float[Array, " r"], states: Float[Array, "s 2 nv"], outputs: list[Float[Array, "_ c"]]
    ) -> Float[Array, "N c p"]:
        """Derivatives of the outputs in the band by all states, stretch by stretch, and then by the parameters.

        Args:
            theta: Base parameters.
            states: At the starts.
            outputs: Of these.

        Raises:
            EstimationError: If the robot cannot move next to these parameters.
        """
        columns = []
        for which in np.ndindex(2, self.regressor.robot.nv):
            increment = self._state_increment(which)
            moved = states.copy()
            moved[(slice(None), *which)] += increment
            changes = [(a - b) / increment for a, b in zip(self.outputs(theta, moved), outputs, strict=True)]
            # A start moves its own stretch and nothing else.
            for s in self.stretches:
                alone = [np.zeros_like(change) for change in changes]
                alone[s.log][s.start : s.stop] = changes[s.log][s.start : s.stop]
                columns.append(self._banded(alone))
        for k, increment in enumerate(self._parameter_increments()):
            moved = theta.copy()
            moved[k] += increment
            columns.append(
                self._banded([(a - b) / increment for a, b in zip(self.outputs(moved, states), outputs, strict=True)])
            )
        return np.stack(columns, axis=2)

    def state_std(self) -> Float[Array, "2 nv s"]:
        """Standard deviations of the recorded states: a state that the band does not show stays as it was recorded."""
        sizes = [[self._state_size((i, j)) for j in range(self.regressor.robot.nv)] for i in range(2)]
        return _TRUST * np.repeat(np.array(sizes)[:, :, None], len(self.stretches), axis=2)

    def _state_increment(self, which: tuple[int, ...]) -> float:
        return _INCREMENT * self._state_size(which)

    def _state_size(self, which: tuple[int, ...]) -> float:
        name, joint = "qv"[which[0]], which[1]
        size = max(float(np.ptp(getattr(loop.log.motion, name)[:, joint])) for loop in self.loops)
        return size if size > 0 else 1.0

    def _parameter_increments(self) -> Float[Array, " r"]:
        """Change of each parameter that changes the torque by a ten-thousandth."""
        torque = np.linalg.norm(self.regressor.measured)
        return _INCREMENT * torque / self.base.norms[list(self.base.independent)]


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
        LogError: If a log has no references, or its torque is not what the stated controllers ask for.
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
        feedback: The controllers, where the robot does not state them.
        stretch: Length of the stretches that start from states of their own [s].
        iterations: Most steps there may be.
        on_failure: What to do where the estimates do not settle.

    Raises:
        LogError: If a log has no references, or its torque is not what the stated controllers ask for.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter.
        EstimationError: If the simulated robot cannot move, or the estimates do not settle.
    """
    if not stretch > 0:
        raise ParameterError(f"The stretches were asked to last {stretch:g} s: give a time above 0.")
    start = start_of(regressor, feedback)
    require_own_controllers(start.loops)
    base = start.base
    shooting = Shooting(regressor, base, start.loops, stretches_of(start.loops, stretch))
    measured = shooting.measured()
    iterate = _iterate(shooting, measured, start.theta, shooting.first_states())
    for _ in range(iterations):
        weights = _weights(iterate.residual, measured)
        slopes = shooting.slopes(iterate.theta, iterate.states, iterate.outputs)
        step, factor, left = _step(slopes, iterate, weights, base.base_names)
        inverse = solve_triangular(factor, np.eye(len(factor)))
        std = np.linalg.norm(inverse, axis=1)[-base.rank :]
        error = iterate.error(weights)
        iterate = _damped_step(shooting, measured, iterate, step, weights)
        small = np.abs(step[-base.rank :]) <= _SETTLED * std + 1e-6 * np.abs(iterate.theta)
        flat = iterate.error(weights) >= (1.0 - _FLAT) * error
        if small.all() or (flat and left >= (1.0 - _PROMISED) * error):
            return _fit(shooting, measured, iterate, Status.SOLVED)
        if iterate.error(weights) >= error:
            break
    if on_failure == "raise":
        raise EstimationError(f"{Status.NOT_SETTLED.value} (at most {iterations} steps)")
    return _fit(shooting, measured, iterate, Status.NOT_SETTLED)


@dataclass(frozen=True)
class _Iterate:
    """One iterate of the Gauss-Newton method.

    Attributes:
        theta: Base parameters.
        states: Positions and velocities at the start of each stretch.
        outputs: Simulated torques and positions of each recording.
        residual: Measured minus simulated torques and positions in the band.
        state_error: Recorded minus these states, in the order of the slopes.
        state_std: Standard deviations of the recorded states, in the same order.
    """

    theta: Float[Array, " r"]
    states: Float[Array, "s 2 nv"]
    outputs: list[Array]
    residual: Float[Array, "N c"]
    state_error: Float[Array, " k"]
    state_std: Float[Array, " k"]

    def error(self, weights: Float[Array, " c"]) -> float:
        """Weighted sum of squares that is minimised."""
        return float(np.sum((self.residual * weights) ** 2) + np.sum((self.state_error / self.state_std) ** 2))


def _iterate(shooting: Shooting, measured: Array, theta: Array, states: Array) -> _Iterate:
    outputs = shooting.outputs(theta, states)
    state_error = (shooting.first_states() - states).transpose(1, 2, 0).ravel()
    residual = measured - shooting.in_band(outputs)
    return _Iterate(theta, states, outputs, residual, state_error, shooting.state_std().ravel())


def _weights(left: Float[Array, "N c"], measured: Float[Array, "N c"]) -> Float[Array, " c"]:
    """One over the error of each channel; a channel that never moves counts for nothing."""
    size = np.sqrt(np.mean(measured**2, axis=0))
    noise = np.maximum(np.sqrt(np.mean(left**2, axis=0)), _EXACT * size)
    return np.divide(1.0, noise, out=np.zeros_like(noise), where=noise > 0)


def _step(
    slopes: Float[Array, "N c p"], iterate: _Iterate, weights: Float[Array, " c"], names: tuple[str, ...]
) -> tuple[Array, Array, float]:
    """Gauss-Newton step, triangular factor, and the error after the step if the outputs were linear."""
    p, k = slopes.shape[2], len(iterate.state_error)
    rows = np.column_stack([(slopes * weights[:, None]).reshape(-1, p), (iterate.residual * weights).reshape(-1)])
    recorded = np.column_stack([np.eye(k, p) / iterate.state_std[:, None], iterate.state_error / iterate.state_std])
    R = np.asarray(np.linalg.qr(np.concatenate([rows, recorded]), mode="r"))
    factor = R[:p, :p]
    norms = np.linalg.norm(factor, axis=0)
    weak = np.ones(p, dtype=bool) if len(R) < p else np.abs(np.diag(factor)) <= _LEAST * norms
    if weak.any():
        few = [name for name, unseen in zip(names, weak[p - len(names) :], strict=True) if unseen]
        raise IdentifiabilityError(
            f"The closed loop does not show {', '.join(few) or 'the states at the start of its stretches'} "
            f"({len(rows)} equations): leave out the effects that these belong to, record a motion that moves every "
            "joint for longer, or use an estimator without simulation, such as wls."
        )
    return solve_triangular(factor, R[:p, p]), factor, float(np.sum(R[p:, p] ** 2))


def _damped_step(
    shooting: Shooting, measured: Array, iterate: _Iterate, step: Float[Array, " p"], weights: Float[Array, " c"]
) -> _Iterate:
    """The iterate after as much of a step as lowers the error, or the same iterate."""
    r, error = shooting.base.rank, iterate.error(weights)
    _, _, nv = iterate.states.shape
    # Columns come state by state and, within one, stretch by stretch.
    states = step[:-r].reshape(2, nv, -1).transpose(2, 0, 1)
    for k in range(_HALVINGS):
        share = 0.5**k
        try:
            tried = _iterate(shooting, measured, iterate.theta + share * step[-r:], iterate.states + share * states)
        except EstimationError:
            continue
        if tried.error(weights) < error:
            return tried
    return iterate


def _fit(shooting: Shooting, measured: Array, iterate: _Iterate, status: Status) -> Fit:
    regressor, base, r = shooting.regressor, shooting.base, shooting.base.rank
    weights = _weights(iterate.residual, measured)
    slopes = shooting.slopes(iterate.theta, iterate.states, iterate.outputs)
    _, factor, _ = _step(slopes, iterate, weights, base.base_names)
    rho = [autocorrelation(column, regressor.starts) for column in iterate.residual.T]
    memory = np.array([samples_per_independent(lags) for lags in rho])
    inverse = solve_triangular(factor, np.eye(len(factor)))
    scores = np.einsum("ncp,nc->np", slopes, iterate.residual * weights**2, optimize=True) @ inverse
    N, p = scores.shape
    white = inverse @ inverse.T
    # A term more for every parameter that the noise was judged without.
    spare = N * slopes.shape[1] / max(N * slopes.shape[1] - p, 1)
    recorded = inverse[: len(iterate.state_std)] / iterate.state_std[:, None]
    scatter = _newey_west(scores, int(np.ceil(4 * memory.max()))) + recorded.T @ recorded
    cov = spare * inverse @ scatter @ inverse.T
    nv = regressor.robot.nv
    std = np.sqrt(np.diag(cov))
    values = Values(
        theta=iterate.theta,
        cov=cov[-r:, -r:],
        cov_white=white[-r:, -r:],
        sigma=np.sqrt(np.mean(iterate.residual[:, :nv] ** 2, axis=0)),
        correlation=memory[:nv],
        residual=iterate.residual[:, :nv],
        factor=factor[-r:, -r:],
    )
    return fit_of("cloe", regressor, base, values, status=status, others=_starts(shooting, iterate, std[:-r]))


def _newey_west(scores: Float[Array, "N p"], longest: int) -> Float[Array, "p p"]:
    """Covariance of a sum of scores that are correlated over time, up to lag ``longest`` (Newey and West)."""
    longest = min(longest, len(scores) // 4)
    out = scores.T @ scores
    for lag in range(1, longest + 1):
        shared = (1.0 - lag / (longest + 1)) * scores[lag:].T @ scores[:-lag]
        out += shared + shared.T
    return out


def _starts(shooting: Shooting, iterate: _Iterate, std: Float[Array, " k"]) -> tuple[Estimate, ...]:
    robot, count = shooting.regressor.robot, len(shooting.stretches)
    deviations = std.reshape(2, robot.nv, count)
    out = []
    for k, s in enumerate(shooting.stretches):
        if s.start == 0:
            for i, name in enumerate("qv"):
                for j, joint in enumerate(robot.joint_names):
                    unit = robot.position_units[j] + ("/s" if i else "")
                    label = f"{shooting.loops[s.log].log.file}.{name}0.{joint}"
                    out.append(Estimate(label, float(iterate.states[k, i, j]), float(deviations[i, j, k]), unit))
    return tuple(out)
