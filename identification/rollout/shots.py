"""One window simulated: under the recorded torque, or under the controllers that asked for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identification.log import Log
from identification.rollout.models import Model
from identification.rollout.starts import States, true_state
from identification.rollout.windows import Window
from phantom_dyn.dynamics import mass_matrix
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.rows import row_of
from phantom_dyn.errors import LogError
from phantom_dyn.robot import Robot
from phantom_dyn.simulation import Cause, simulate
from phantom_dyn.tracking import Tracking

Array = np.ndarray

STEP = 1e-3  # [s], the longest: the midpoint rule has a 20 Hz motion right to 0.2 % of its phase
# Before a window a model with hidden states is pulled along the recording, critically damped [rad/s]: a tenth of a
# torque that would take a joint a centimetre away in half a second leaves it a micrometre off.
_PULL = 2.0 * np.pi * 15.0
# A motor behind a spring or a play is pulled alone: fast enough for its own small inertia to hold it.
_MOTOR_PULL = 2.0 * np.pi * 60.0


@dataclass(frozen=True)
class Shot:
    """A window of one recording with the states that it starts from.

    Attributes:
        log: The recording.
        states: Its smoothed states.
        window: Which samples.
    """

    log: Log
    states: States
    window: Window

    @property
    def t(self) -> Float[Array, " n"]:
        """Times since the start [s]."""
        t = self.log.motion.t[self.window.start : self.window.stop]
        return t - t[0]

    @property
    def read(self) -> Float[Array, "n nv"]:
        """Positions as they were read."""
        return self.states.raw[self.window.start : self.window.stop]


def under_torque(
    shot: Shot, model: Model, torque: Float[Array, "N nv"], nudge: Float[Array, "2 nv"] | None = None
) -> Float[Array, "n nv"]:
    """Readings [rad or m] of the model under the torque that its drives gave.

    Args:
        shot: Where it starts.
        model: What moves.
        torque: See `identification.rollout.drives.given_torque`; of the whole log.
        nudge: Added to position and velocity at the start.

    Raises:
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    window, states = shot.window, shot.states
    lead = min(window.lead, int(np.ceil(model.settles * shot.log.band.rate_hz)))
    rows = slice(window.start - lead, window.stop)
    t, n = shot.log.motion.t[rows], window.stop - window.start + lead
    gains = np.zeros((2, n, model.robot.nv))
    if lead:
        gains[:, :lead] = _pull(model, states.q[window.start])[:, None]
    moved = np.zeros((2, model.robot.nv)) if nudge is None else nudge
    q_ref, v_ref = states.q[rows] + moved[0], states.v[rows] + moved[1]
    none = np.zeros_like(q_ref)
    law = Tracking(t, torque[rows], q_ref, v_ref, gains[0], gains[1], none, np.full(model.robot.nv, np.inf))
    start = true_state(model, states, rows.start, float(t[1] - t[0]), nudge)
    instant = replace(model.robot, torque_hold="instant", torque_source="command")
    return np.array(simulate(instant, model.causes, law, t, *start, max_step=STEP).q[lead:])


def _pull(model: Model, q: Float[Array, " nv"]) -> Float[Array, "2 nv"]:
    """Gains of position and velocity."""
    inertia = np.diag(mass_matrix(model.robot, q[None])[0]).copy()
    speed = np.full(model.robot.nv, _PULL)
    for part in model.transmissions:
        row = row_of(model.robot, part.joint)
        inertia[row], speed[row] = model.robot.rotor_inertia[row], _MOTOR_PULL
    return np.array([speed**2 * inertia, 2.0 * speed * inertia])


def under_control(shot: Shot, model: Model, nudge: Float[Array, "2 nv"] | None = None) -> Float[Array, "n nv"]:
    """Readings [rad or m] of the model under the controllers and references of the recording.

    Args:
        shot: Where it starts.
        model: What moves; its actuators state the controllers.
        nudge: Added to position and velocity at the start.

    Raises:
        LogError: If there are no references.
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    window, states, robot = shot.window, shot.states, model.robot
    if shot.log.q_ref is None:
        raise LogError(f"{shot.log.file} has no references.")
    rows = slice(window.start, window.stop)
    start = true_state(model, states, window.start, 1.0 / shot.log.band.rate_hz, nudge)
    law = control_law(robot, shot.log.motion.t[rows], shot.log.q_ref[rows])
    causes = (*controller_delays(robot), *model.commands, *model.causes)
    plain = replace(robot, torque_source="command")
    return np.array(simulate(plain, causes, law, shot.log.motion.t[rows], *start, max_step=STEP).q)


def controlled(robot: Robot) -> bool:
    """True if the controller of every driven joint is stated, with a gain."""
    driven = [a.controller for a in robot.actuators if a.actuated]
    return bool(driven) and all(controller is not None and controller.kp > 0 for controller in driven)


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
