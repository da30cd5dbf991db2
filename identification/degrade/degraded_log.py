"""Adds effects to a log: computes the log that a cheaper device would have given for the same motion.

The cheaper device is assumed to follow the recorded motion, so that the positions remain the same:

- For effects of friction, load or transmission, the drives give the recorded torque and compensate the torque of each
  effect along the motion, including the internal states of friction, backlash and elastic transmissions.
- Effects of a drive (torque constant, delay, lag) change the commanded torque, and effects of an encoder the readings.
- Only a drive at its torque limit cannot give the same motion. Then the motion is simulated with limited torques
  (`replayed`).

Everything else in the recording, such as noise, remains the same. Effects that depend on the torque of the links use
the torque of the model. Friction follows the sign of the recorded velocity, so that its sign is random at rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from identification.data.derivatives import motion_edge
from identification.data.log import Log
from identification.data.recording import Recording, Table
from identification.data.signals import process_all, smoothed
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, mass_matrix
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.simulated import Simulated
from phantom_dyn.effects.support.displaced import behind_encoder
from phantom_dyn.effects.support.rows import hidden_behind_drive, row_of
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.splines import interpolated
from phantom_dyn.simulation.simulate import Cause, simulate

Values = Mapping[str, tuple[float, ...]]


def degradation(robot: Robot, effect: str, joint: str | None, values: Values) -> Cause:
    """An effect with its joint and parameters, which are checked.

    Args:
        robot: The robot that was recorded.
        effect: Name of the effect in the catalogue.
        joint: Name of a joint, two names joined by ``+``, or None for the whole robot.
        values: Values of each parameter by name; several values if the effect takes lists.

    Raises:
        ParameterError: If effect, joint or a parameter is unknown, missing or out of bounds; the message lists the
            known ones, with units and bounds.
    """
    found = effect_named(effect, robot)
    _require_place(robot, found, joint)
    known, optional = found.parameters(robot, joint), found.optional_parameters(robot, joint)
    names = [parameter.name for parameter in (*known, *optional)]
    for name in values:
        if name not in names:
            raise ParameterError(f"{effect} has no parameter '{name}': {_listed(effect, (*known, *optional))}")
    taken = known if not any(parameter.name in values for parameter in optional) else (*known, *optional)
    theta: list[float] = []
    for parameter in taken:
        given = values.get(parameter.name, None if parameter.default is None else (parameter.default,))
        if given is None:
            raise ParameterError(f"{effect} lacks its parameter {parameter.name}: {_listed(effect, taken)}")
        _require_bounds(effect, parameter, given)
        theta += given
    _require_counts(effect, values, lists=found.takes_lists(robot, joint))
    return Cause(found, joint, np.array(theta))


def _require_place(robot: Robot, effect: Effect, joint: str | None) -> None:
    """Raise an error if the effect is not possible on the joint; the message lists the possible joints."""
    if effect.can_sit(robot, joint):
        return
    places = effect.places(robot)
    if places == (None,):
        raise ParameterError(f"{effect.name} is of the whole robot, not of joint '{joint}': leave the joint out.")
    names = ", ".join(place for place in places if place is not None)
    if not names:
        raise ParameterError(f"{effect.name} has no place on {robot.name} of one joint: choose another effect.")
    where = "no joint was given" if joint is None else f"'{joint}' was given"
    raise ParameterError(f"{effect.name} needs a place and {where}: give one of {names}.")


def _require_bounds(effect: str, parameter: Parameter, given: tuple[float, ...]) -> None:
    """Raise an error if a value of a parameter is out of bounds."""
    for value in given:
        if not (np.isfinite(value) and parameter.lower <= value <= parameter.upper):
            raise ParameterError(
                f"{parameter.name}={value:g} of {effect} is out of bounds: wanted {_words(parameter)}."
            )
        if value == 0 and parameter.above_zero:
            raise ParameterError(f"{parameter.name}=0 of {effect} is out of bounds: wanted a number above 0.")


def _require_counts(effect: str, values: Values, *, lists: bool) -> None:
    """Raise an error if a parameter has several values, or if parameters that are lists have different lengths."""
    counts = {name: len(given) for name, given in values.items()}
    if lists:
        if len(set(counts.values())) > 1:
            given = ", ".join(f"{count} of {name}" for name, count in counts.items())
            raise ParameterError(f"{effect} was given {given}: give as many numbers of each, separated by commas.")
        return
    for name, count in counts.items():
        if count != 1:
            raise ParameterError(f"{name} of {effect} was given {count} numbers: it takes one.")


def _listed(effect: str, parameters: tuple[Parameter, ...]) -> str:
    """A sentence that lists the parameters of an effect, with their bounds."""
    return f"the parameters of {effect} are {', '.join(_words(parameter) for parameter in parameters)}."


def _words(parameter: Parameter) -> str:
    """A parameter with its bounds, as in ``torque [N m] of 0 or more``."""
    low, high = parameter.lower, parameter.upper
    unit = "" if parameter.unit == "1" else f" [{parameter.unit}]"
    if np.isfinite(low) and np.isfinite(high):
        return f"{parameter.name}{unit} from {low:.4g} to {high:.4g}"
    if np.isfinite(low):
        return f"{parameter.name}{unit} of {low:.4g} or more"
    return f"{parameter.name}{unit} of any size"


# Largest torque or position: larger ones are impossible, and their squares overflow.
_MOST = 1e100

# Bandwidth of the critically damped position controller if robot.yaml states none [rad/s].
_BANDWIDTH = 2.0 * np.pi * 4.0
# Longest step [s] of the midpoint rule: for a motion of 10 Hz the error of its phase is at most 0.2 %.
_LONGEST_STEP = 2e-3


@dataclass(frozen=True)
class Degraded:
    """The changed log.

    Attributes:
        columns: Columns under their standard names, in the order of the recording.
        notes: Sentences on columns that were left out, and on effects that a diagnosis cannot find.
    """

    columns: Mapping[str, Float[Array, " N"]]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Change:
    """What is added to quantities of the recording, at the samples of a uniform grid, ``(N, nv)`` each.

    Attributes:
        tau: Change of the commanded drive torque.
        q: Change of the true positions at the encoders.
        v: Change of the true velocities at the encoders.
        x: Change of the true positions of the links.
    """

    tau: Array
    q: Array
    v: Array
    x: Array


def degrade(robot: Robot, table: Table, recording: Recording, faults: tuple[Cause, ...]) -> Degraded:
    """The log that a device with the effects ``faults`` would have given.

    Args:
        robot: The model of the recorded robot.
        table: Columns of the recording.
        recording: The recording that was made from ``table``.
        faults: Effects. Those of torques are applied first, then those of drives in the given order, then those of
            encoders.

    Raises:
        ParameterError: If an effect cannot be seen in any log of this robot, or its parameters give no finite torque.
        LogError: If the recording is too short, or has no torque of a joint whose torque changes.
    """
    laws = tuple(fault.effect.simulated(robot, fault.joint, fault.theta) for fault in faults)
    for fault, law in zip(faults, laws, strict=True):
        _require_trace(robot, fault, law)
    (log,), _ = process_all((recording,), robot)
    for fault in faults:
        _require_time(robot, log, fault)
    change, notes = _change_along_motion(robot, log, faults, laws)
    limits = _torque_limits(robot, faults, laws)
    columns, replay_notes = dict(table.columns), ()
    if np.isfinite(limits).any():
        change, replay_notes = _limited(robot, log, change, limits, columns)
    if not all((np.abs(values) < _MOST).all() for values in (change.tau, change.q)):
        raise ParameterError("With these numbers the torque is not finite: give some that a device can have.")
    notes += replay_notes + _write_torque(robot, table, columns, _at_rows(robot, log, table, change.tau, held=True))
    _write_motion(robot, log, table, columns, change, [law for law in laws if law.reading is not None])
    return Degraded(columns, notes)


def _torque_limits(robot: Robot, faults: tuple[Cause, ...], laws: tuple[Simulated, ...]) -> Float[Array, " nv"]:
    """Smallest torque limit of each joint among the effects; infinite without a limit."""
    limits = np.full(robot.nv, np.inf)
    for fault, law in zip(faults, laws, strict=True):
        if law.limit is not None:
            row = row_of(robot, fault.joint)
            limits[row] = min(limits[row], law.limit)
    return limits


def _require_trace(robot: Robot, fault: Cause, law: Simulated) -> None:
    """Raise an error for an effect that no log of this robot can show."""
    why = None
    if law.command is not None:
        why = hidden_behind_drive(robot, "what the drive makes of its command")
    if law.transmission is not None:
        why = behind_encoder(robot, row_of(robot, fault.joint))
    if why is not None:
        where = "" if fault.joint is None else f" on {fault.joint}"
        raise ParameterError(f"{fault.effect.name}{where} cannot be put into this log: {why}.")


def _require_time(robot: Robot, log: Log, fault: Cause) -> None:
    """Raise an error for a time, such as a delay, that is not shorter than the recording."""
    length = float(log.motion.t[-1] - log.motion.t[0])
    for parameter, value in zip(fault.effect.parameters(robot, fault.joint), fault.theta, strict=False):
        if parameter.unit == "s" and value >= length:
            raise ParameterError(
                f"{parameter.name}={value:g} s of {fault.effect.name} is no shorter than the recording of "
                f"{length:.4g} s: give a shorter one."
            )


def _change_along_motion(
    robot: Robot, log: Log, faults: tuple[Cause, ...], laws: tuple[Simulated, ...]
) -> tuple[_Change, tuple[str, ...]]:
    """Changes of torque and link positions for the recorded motion, and notes on effects that no diagnosis can find."""
    zero = np.zeros_like(log.tau)
    given, tau, x = Operation.of(robot, log.motion, log.tau, log.temperature), zero.copy(), zero.copy()
    notes = []
    pairs = list(zip(faults, laws, strict=True))
    # An effect returns the torque that it adds on the joints. For the same motion the drives have to compensate it.
    for fault, law in pairs:
        why = fault.effect.untestable(robot, given, fault.joint)
        if why is not None:
            notes.append(f"a diagnosis will not see {fault.effect.name} in this log: {why}")
        if law.command is None and law.reading is None:
            changed = replace(given, tau=given.tau + tau, expected=given.tau + tau, logged=log.tau + tau)
            tau = tau - fault.effect.torque(robot, changed, fault.joint, fault.theta)
            ahead = fault.effect.link_ahead(changed, fault.joint, fault.theta)
            x = x if ahead is None else x + ahead
    # The command is computed from the torque of the drive backwards, through the effects of the drive, the last first.
    for fault, law in reversed(pairs):
        if law.command is not None and law.limit is None:
            needed = smoothed(log.tau + tau, log.band.rate_hz, motion_edge(log.band))
            changed = replace(given, tau=needed, expected=needed, logged=needed)
            tau = tau - fault.effect.torque(robot, changed, fault.joint, fault.theta)
    return _Change(tau, zero, zero, x), tuple(notes)


def _limited(
    robot: Robot, log: Log, change: _Change, limits: Array, columns: dict[str, Array]
) -> tuple[_Change, tuple[str, ...]]:
    """Changes if the motion is simulated with limited drive torques, and notes.

    Columns of passive joints are deleted from ``columns``, because the simulated motion moves these joints, too.
    """
    needed = smoothed(log.tau + change.tau, log.band.rate_hz, motion_edge(log.band))
    if not (np.abs(needed) > limits).any():
        return change, ("the recorded motion never needs more torque than the limit: nothing is clipped",)
    q, v, tau = replayed(robot, log.motion, needed, limits)
    error = q - log.motion.q
    passive = [name for name in columns if name.partition(".")[2] in robot.passive_names]
    for name in passive:
        del columns[name]
    notes = (f"{', '.join(passive)} left out: clipped drives move the passive joints too",) if passive else ()
    largest_error, span = np.abs(error).max(axis=0), np.ptp(log.motion.q, axis=0)
    for k in np.flatnonzero(largest_error > 0.5 * span):
        joint, unit = robot.joint_names[k], robot.position_units[k]
        notes += (
            f"with these limits {joint} strays {largest_error[k]:.3g} {unit} from a motion that spans "
            f"{span[k]:.3g} {unit}: give higher ones if it is to be followed",
        )
    return _Change(change.tau + tau - needed, error, v - log.motion.v, change.x + error), notes


def _at_rows(robot: Robot, log: Log, table: Table, values: Array, *, held: bool = False) -> Array:
    """Values of the uniform grid at the times of the recording's rows.

    A torque that the robot holds from one sample to the next (``held``) is the mean of its values at both samples.
    """
    if held and robot.torque_hold == "zoh":
        values = 0.5 * (values + np.vstack([values[1:], values[-1:]]))
    t = table.columns["t"]
    return interpolated(t, log.motion.t, values)


def _write_torque(robot: Robot, table: Table, columns: dict[str, Array], change: Array) -> tuple[str, ...]:
    """Change the columns of torque, current and voltage; a column that cannot be computed is deleted, with a note."""
    notes = []
    for joint, actuator, more in zip(robot.joint_names, robot.actuators, change.T, strict=True):
        names = [f"{quantity}.{joint}" for quantity in ("tau", "i", "u") if f"{quantity}.{joint}" in columns]
        if not more.any():
            continue
        if not names:
            raise LogError(f"{table.file} has no torque of {joint}, which needs another one: add tau.{joint}.")
        per_torque = 1.0 / (actuator.torque_constant * actuator.gear_ratio) if actuator.torque_constant else None
        scales = {
            f"tau.{joint}": 1.0,
            f"i.{joint}": per_torque,
            f"u.{joint}": per_torque * actuator.resistance if per_torque and actuator.resistance else None,
        }
        for name in names:
            scale = scales[name]
            if scale is None:
                del columns[name]
                notes.append(f"{name} left out: the robot states no constants that tell what it would have been")
            else:
                columns[name] = columns[name] + scale * more
    return tuple(notes)


def _write_motion(
    robot: Robot, log: Log, table: Table, columns: dict[str, Array], change: _Change, laws: list[Simulated]
) -> None:
    """Change the columns of positions to those that encoders would read, and velocities and link positions likewise."""
    true = np.column_stack([table.columns[f"q.{joint}"] for joint in robot.joint_names])
    true = true + _at_rows(robot, log, table, change.q)
    read = true
    for law in laws:
        if law.reading is not None:
            read = law.reading(read)
    change_of_v = _at_rows(robot, log, table, change.v) + np.gradient(read - true, table.columns["t"], axis=0)
    change_of_x = _at_rows(robot, log, table, change.x)
    for k, joint in enumerate(robot.joint_names):
        columns[f"q.{joint}"] = read[:, k]
        for name, own in ((f"v.{joint}", change_of_v), (f"x.{joint}", change_of_x)):
            if name in columns:
                columns[name] = columns[name] + own[:, k]


def replayed(
    robot: Robot, motion: Motion, needed: Float[Array, "N nv"], limits: Float[Array, " nv"]
) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Simulated positions, velocities and commanded torques if the drive torques are limited.

    The controller commands the torque that the recorded motion needs, plus feedback of the error from this motion. Its
    gains are those of ``robot.yaml``, or those for a bandwidth of 4 Hz with critical damping. The part of the recorded
    torque that the model does not explain acts on the robot at the same times as in the recording.

    Args:
        robot: The model.
        motion: Recorded motion.
        needed: Drive torque of the recorded motion [N m or N].
        limits: Torque limits of the drives; infinite without a limit.

    Raises:
        ParameterError: If the robot does not follow the recorded motion at all.
    """
    unmodelled = needed - inverse_dynamics(robot, motion)
    kp, kd = _gains(robot, motion)
    start, step, last = float(motion.t[0]), float(np.mean(np.diff(motion.t))), len(motion.t) - 2

    def at(t: float, *tables: Array) -> list[Array]:
        """Rows of tables at a time, by linear interpolation."""
        place = (t - start) / step
        k = min(max(int(place), 0), last)
        share = place - k
        return [(1.0 - share) * table[k] + share * table[k + 1] for table in tables]

    def controller(t: float, q: Array, v: Array) -> Array:
        feedforward, extra, q_ref, v_ref, kp_now, kd_now = at(t, needed, unmodelled, motion.q, motion.v, kp, kd)
        command = feedforward + kp_now * (q_ref - q) + kd_now * (v_ref - v)
        return np.clip(command, -limits, limits) - extra

    instant = replace(robot, torque_hold="instant", torque_source="command")
    try:
        moved = simulate(instant, (), controller, motion.t, motion.q[0], motion.v[0], max_step=_LONGEST_STEP).encoders
    except ParameterError as error:
        sizes = ", ".join(f"{limit:g}" for limit in limits)
        raise ParameterError(
            f"With torque limits of {sizes} the robot does not follow the recorded motion at all: give higher ones."
        ) from error
    commanded = needed + kp * (motion.q - moved.q) + kd * (motion.v - moved.v)
    return moved.q, moved.v, commanded


def _gains(robot: Robot, motion: Motion) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Gains ``kp`` and ``kd`` of the position controllers at every sample."""
    inertia = np.einsum("njj->nj", mass_matrix(robot, motion.q))
    kp, kd = _BANDWIDTH**2 * inertia, 2.0 * _BANDWIDTH * inertia
    for k, actuator in enumerate(robot.actuators):
        if actuator.controller is not None:
            kp[:, k], kd[:, k] = actuator.controller.kp, actuator.controller.kd
    return kp, kd
