"""The log that a cheaper device would have given.

The hand, or the controller, moves the cheaper device as it moved the recorded one, so that positions stay and the drive
gives what this motion then needs: the recorded torque and what each effect takes more along the recorded motion
(hidden states of bristles, plays and elastic transmissions included). What the recording holds beyond the model, noise
included, stays. An effect of the drive (torque constant, delay, lag) changes what has to be asked for, one of the
encoder what is read. Only a drive at its limit cannot give the same motion: then the recording is played again with
clipped drives (`replayed`).

Laws that need the torque on the links take the model's. Friction follows the sign of the recorded velocity, so on a
joint that is held its torque has the sign of noise.
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
    """An effect in its place, checked.

    Args:
        robot: The robot that was recorded.
        effect: Name of the catalogue.
        joint: Joint, two joints joined by ``+``, or None for the whole robot.
        values: Numbers of each parameter by name; several of one name for an effect that takes lists.

    Raises:
        ParameterError: If effect, joint or a parameter is unknown, missing or out of bounds; the text lists what there
            is, with units and bounds.
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
    places = effect.places(robot)
    if effect.can_sit(robot, joint):
        return
    if places == (None,):
        raise ParameterError(f"{effect.name} is of the whole robot, not of joint '{joint}': leave the joint out.")
    names = ", ".join(place for place in places if place is not None)
    if not names:
        raise ParameterError(f"{effect.name} has no place on {robot.name} of one joint: choose another effect.")
    where = "no joint was given" if joint is None else f"'{joint}' was given"
    raise ParameterError(f"{effect.name} needs a place and {where}: give one of {names}.")


def _require_bounds(effect: str, parameter: Parameter, given: tuple[float, ...]) -> None:
    for value in given:
        if not (np.isfinite(value) and parameter.lower <= value <= parameter.upper):
            raise ParameterError(
                f"{parameter.name}={value:g} of {effect} is out of bounds: wanted {_words(parameter)}."
            )
        if value == 0 and parameter.above_zero:
            raise ParameterError(f"{parameter.name}=0 of {effect} is out of bounds: wanted a number above 0.")


def _require_counts(effect: str, values: Values, *, lists: bool) -> None:
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


# Torques and positions beyond it are no device's, and overflow when squared.
_MOST = 1e100

# How fast a position controller takes out an error, where robot.yaml states none [rad/s]; critically damped.
_BANDWIDTH = 2.0 * np.pi * 4.0
# Steps [s] of the midpoint rule: at 10 Hz it has the phase right to 0.2 %.
_LONGEST_STEP = 2e-3


@dataclass(frozen=True)
class Degraded:
    """Columns of the log, and what its user should know.

    Attributes:
        columns: Under their standard names, in the order of the recording.
        notes: Sentences: columns that were left out, effects that leave no trace.
    """

    columns: Mapping[str, Float[Array, " N"]]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Change:
    """Changes of the recording at the samples of a uniform grid, shape ``(N, nv)`` each.

    Attributes:
        tau: Drive torque that is asked for.
        q: True positions at the encoders.
        v: True velocities there.
        x: True positions of the links.
    """

    tau: Array
    q: Array
    v: Array
    x: Array


def degrade(robot: Robot, table: Table, recording: Recording, faults: tuple[Cause, ...]) -> Degraded:
    """The log that a device with ``faults`` would have given.

    Args:
        robot: The model of the recorded robot.
        table: The recording's columns.
        recording: The same for the joints of the robot.
        faults: Torques act first, then drives, in the given order from the controller on, then encoders.

    Raises:
        ParameterError: If an effect would leave no trace in any such log, or its numbers give no finite torque.
        LogError: If the recording is too short, or has no torque of a joint that needs another one.
    """
    laws = tuple(fault.effect.simulated(robot, fault.joint, fault.theta) for fault in faults)
    for fault, law in zip(faults, laws, strict=True):
        _require_trace(robot, fault, law)
    (log,), _ = process_all((recording,), robot)
    for fault in faults:
        _require_time(robot, log, fault)
    change, notes = _motion_kept(robot, log, faults, laws)
    limits = np.full(robot.nv, np.inf)
    for fault, law in zip(faults, laws, strict=True):
        if law.limit is not None:
            row = row_of(robot, fault.joint)
            limits[row] = min(limits[row], law.limit)
    columns, replay_notes = dict(table.columns), ()
    if np.isfinite(limits).any():
        change, replay_notes = _limited(robot, log, change, limits, columns)
    if not all((np.abs(values) < _MOST).all() for values in (change.tau, change.q)):
        raise ParameterError("With these numbers the torque is not finite: give some that a device can have.")
    notes += replay_notes + _write_torque(robot, table, columns, _at_rows(robot, log, table, change.tau, held=True))
    _write_motion(robot, log, table, columns, change, [law for law in laws if law.reading is not None])
    return Degraded(columns, notes)


def _require_trace(robot: Robot, fault: Cause, law: Simulated) -> None:
    """Refuse what no log of this robot can show."""
    why = None
    if law.command is not None:
        why = hidden_behind_drive(robot, "what the drive makes of its command")
    if law.transmission is not None:
        why = behind_encoder(robot, row_of(robot, fault.joint))
    if why is not None:
        where = "" if fault.joint is None else f" on {fault.joint}"
        raise ParameterError(f"{fault.effect.name}{where} cannot be put into this log: {why}.")


def _require_time(robot: Robot, log: Log, fault: Cause) -> None:
    """Refuse a drive that is later than the recording is long."""
    length = float(log.motion.t[-1] - log.motion.t[0])
    for parameter, value in zip(fault.effect.parameters(robot, fault.joint), fault.theta, strict=False):
        if parameter.unit == "s" and value >= length:
            raise ParameterError(
                f"{parameter.name}={value:g} s of {fault.effect.name} is no shorter than the recording of "
                f"{length:.4g} s: give a shorter one."
            )


def _motion_kept(
    robot: Robot, log: Log, faults: tuple[Cause, ...], laws: tuple[Simulated, ...]
) -> tuple[_Change, tuple[str, ...]]:
    """Additional torque that the recorded motion takes with the faults, and link positions ahead of the motors."""
    still = np.zeros_like(log.tau)
    model, tau, x = Operation.of(robot, log.motion, log.tau, log.temperature), still.copy(), still.copy()
    notes = []
    pairs = list(zip(faults, laws, strict=True))
    for fault, law in pairs:
        why = fault.effect.untestable(robot, model, fault.joint)
        if why is not None:
            notes.append(f"a diagnosis will not see {fault.effect.name} in this log: {why}")
        if law.command is None and law.reading is None:
            now = replace(model, tau=model.tau + tau, expected=model.tau + tau, logged=log.tau + tau)
            tau = tau - fault.effect.torque(robot, now, fault.joint, fault.theta)
            ahead = fault.effect.link_ahead(now, fault.joint, fault.theta)
            x = x if ahead is None else x + ahead
    # What the drive has to be asked for: the last of its effects is undone first.
    for fault, law in reversed(pairs):
        if law.command is not None and law.limit is None:
            asked = smoothed(log.tau + tau, log.band.rate_hz, motion_edge(log.band))
            now = replace(model, tau=asked, expected=asked, logged=asked)
            tau = tau - fault.effect.torque(robot, now, fault.joint, fault.theta)
    return _Change(tau, still, still, x), tuple(notes)


def _limited(
    robot: Robot, log: Log, change: _Change, limits: Array, columns: dict[str, Array]
) -> tuple[_Change, tuple[str, ...]]:
    """The recording played again with clipped drives; columns of passive joints, which then move too, are left out."""
    asked = smoothed(log.tau + change.tau, log.band.rate_hz, motion_edge(log.band))
    if not (np.abs(asked) > limits).any():
        return change, ("the recorded motion never needs more torque than the limit: nothing is clipped",)
    q, v, tau = replayed(robot, log.motion, asked, limits)
    moved = q - log.motion.q
    passive = [name for name in columns if name.partition(".")[2] in robot.passive_names]
    for name in passive:
        del columns[name]
    notes = (f"{', '.join(passive)} left out: clipped drives move the passive joints too",) if passive else ()
    astray, width = np.abs(moved).max(axis=0), np.ptp(log.motion.q, axis=0)
    for k in np.flatnonzero(astray > 0.5 * width):
        joint, unit = robot.joint_names[k], robot.position_units[k]
        notes += (
            f"with these limits {joint} strays {astray[k]:.3g} {unit} from a motion that spans {width[k]:.3g} {unit}: "
            "give higher ones if it is to be followed",
        )
    return _Change(change.tau + tau - asked, moved, v - log.motion.v, change.x + moved), notes


def _at_rows(robot: Robot, log: Log, table: Table, values: Array, *, held: bool = False) -> Array:
    """Values of the uniform grid at the rows of the recording; a held torque is the mean until the next sample."""
    if held and robot.torque_hold == "zoh":
        values = 0.5 * (values + np.vstack([values[1:], values[-1:]]))
    t = table.columns["t"]
    return interpolated(t, log.motion.t, values)


def _write_torque(robot: Robot, table: Table, columns: dict[str, Array], change: Array) -> tuple[str, ...]:
    """Torque, current and voltage of every joint; a column that cannot be brought in line is left out."""
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
    """Positions as they would be read, and the velocities and link positions that go with them."""
    true = np.column_stack([table.columns[f"q.{joint}"] for joint in robot.joint_names])
    true = true + _at_rows(robot, log, table, change.q)
    read = true
    for law in laws:
        if law.reading is not None:
            read = law.reading(read)
    faster = _at_rows(robot, log, table, change.v) + np.gradient(read - true, table.columns["t"], axis=0)
    farther = _at_rows(robot, log, table, change.x)
    for k, joint in enumerate(robot.joint_names):
        columns[f"q.{joint}"] = read[:, k]
        for quantity, more in (("v", faster), ("x", farther)):
            name = f"{quantity}.{joint}"
            if name in columns:
                columns[name] = columns[name] + more[:, k]


def replayed(
    robot: Robot, motion: Motion, needed: Float[Array, "N nv"], limits: Float[Array, " nv"]
) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Positions, velocities, and the torque that was asked for, when drives give no more than ``limits``.

    The controller asks for the torque that the recorded motion needs, and for what its gains make of the error to that
    motion: those of ``robot.yaml``, or 4 Hz with critical damping. What the recording needs beyond the model acts on
    the robot at the same times as it did.

    Args:
        robot: The model.
        motion: Recorded motion.
        needed: Drive torque of the recorded motion [N m or N].
        limits: Torque limits of the drives; infinite where they have none.

    Raises:
        ParameterError: If the robot falls out of the motion altogether.
    """
    unmodelled = needed - inverse_dynamics(robot, motion)
    kp, kd = _gains(robot, motion)
    start, step, last = float(motion.t[0]), float(np.mean(np.diff(motion.t))), len(motion.t) - 2

    def at(t: float, *tables: Array) -> list[Array]:
        place = (t - start) / step
        k = min(max(int(place), 0), last)
        share = place - k
        return [(1.0 - share) * table[k] + share * table[k + 1] for table in tables]

    def controller(t: float, q: Array, v: Array) -> Array:
        wanted, extra, q_ref, v_ref, stiff, damped = at(t, needed, unmodelled, motion.q, motion.v, kp, kd)
        return np.clip(wanted + stiff * (q_ref - q) + damped * (v_ref - v), -limits, limits) - extra

    instant = replace(robot, torque_hold="instant", torque_source="command")
    try:
        moved = simulate(instant, (), controller, motion.t, motion.q[0], motion.v[0], max_step=_LONGEST_STEP).encoders
    except ParameterError as error:
        sizes = ", ".join(f"{limit:g}" for limit in limits)
        raise ParameterError(
            f"With torque limits of {sizes} the robot does not follow the recorded motion at all: give higher ones."
        ) from error
    asked = needed + kp * (motion.q - moved.q) + kd * (motion.v - moved.v)
    return moved.q, moved.v, asked


def _gains(robot: Robot, motion: Motion) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Gains of the position controllers at every sample."""
    inertia = np.einsum("njj->nj", mass_matrix(robot, motion.q))
    kp, kd = _BANDWIDTH**2 * inertia, 2.0 * _BANDWIDTH * inertia
    for k, actuator in enumerate(robot.actuators):
        if actuator.controller is not None:
            kp[:, k], kd[:, k] = actuator.controller.kp, actuator.controller.kd
    return kp, kd
