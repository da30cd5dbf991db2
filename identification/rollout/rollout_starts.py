"""Windows and initial states of rollouts (multiple shooting), and simulations of a model from an initial state.

Windows are short stretches of the samples on which models are compared (the judged samples). States are smoothed over
neighbouring samples; their standard deviations are those of the remaining encoder noise. A simulation moves freely
under a torque, or follows the recording by additional feedback.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.data.derivatives import differentiate, motion_edge
from identification.data.floating.base_errors import base_without_errors
from identification.data.log import Log
from identification.data.signals import low_pass
from identification.diagnosis.columns.motion.soft_friction import softness
from identification.engine.products.blocks import Block
from identification.rollout.simulated_models import Model
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.dynamics.dynamics import link_torque, mass_matrix
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion, Motion
from phantom_dyn.signals.splines import interpolated
from phantom_dyn.simulation.control import Tracking
from phantom_dyn.simulation.simulate import Cause, Given, Simulation, simulate

SHORTEST = 2e-5  # shortest step [s]: with shorter ones a rollout would take too long
STEP = 1e-3  # longest step [s]: the midpoint rule follows a 20 Hz motion with a phase error of 0.2 %
# Natural frequency [rad/s] of the critically damped feedback by which a model follows the recording.
_FEEDBACK_FREQUENCY = 2.0 * np.pi * 15.0
# Natural frequency [rad/s] for a motor behind a spring or backlash: it is higher, because the motor's inertia is small.
_MOTOR_FEEDBACK_FREQUENCY = 2.0 * np.pi * 60.0
_WINDOW = 50  # number of samples over which scatter is estimated
_LEAST = 1e-9  # smallest standard deviation of a state [rad or m]: rounding of the readings in files
_READING_STEP = 1e-4  # step of finite differences of an encoder's reading by the position [rad or m]
_ITERATIONS = 6  # number of fixed-point steps from a reading to the position; the slope of a reading is close to one
_LEAST_ROWS = 3  # smallest number of samples of a window
_SHORTEST_SWING = 0.08  # [s]: a shorter swing of a leg is a flickering contact


@dataclass(frozen=True)
class States:
    """Smoothed encoder readings of one log.

    Attributes:
        q: Positions [rad or m], ``(N, nv)``.
        v: Velocities, ``(N, nv)``.
        a: Accelerations, ``(N, nv)``.
        raw: Raw readings of the positions, ``(N, nv)``.
        q_std: Standard deviation of the noise of each joint's ``q``, ``(nv,)``.
        v_std: Standard deviation of the noise of each joint's ``v``, ``(nv,)``.
        read_std: Standard deviation of the part of ``raw`` that smoothing removes, ``(nv,)``.
        scatter: Like ``read_std``, but in the quietest fifth of short stretches, without stops and impacts.
        base: Motion of the base; None for a fixed one.
    """

    q: Float[Array, "N nv"]
    v: Float[Array, "N nv"]
    a: Float[Array, "N nv"]
    raw: Float[Array, "N nv"]
    q_std: Float[Array, " nv"]
    v_std: Float[Array, " nv"]
    read_std: Float[Array, " nv"]
    scatter: Float[Array, " nv"]
    base: BaseMotion | None = None


def states_of(log: Log, cutoff_hz: float) -> States:
    """States of a log: its positions after a low pass without delay, whose edge is above the judged band.

    The part of the readings that the low pass removes counts as white noise. Its density gives the noise that remains.

    Args:
        log: A recording.
        cutoff_hz: Edge of the judged band [Hz].
    """
    rate = log.band.rate_hz
    raw = log.motion.q if log.raw_q is None else log.raw_q
    edge = motion_edge(low_pass(cutoff_hz, rate))
    q, v, a = differentiate(raw, rate, edge)
    rough = (raw - q)[log.valid]
    removed = (rough**2).mean(axis=0)
    density = removed / max(0.5 * rate - edge, 1e-9)  # per Hz
    q_std, v_std = np.sqrt(density * edge), 2.0 * np.pi * np.sqrt(density * edge**3 / 3.0)
    deviations = (np.maximum(std, _LEAST) for std in (q_std, v_std, np.sqrt(removed), _quiet(rough)))
    return States(q, v, a, raw, *deviations, base=log.motion.base)


def _quiet(rough: Float[Array, "N nv"]) -> Float[Array, " nv"]:
    """Root mean square in the quietest fifth of short windows: the noise of readings without stops and impacts."""
    count = max(len(rough) // _WINDOW, 1)
    windows = np.array_split(rough, count)
    return np.percentile([np.sqrt(np.mean(window**2, axis=0)) for window in windows], 20, axis=0)


@dataclass(frozen=True)
class Start:
    """A state of links and motors, ``(nv,)`` each; both are equal if a motor is rigidly coupled to its link.

    Attributes:
        q: Positions of the links [rad or m].
        v: Velocities of the links.
        motor_q: Positions of the motors, on the joint side [rad or m].
        motor_v: Velocities of the motors.
    """

    q: Float[Array, " nv"]
    v: Float[Array, " nv"]
    motor_q: Float[Array, " nv"]
    motor_v: Float[Array, " nv"]


def true_state(
    model: Model, states: States, at: int, dt: float, start_shift: Float[Array, "2 nv"] | None = None
) -> Start:
    """State of a model for which its encoders return the recorded readings.

    The deflection of a spring or of backlash between link and motor follows from the torque that moves the link.

    Args:
        model: The model; without effects on readings or transmissions, the state is the recorded one.
        states: Recorded states.
        at: Index of the sample.
        dt: Sampling time [s].
        start_shift: Shift that is added to position and velocity.
    """
    readings = [part.reading for part in model.simulated_causes if part.reading is not None]
    shift = np.zeros((2, model.robot.nv)) if start_shift is None else start_shift
    q, v = states.q[at] + shift[0], states.v[at] + shift[1]

    def read(x: Array) -> Array:
        for reading in readings:
            x = reading(x)
        return x

    true_q, true_v = np.array(q), np.array(v)
    for _ in range(_ITERATIONS if readings else 0):
        true_q = true_q + q - read(true_q)
    if readings:
        slope = (read(true_q + _READING_STEP) - read(true_q - _READING_STEP)) / (2.0 * _READING_STEP)
        true_v = v / np.maximum(slope, 0.5)
    start = Start(true_q, true_v, np.array(true_q), np.array(true_v))
    if model.transmissions:
        _deflect(start, model, states, at, dt)
    return start


def _deflect(start: Start, model: Model, states: States, at: int, dt: float) -> None:
    """Shift, in place, the side of each transmission that no encoder reads, by the deflection under the load."""
    near = np.clip([at - 1, at, at + 1], 0, len(states.q) - 1)
    base = None if states.base is None else states.base.at(near)
    nearby_motion = Motion(dt * near, states.q[near], states.v[near], states.a[near], base=base)
    load = link_torque(model.robot, nearby_motion)
    rate = (load[2] - load[0]) / (dt * max(near[2] - near[0], 1))
    for part in model.transmissions:
        row = row_of(model.robot, part.joint)
        # Without a rotor the spring has no stiffness; the simulation then raises an error.
        if part.stiffness > 0:
            # A link lags its motor, and a motor leads its link.
            read_on_motor = model.robot.actuators[row].encoder_side == "motor"
            position, speed = (start.q, start.v) if read_on_motor else (start.motor_q, start.motor_v)
            sign = -1.0 if read_on_motor else 1.0
            position[row] += sign * (load[1, row] / part.stiffness + 0.5 * part.gap * np.sign(load[1, row]))
            speed[row] += sign * rate[row] / part.stiffness


@dataclass(frozen=True)
class Window:
    """A stretch of samples of a log that is simulated.

    Attributes:
        log: Index of the log.
        start: Index of the first sample, at the full rate.
        stop: Index after the last sample.
        fold: Fold that these samples belong to; -1 if they are in no fit.
        lead: Number of valid samples before the start that may be used to estimate hidden states.
        joints: Joints that are compared, such as those of a swinging leg; None for all.
    """

    log: int
    start: int
    stop: int
    fold: int
    lead: int
    joints: tuple[int, ...] | None = None


def windows_in(
    logs: tuple[Log, ...],
    blocks: tuple[Block, ...],
    folds: Int[Array, " B"],
    judged: Int[Array, " k"],
    *,
    seconds: float,
    lead: float,
) -> tuple[Window, ...]:
    """As many windows as fit into the judged blocks without overlap; for legged robots inside the swings of each leg.

    Args:
        logs: Recordings.
        blocks: Stretches of samples that are held out together.
        folds: Fold of each block.
        judged: Indices of the judged blocks.
        seconds: Length of a window [s]; a shorter block or swing is one window.
        lead: Time before a window that the estimate of hidden states needs [s].
    """
    out = []
    for k in judged:
        block = blocks[k]
        log = logs[block.log]
        samples, rate = log.samples, log.band.rate_hz
        # From the core on: the samples before it share noise with the previous block.
        for joints, first, stop in _free_stretches(log, int(samples[block.core]), int(samples[block.stop - 1]) + 1):
            length = min(max(_LEAST_ROWS, round(seconds * rate) + 1), stop - first)
            if length < _LEAST_ROWS:
                continue
            # The windows are centred in the stretch.
            count = (stop - first) // length
            margin = (stop - first - count * length) // 2
            for i in range(count):
                start = first + margin + i * length
                window = Window(block.log, start, start + length, int(folds[k]), 0, joints)
                out.append(window_at(logs, window, lead))
    return tuple(window for window in out if window is not None)


def _free_stretches(log: Log, first: int, stop: int) -> list[tuple[tuple[int, ...] | None, int, int]]:
    """Stretches of a range of samples in which a leg swings: joints of the leg, first sample, sample after the last.

    A robot without contacts has one stretch, with None for all joints.
    """
    if log.touched is None or not log.touched[first:stop].any():
        return [(None, first, stop)]
    patterns, leg_of = np.unique(log.touched[first:stop].T, axis=0, return_inverse=True)
    out = []
    for leg, touched in enumerate(patterns):
        joints = tuple(np.flatnonzero(leg_of == leg).tolist())
        edges = first + np.flatnonzero(np.diff(np.concatenate([[True], touched, [True]])))
        swings = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        out += [(joints, start, end) for start, end in swings if end - start >= _SHORTEST_SWING * log.band.rate_hz]
    return out


def spread(windows: tuple[Window, ...], count: int) -> tuple[Window, ...]:
    """At most ``count`` windows, evenly spread, with the same number for each leg."""
    legs = list(dict.fromkeys(window.joints for window in windows))
    most, out = max(1, count // max(len(legs), 1)), []
    for leg in legs:
        own = [window for window in windows if window.joints == leg]
        out += own if len(own) <= most else [own[i] for i in np.linspace(0, len(own) - 1, most).round().astype(int)]
    return tuple(out)


def window_at(logs: tuple[Log, ...], window: Window, lead: float) -> Window | None:
    """The window with the number of usable samples before it, at most ``lead`` seconds; None if a sample is invalid."""
    log, start = logs[window.log], window.start
    if not log.valid[start : window.stop].all():
        return None
    wanted = min(round(lead * log.band.rate_hz), start)
    before = slice(start - wanted, start)
    unusable = ~log.valid[before]
    if window.joints is not None and log.touched is not None:
        unusable = unusable | log.touched[before][:, list(window.joints)].any(axis=1)
    last = int(np.flatnonzero(unusable).max(initial=-1))
    return replace(window, lead=wanted - 1 - last)


def exerted_torque(model: Model, t: Float[Array, " N"], tau: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Torque [N m or N] that the drives exert if ``tau`` is commanded: after the log's delay and the drives' effects.

    Args:
        model: The model, with the effects of its drives and the timing of the log.
        t: Times [s], in equal steps.
        tau: Commanded torque.
    """
    out = np.array(tau, dtype=float)
    if model.late:
        dt = (t[-1] - t[0]) / (len(t) - 1)
        out = interpolated(t - model.late * dt, t, out)
    for drive in model.simulated_commands:
        out = drive.given(t, out)
    return out


def acting_torque(model: Model, log: Log) -> Float[Array, "N nv"]:
    """Torque [N m or N] of a model's drives over a recording, plus that of measured external forces.

    The recorded torque is changed in three more ways if the model says so: the controller's references are delayed
    (``late_references``); they arrive later within the controller's period (``arrivals``); or the modelled dry friction
    changes sign gradually (``soft``).
    """
    tau = log.tau
    if model.late_references is not None and log.references is not None:
        rows = [log.references.later(float(delay), (row,)) for row, delay in enumerate(model.late_references)]
        tau = tau + np.hstack(rows)
    if model.arrivals:
        tau = tau + log.later_references(model.arrivals)
    out = exerted_torque(model, log.motion.t, tau) + (0.0 if log.external is None else log.external)
    for joint, share in model.soft:
        out -= share * softness(model.robot, log.motion, joint)
    return out


def base_of(model: Model, log: Log, rows: slice) -> BaseMotion | None:
    """Motion of a model's base over some samples; None for a fixed base."""
    return base_without_errors(model.robot, log, rows, model.base)


def simulated(
    robot: Robot,
    causes: tuple[Cause, ...],
    law: Tracking,
    start: Start,
    base: BaseMotion | None = None,
    *,
    max_step: float = STEP,
) -> Simulation:
    """A simulation from an initial state, at the times of the drives' law.

    Args:
        robot: The robot.
        causes: Effects in addition to the rigid-body model.
        law: Torque law of the drives, with its times.
        start: Initial state of links and motors.
        base: Motion of the base; None for a fixed one.
        max_step: Longest step [s].

    Raises:
        ParameterError: If the motion leaves all bounds, or a motor without inertia would have to move by itself.
    """
    given = Given((start.motor_q, start.motor_v), base)
    return simulate(robot, causes, law, law.t, start.q, start.v, max_step=max_step, given=given)


def simulated_with_torque(model: Model, law: Tracking, start: Start, base: BaseMotion | None) -> Simulation:
    """A simulation of a model whose drives exert exactly the torque of the law."""
    return simulated(model.torque_driven, model.causes, law, start, base)


def feedback_gains(model: Model, q: Float[Array, " nv"]) -> Float[Array, "2 nv"]:
    """Position and velocity gains of the feedback by which a simulation follows the recording.

    They are zero if the encoder is on a link behind a spring or backlash, because feedback through the motor would be
    unstable.
    """
    inertia = np.diag(mass_matrix(model.robot, q[None])[0]).copy()
    speed = np.full(model.robot.nv, _FEEDBACK_FREQUENCY)
    for part in model.transmissions:
        row = row_of(model.robot, part.joint)
        on_motor = model.robot.actuators[row].encoder_side == "motor"
        inertia[row], speed[row] = model.robot.rotor_inertia[row], _MOTOR_FEEDBACK_FREQUENCY if on_motor else 0.0
    return np.array([speed**2 * inertia, 2.0 * speed * inertia])


def feedback_law(
    t: Float[Array, " n"],
    torque: Float[Array, "n nv"],
    q: Float[Array, "n nv"],
    v: Float[Array, "n nv"],
    gains: Float[Array, "2 nv"],
    where: Bool[Array, "n nv"],
) -> Tracking:
    """Torque law: the given torque, plus feedback towards ``q`` and ``v`` where the mask ``where`` is True."""
    tables = gains[:, None] * where
    return Tracking(
        t=t,
        feedforward=torque,
        q_ref=q,
        v_ref=v,
        kp=tables[0],
        kd=tables[1],
        extra=np.zeros_like(q),
        limits=np.full(q.shape[1], np.inf),
    )
