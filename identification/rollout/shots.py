"""Simulation of one window: under the recorded torque, or under the controllers that commanded it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.data.log import Log
from identification.rollout.driven import STEP, base_of, moved, pull, pulling, simulated
from identification.rollout.hidden_states import HiddenStart, hidden_start, hides, pulled_to
from identification.rollout.rollout_starts import Start, States, Window, true_state
from identification.rollout.simulated_models import Model
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.control import Tracking, with_late_references
from phantom_dyn.simulation.simulate import Cause


@dataclass(frozen=True)
class Shot:
    """A window of one recording with its initial states.

    Attributes:
        log: The recording.
        states: Its smoothed states.
        window: The samples.
        begun: Estimated hidden states of the model before the window; None without any.
    """

    log: Log
    states: States
    window: Window
    begun: HiddenStart | None = None

    @property
    def t(self) -> Float[Array, " n"]:
        """Times since the start [s]."""
        t = self.log.motion.t[self.window.start : self.window.stop]
        return t - t[0]

    @property
    def read(self) -> Float[Array, "n nv"]:
        """Raw readings of the positions."""
        return self.states.raw[self.window.start : self.window.stop]

    def with_hidden_start(self, model: Model, torque: Float[Array, "N nv"]) -> Shot:
        """The window with hidden states of a model by `hidden_start`."""
        return replace(self, begun=hidden_start(self.log, self.states, self.window, model, torque))

    def pulled(self, model: Model, torque: Float[Array, "N nv"]) -> Shot:
        """The window with hidden states of a model by `pulled_to`."""
        return replace(self, begun=pulled_to(self.log, self.states, self.window, model, torque))


def under_torque(
    shot: Shot, model: Model, torque: Float[Array, "N nv"], nudge: Float[Array, "2 nv"] | None = None
) -> Float[Array, "n nv"]:
    """Readings [rad or m] of the model under the torque of its drives.

    Args:
        shot: The window with its initial states.
        model: The model.
        torque: Torque of the drives over the whole log [N m or N].
        nudge: Shift of position and velocity at the start.

    Raises:
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    if hides(model):
        begun = shot.begun
        if begun is None or begun.model is not model:
            begun = hidden_start(shot.log, shot.states, shot.window, model, torque)
        return _freely(shot, begun, torque, nudge)
    shift = np.zeros((2, model.robot.nv)) if nudge is None else nudge
    window, states = shot.window, shot.states
    lead = min(window.lead, int(np.ceil(model.settles * shot.log.band.rate_hz)))
    rows = slice(window.start - lead, window.stop)
    t, q, v = shot.log.motion.t[rows], states.q[rows] + shift[0], states.v[rows] + shift[1]
    where = _touched(shot.log, rows)
    where[:lead] = True
    law = pulling(t, torque[rows], q, v, pull(model, states.q[window.start]), where)
    start = true_state(model, states, rows.start, float(t[1] - t[0]), shift)
    return np.array(moved(model, law, start, base_of(model, shot.log, rows)).q[lead:])


def _touched(log: Log, rows: slice) -> Bool[Array, "n nv"]:
    """True where joints carry an unmeasured contact force, so that feedback keeps them on the recording."""
    some = log.motion.q[rows]
    return np.zeros(some.shape, dtype=bool) if log.touched is None else np.array(log.touched[rows])


def _freely(shot: Shot, begun: HiddenStart, torque: Array, nudge: Float[Array, "2 nv"] | None) -> Float[Array, "n nv"]:
    """Readings of a simulation that starts at the estimated hidden states."""
    rows, states = slice(begun.at, shot.window.stop), shot.states
    gains = pull(begun.model, states.q[begun.at])
    q, v, where = states.q[rows], states.v[rows], _touched(shot.log, rows)
    law = pulling(shot.log.motion.t[rows], torque[rows], q, v, gains, where)
    motion = moved(begun.model, law, _nudged(begun.start, nudge), base_of(begun.model, shot.log, rows))
    return np.array(motion.q[shot.window.start - begun.at :])


def _nudged(start: Start, nudge: Float[Array, "2 nv"] | None) -> Start:
    if nudge is None:
        return start
    q, v = nudge
    return Start(start.q + q, start.v + v, start.motor_q + q, start.motor_v + v)


def under_control(
    shot: Shot, model: Model, nudge: Float[Array, "2 nv"] | None = None, *, max_step: float = STEP
) -> Float[Array, "n nv"]:
    """Readings [rad or m] of the model under the controllers and references of the recording.

    Args:
        shot: The window with its initial states.
        model: The model; its actuators state the controllers.
        nudge: Shift of position and velocity at the start.
        max_step: Longest step [s].

    Raises:
        LogError: If there are no references.
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    window, states, robot = shot.window, shot.states, model.robot
    if shot.log.q_ref is None:
        raise LogError(f"{shot.log.file} has no references.")
    if shot.begun is not None and shot.begun.model is model:
        first, start = shot.begun.at, _nudged(shot.begun.start, nudge)
    else:
        first = window.start - min(window.lead, int(np.ceil(model.settles * shot.log.band.rate_hz)))
        start = true_state(model, states, first, 1.0 / shot.log.band.rate_hz, nudge)
    rows = slice(first, window.stop)
    law = control_law(robot, shot.log.motion.t[rows], shot.log.q_ref[rows])
    late = np.array([0.0 if a.controller is None else a.controller.reference_delay for a in robot.actuators])
    late = late if model.late_references is None else late + model.late_references
    law = with_late_references(law, late) if late.any() else law
    law = _led(law, shot, model, rows)
    causes = (*controller_delays(robot), *model.commands, *model.causes)
    moving = replace(robot, torque_source="command")
    base = base_of(model, shot.log, rows)
    return np.array(simulated(moving, causes, law, start, base, max_step=max_step).q[window.start - first :])


def _led(law: Tracking, shot: Shot, model: Model, rows: slice) -> Tracking:
    """Controllers plus feedback that keeps joints on the recording while they carry an unmeasured contact force."""
    where, states = _touched(shot.log, rows), shot.states
    if not where.any():
        return law
    (kp, kd), tau = pull(model, states.q[rows.start]), shot.log.tau[rows]
    there = {"feedforward": tau, "q_ref": states.q[rows], "v_ref": states.v[rows], "kp": kp, "kd": kd}
    return replace(law, **{name: np.where(where, value, getattr(law, name)) for name, value in there.items()})


def controlled(robot: Robot) -> bool:
    """True if the controller of every driven joint is stated, with a constant gain."""
    driven = [a.controller for a in robot.actuators if a.actuated]
    return bool(driven) and all(
        controller is not None and controller.kp > 0 and np.isinf(controller.drops_beyond) for controller in driven
    )


def control_law(robot: Robot, t: Float[Array, " N"], q_ref: Float[Array, "N nv"]) -> Tracking:
    """The stated controllers without their delays: ``kp (q_ref - q) - kd v`` within the limits of the drives."""
    gains = np.array([(0.0, 0.0) if a.controller is None else (a.controller.kp, a.controller.kd)
                      for a in robot.actuators])  # fmt: skip
    kp, kd = (np.broadcast_to(gain, q_ref.shape) for gain in gains.T)
    limits = np.array([np.inf if a.torque_limit is None else a.torque_limit for a in robot.actuators])
    none = np.zeros(q_ref.shape)
    return Tracking(t, none, q_ref, none, kp, kd, none, limits)


def controller_delays(robot: Robot) -> tuple[Cause, ...]:
    """The delays of the stated controllers, as effects of the drives."""
    return tuple(
        Cause(effect_named("input_delay"), joint, np.array([actuator.controller.delay]))
        for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
        if actuator.controller is not None and actuator.controller.delay > 0
    )
