"""Simulation of one window: under the recorded torque, or under the recorded references and their controllers.

Some states are not read by any encoder: the position of a link within backlash, or of a motor whose encoder is on the
link. These hidden states are estimated in two steps:

1. A simulation with feedback follows the recording before the window.
2. A simulation under the recorded torque alone is fitted to the last readings before the window. The unknowns are all
   states at its start, including those that encoders read, because smoothed readings are wrong shortly after an impact.

Samples inside the window are used only to smooth its first sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.data.log import Log
from identification.rollout.rollout_starts import (
    STEP,
    Start,
    States,
    Window,
    base_of,
    feedback_gains,
    feedback_law,
    simulated,
    simulated_with_torque,
    true_state,
)
from identification.rollout.simulated_models import LEAD, Model
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.control import Tracking, torque_over_time, with_late_references
from phantom_dyn.simulation.simulate import Cause, Simulation

# Time [s] over which a simulation under the recorded torque is fitted to readings, and the smallest number of readings.
# With a longer time, errors of the model would matter more; with a shorter time, noise of the readings.
_FITTED_S, _FEWEST = 0.1, 8
_ROUNDS, _ENOUGH = 4, 0.02  # iterations of least squares, and relative decrease of the cost at which they end
_BAD_FIT = 4.0  # a fit is bad if the mean square of its residual is larger, in variances of the readings
_DIFFERENCE_STEP = 0.02  # step of finite differences, as a share of a state's uncertainty
_TRIED_SHIFTS = (-1.0, -0.5, 0.5, 1.0)  # starts of the fit: shifts of the hidden side, in widths of the backlash
_SPEED_ERROR = 0.2  # error of smoothed speeds shortly after an impact, as a share of the standard deviation of speeds
_SPEED_ERROR_TIME_S = 0.005  # duration [s] of an error of the speed; duration times speed error is a position error


@dataclass(frozen=True, eq=False)
class HiddenStart:
    """The states of a model at a sample before the start of a window, or at the start.

    Attributes:
        model: The model.
        at: Index of the sample in the log.
        start: States of links and motors at this sample.
    """

    model: Model
    at: int
    start: Start


def has_hidden_states(model: Model) -> bool:
    """True if a model has states that no encoder reads: backlash, or a motor whose encoder is on the link."""
    return any(part.gap > 0 or not _on_motor(model, row_of(model.robot, part.joint)) for part in model.transmissions)


def lead_for_hidden_states(rate_hz: float) -> float:
    """Duration [s] of the recording before a window that the estimate of hidden states needs."""
    return LEAD + max(_FITTED_S, _FEWEST / rate_hz)


def simulation_count(model: Model) -> int:
    """Approximate number of short simulations that `hidden_start` needs."""
    return len(_TRIED_SHIFTS) + 1 + _ROUNDS * (2 * model.robot.nv + 2 * len(_hidden(model)) + 2)


def hidden_start(log: Log, states: States, window: Window, model: Model, torque: Float[Array, "N nv"]) -> HiddenStart:
    """Estimated states of a model before a window; smoothed states at its start if too few samples precede the window.

    Args:
        log: The recording.
        states: Smoothed states of the recording.
        window: The window, with the number of samples before it that may be used.
        model: A model with transmissions that are not rigid.
        torque: Torque of the drives, over the whole log.

    Raises:
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    rate = log.band.rate_hz
    fitted = max(round(_FITTED_S * rate), _FEWEST)
    if window.lead < fitted:
        return HiddenStart(model, window.start, true_state(model, states, window.start, 1.0 / rate))
    at = window.start - fitted
    first_guess = _after_feedback(log, states, model, torque, at, min(round(LEAD * rate), window.lead - fitted))
    spread = _uncertainty(model, states, first_guess)
    rows = slice(at, window.start + 1)
    law, base = torque_over_time(log.motion.t[rows], torque[rows]), base_of(model, log, rows)

    def run(shifts: Array) -> Simulation:
        return simulated_with_torque(model, law, _with_fitted_shifts(model, first_guess, shifts * spread), base)

    def residuals(shifts: Array) -> Array:
        # The shifts themselves are residuals of a prior with the standard deviations of `spread`.
        return np.concatenate([((run(shifts).q - states.raw[rows]) / states.read_std).ravel(), shifts])

    shifts = _best_fitted(residuals, _guesses(model, spread))
    return HiddenStart(model, at, _with_fitted_shifts(model, first_guess, shifts * spread))


def _after_feedback(log: Log, states: States, model: Model, torque: Array, at: int, lead: int) -> Start:
    """State at a sample after a simulation with feedback over the ``lead`` samples before it.

    If an encoder is on a link behind a spring or backlash, feedback would be unstable: the result is then `true_state`.
    """
    if lead < 2 or not all(_on_motor(model, row) for row in _hidden(model)):
        return true_state(model, states, at, 1.0 / log.band.rate_hz)
    start = true_state(model, states, at - lead, 1.0 / log.band.rate_hz)
    rows = slice(at - lead, at + 1)
    gains = feedback_gains(model, states.q[at])
    everywhere = np.ones((lead + 1, model.robot.nv), dtype=bool)
    law = feedback_law(log.motion.t[rows], torque[rows], states.q[rows], states.v[rows], gains, everywhere)
    out = simulated_with_torque(model, law, start, base_of(model, log, rows))
    return Start(out.links.q[-1], out.links.v[-1], out.encoders.q[-1], out.encoders.v[-1])


def _on_motor(model: Model, row: int) -> bool:
    """True if the encoder of a joint is on its motor."""
    return model.robot.actuators[row].encoder_side == "motor"


def _hidden(model: Model) -> list[int]:
    """Indices of the joints with backlash or a spring, which have an encoder on the link or on the motor only."""
    return sorted({row_of(model.robot, part.joint) for part in model.transmissions})


def _gap(model: Model, row: int) -> float:
    """Backlash of a joint [rad or m]; zero without any."""
    return sum(part.gap for part in model.transmissions if row_of(model.robot, part.joint) == row)


def _with_fitted_shifts(model: Model, start: Start, shifts: Float[Array, " n"]) -> Start:
    """A start with shifted states.

    Args:
        model: The model.
        start: The start.
        shifts: Shift of each joint's position, then of each joint's speed, both of link and motor; then, for each joint
            of `_hidden`, an additional shift of position and speed of the side that no encoder reads.
    """
    nv = model.robot.nv
    out = _with_start_shift(start, shifts[: 2 * nv].reshape(2, nv))
    for row, (shift, speed_shift) in zip(_hidden(model), shifts[2 * nv :].reshape(-1, 2), strict=True):
        position, speed = (out.q, out.v) if _on_motor(model, row) else (out.motor_q, out.motor_v)
        position[row] += shift
        speed[row] += speed_shift
    return out


def _uncertainty(model: Model, states: States, start: Start) -> Float[Array, " n"]:
    """Standard deviation of each shift of `_with_fitted_shifts`."""
    v = 5.0 * states.v_std + _SPEED_ERROR * states.v.std(axis=0)
    q = 5.0 * states.q_std + _SPEED_ERROR_TIME_S * v
    out = [*q, *v]
    for row in _hidden(model):
        gap = _gap(model, row)
        deflection = abs(float(start.motor_q[row] - start.q[row]))
        out += [q[row] + gap + 0.2 * deflection, 2.0 * v[row]]
    return np.array(out)


def _guesses(model: Model, spread: Float[Array, " n"]) -> list[Float[Array, " n"]]:
    """Initial shifts of the fit, in units of ``spread``: zero, and hidden sides shifted within their backlash."""
    out = [np.zeros(len(spread))]
    for k, row in enumerate(_hidden(model)):
        gap, position = _gap(model, row), 2 * model.robot.nv + 2 * k
        for share in _TRIED_SHIFTS if gap > 0 else ():
            shifts = np.zeros(len(spread))
            shifts[position] = share * gap / spread[position]
            out.append(shifts)
    return out


def _best_fitted(residuals: Callable[[Array], Array], guesses: list[Float[Array, " n"]]) -> Float[Array, " n"]:
    """Least-squares fit from the best guess; if this fit is bad, the better of the fits from the two best guesses."""

    def mean_square(shifts: Array) -> float:
        return float(np.mean(residuals(shifts) ** 2))

    first, *others = sorted(guesses, key=mean_square)
    best = _fitted(residuals, first)
    if others and mean_square(best) > _BAD_FIT:
        best = min(best, _fitted(residuals, others[0]), key=mean_square)
    return best


def _fitted(residuals: Callable[[Array], Array], guess: Float[Array, " n"]) -> Float[Array, " n"]:
    """Least squares fit from a first guess."""
    from scipy.optimize import least_squares

    def slopes(at: Array) -> Array:
        # Backlash makes the residuals rough: the steps are longer than rounding errors require.
        here = residuals(at)
        return np.column_stack(
            [(residuals(at + _DIFFERENCE_STEP * unit) - here) / _DIFFERENCE_STEP for unit in np.eye(len(at))]
        )

    # A callable `jac` is documented by SciPy, but pyright infers the type of its default, a string.
    return least_squares(residuals, guess, jac=slopes, max_nfev=_ROUNDS, ftol=_ENOUGH).x  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class Shot:
    """A window of one recording with its initial states.

    Attributes:
        log: The recording.
        states: Smoothed states of the recording.
        window: The samples of the window.
        hidden_start: Estimated hidden states of the model before the window; None if they have not been estimated.
    """

    log: Log
    states: States
    window: Window
    hidden_start: HiddenStart | None = None

    @property
    def t(self) -> Float[Array, " n"]:
        """Times since the start of the window [s]."""
        t = self.log.motion.t[self.window.start : self.window.stop]
        return t - t[0]

    @property
    def read(self) -> Float[Array, "n nv"]:
        """Raw readings of the positions."""
        return self.states.raw[self.window.start : self.window.stop]

    def with_hidden_start(self, model: Model, torque: Float[Array, "N nv"]) -> Shot:
        """The window with the hidden states of a model, estimated by `hidden_start`."""
        return replace(self, hidden_start=hidden_start(self.log, self.states, self.window, model, torque))

    def with_start_by_feedback(self, model: Model, torque: Float[Array, "N nv"]) -> Shot:
        """The window with hidden states estimated by feedback alone: less accurate, but by only one simulation."""
        window, lead = self.window, min(round(LEAD * self.log.band.rate_hz), self.window.lead)
        start = _after_feedback(self.log, self.states, model, torque, window.start, lead)
        return replace(self, hidden_start=HiddenStart(model, window.start, start))


def under_torque(
    shot: Shot, model: Model, torque: Float[Array, "N nv"], start_shift: Float[Array, "2 nv"] | None = None
) -> Float[Array, "n nv"]:
    """Simulated readings [rad or m] of the model under the torque of its drives, at the samples of the window.

    Args:
        shot: The window with its initial states.
        model: The model.
        torque: Torque of the drives over the whole log [N m or N].
        start_shift: Shift of position and velocity at the start.

    Raises:
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    if has_hidden_states(model):
        hidden = shot.hidden_start
        if hidden is None or hidden.model is not model:
            hidden = hidden_start(shot.log, shot.states, shot.window, model, torque)
        return _from_hidden_start(shot, hidden, torque, start_shift)
    shift = np.zeros((2, model.robot.nv)) if start_shift is None else start_shift
    window, states = shot.window, shot.states
    lead = _settling_lead(shot, model)
    rows = slice(window.start - lead, window.stop)
    t, q, v = shot.log.motion.t[rows], states.q[rows] + shift[0], states.v[rows] + shift[1]
    with_feedback = _touched(shot.log, rows)
    with_feedback[:lead] = True
    law = feedback_law(t, torque[rows], q, v, feedback_gains(model, states.q[window.start]), with_feedback)
    start = true_state(model, states, rows.start, float(t[1] - t[0]), shift)
    return np.array(simulated_with_torque(model, law, start, base_of(model, shot.log, rows)).q[lead:])


def _settling_lead(shot: Shot, model: Model) -> int:
    """Number of samples before a window in which hidden states of a model settle, limited to the available samples."""
    return min(shot.window.lead, int(np.ceil(model.settling_time * shot.log.band.rate_hz)))


def _touched(log: Log, rows: slice) -> Bool[Array, "n nv"]:
    """True where joints carry an unmeasured contact force; feedback makes these joints follow the recording."""
    shape = log.motion.q[rows].shape
    return np.zeros(shape, dtype=bool) if log.touched is None else np.array(log.touched[rows])


def _from_hidden_start(
    shot: Shot, hidden: HiddenStart, torque: Array, start_shift: Float[Array, "2 nv"] | None
) -> Float[Array, "n nv"]:
    """Readings of a simulation that starts at the estimated hidden states."""
    rows, states = slice(hidden.at, shot.window.stop), shot.states
    gains = feedback_gains(hidden.model, states.q[hidden.at])
    q, v, where = states.q[rows], states.v[rows], _touched(shot.log, rows)
    law = feedback_law(shot.log.motion.t[rows], torque[rows], q, v, gains, where)
    motion = simulated_with_torque(
        hidden.model, law, _with_start_shift(hidden.start, start_shift), base_of(hidden.model, shot.log, rows)
    )
    return np.array(motion.q[shot.window.start - hidden.at :])


def _with_start_shift(start: Start, start_shift: Float[Array, "2 nv"] | None) -> Start:
    """A start with a shift of position and velocity, the same for links and motors, in new arrays."""
    if start_shift is None:
        return start
    q, v = start_shift
    return Start(start.q + q, start.v + v, start.motor_q + q, start.motor_v + v)


def under_control(
    shot: Shot, model: Model, start_shift: Float[Array, "2 nv"] | None = None, *, max_step: float = STEP
) -> Float[Array, "n nv"]:
    """Simulated readings [rad or m] of the model under its controllers and the references of the recording.

    Args:
        shot: The window with its initial states.
        model: The model with its controllers.
        start_shift: Shift of position and velocity at the start.
        max_step: Longest integration step [s].

    Raises:
        LogError: If the log has no references.
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    window, states, robot = shot.window, shot.states, model.robot
    if shot.log.q_ref is None:
        raise LogError(f"{shot.log.file} has no references.")
    if shot.hidden_start is not None and shot.hidden_start.model is model:
        first, start = shot.hidden_start.at, _with_start_shift(shot.hidden_start.start, start_shift)
    else:
        first = window.start - _settling_lead(shot, model)
        start = true_state(model, states, first, 1.0 / shot.log.band.rate_hz, start_shift)
    rows = slice(first, window.stop)
    law = control_law(robot, shot.log.motion.t[rows], shot.log.q_ref[rows])
    late = np.array([0.0 if a.controller is None else a.controller.reference_delay for a in robot.actuators])
    late = late if model.late_references is None else late + model.late_references
    law = with_late_references(law, late) if late.any() else law
    law = _with_contact_feedback(law, shot, model, rows)
    causes = (*controller_delays(robot), *model.commands, *model.causes)
    base = base_of(model, shot.log, rows)
    return np.array(simulated(robot, causes, law, start, base, max_step=max_step).q[window.start - first :])


def _with_contact_feedback(law: Tracking, shot: Shot, model: Model, rows: slice) -> Tracking:
    """The control law, replaced by feedback to the recording where joints carry an unmeasured contact force."""
    touched, states = _touched(shot.log, rows), shot.states
    if not touched.any():
        return law
    (kp, kd), tau = feedback_gains(model, states.q[rows.start]), shot.log.tau[rows]
    feedback = {"feedforward": tau, "q_ref": states.q[rows], "v_ref": states.v[rows], "kp": kp, "kd": kd}
    return replace(law, **{name: np.where(touched, value, getattr(law, name)) for name, value in feedback.items()})


def controlled(robot: Robot) -> bool:
    """True if the model states a controller with a constant position gain for every driven joint."""
    driven = [a.controller for a in robot.actuators if a.actuated]
    return bool(driven) and all(
        controller is not None and controller.kp > 0 and np.isinf(controller.drops_beyond) for controller in driven
    )


def control_law(robot: Robot, t: Float[Array, " N"], q_ref: Float[Array, "N nv"]) -> Tracking:
    """The controllers of the model without their delays: ``kp (q_ref - q) - kd v`` within the limits of the drives."""
    controllers = [actuator.controller for actuator in robot.actuators]
    kp = np.broadcast_to([0.0 if one is None else one.kp for one in controllers], q_ref.shape)
    kd = np.broadcast_to([0.0 if one is None else one.kd for one in controllers], q_ref.shape)
    limits = np.array([np.inf if a.torque_limit is None else a.torque_limit for a in robot.actuators])
    none = np.zeros(q_ref.shape)
    return Tracking(t, none, q_ref, none, kp, kd, none, limits)


def controller_delays(robot: Robot) -> tuple[Cause, ...]:
    """The delays of the model's controllers, as effects of the drives."""
    return tuple(
        Cause(effect_named("input_delay"), joint, np.array([actuator.controller.delay]))
        for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
        if actuator.controller is not None and actuator.controller.delay > 0
    )
