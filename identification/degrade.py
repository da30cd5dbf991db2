"""The log that a cheaper device would have given.

The hand, or the controller, moves the cheaper device as it moved the recorded one, so that positions stay and the drive
gives what this motion then needs: the recorded torque and what each effect takes more along the recorded motion
(hidden states of bristles, plays and elastic transmissions included). What the recording holds beyond the model, noise
included, stays. An effect of the drive (torque constant, delay, lag) changes what has to be asked for, one of the
encoder what is read. Only a drive at its limit cannot give the same motion: the recording is played again by
`identification.replay`, with the drive clipped.

Laws that need the torque on the links take the model's. Friction follows the sign of the recorded velocity, so on a
joint that is held its torque has the sign of noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identification.degradation import Degradation
from identification.log import Log
from identification.recordings import Recording, Table
from identification.replay import replayed
from identification.signals import motion_edge, process_all, smoothed
from phantom_dyn.effects.backlash import Backlash, play
from phantom_dyn.effects.displaced import behind_encoder, load_and_inertia
from phantom_dyn.effects.effect import Simulated
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rows import hidden_behind_drive, row_of
from phantom_dyn.effects.torque_saturation import TorqueSaturation
from phantom_dyn.effects.transmission_compliance import TransmissionCompliance, swing
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.robot import Robot

Array = np.ndarray

# Torques and positions beyond it are no device's, and overflow when squared.
_MOST = 1e100


@dataclass(frozen=True)
class Degraded:
    """Columns of the log, and what its user should know.

    Attributes:
        columns: Under the contract's names, in the order of the recording.
        notes: Sentences: columns that were left out, effects that leave no trace.
    """

    columns: Mapping[str, Float[Array, " N"]]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Change:
    """What differs from the recording, at the samples of a uniform grid, shape ``(N, nv)`` each.

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


def degrade(robot: Robot, table: Table, recording: Recording, faults: tuple[Degradation, ...]) -> Degraded:
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
    parts = tuple(fault.effect.simulated(robot, fault.joint, np.array(fault.theta)) for fault in faults)
    for fault, part in zip(faults, parts, strict=True):
        _require_trace(robot, fault, part)
    (log,), _ = process_all((recording,), robot)
    for fault in faults:
        _require_time(robot, log, fault)
    change, notes = _motion_kept(robot, log, faults, parts)
    limits = np.full(robot.nv, np.inf)
    for fault in faults:
        if isinstance(fault.effect, TorqueSaturation):
            row = row_of(robot, fault.joint)
            limits[row] = min(limits[row], fault.theta[0])
    columns, replay_notes = dict(table.columns), ()
    if np.isfinite(limits).any():
        change, replay_notes = _limited(robot, log, change, limits, columns)
    if not all((np.abs(values) < _MOST).all() for values in (change.tau, change.q)):
        raise ParameterError("With these numbers the torque is not finite: give some that a device can have.")
    notes += replay_notes + _write_torque(robot, table, columns, _at_rows(robot, log, table, change.tau, held=True))
    _write_motion(robot, log, table, columns, change, [part for part in parts if part.reading is not None])
    return Degraded(columns, notes)


def _require_trace(robot: Robot, fault: Degradation, part: Simulated) -> None:
    """Refuse what no log of this robot can show."""
    why = None
    if part.command is not None:
        why = hidden_behind_drive(robot, "what the drive makes of its command")
    if part.transmission is not None:
        why = behind_encoder(robot, row_of(robot, fault.joint))
    if why is not None:
        where = "" if fault.joint is None else f" on {fault.joint}"
        raise ParameterError(f"{fault.effect.name}{where} cannot be put into this log: {why}.")


def _require_time(robot: Robot, log: Log, fault: Degradation) -> None:
    """Refuse a drive that is later than the recording is long."""
    length = float(log.motion.t[-1] - log.motion.t[0])
    for parameter, value in zip(fault.effect.parameters(robot, fault.joint), fault.theta, strict=False):
        if parameter.unit == "s" and value >= length:
            raise ParameterError(
                f"{parameter.name}={value:g} s of {fault.effect.name} is no shorter than the recording of "
                f"{length:.4g} s: give a shorter one."
            )


def _motion_kept(
    robot: Robot, log: Log, faults: tuple[Degradation, ...], parts: tuple[Simulated, ...]
) -> tuple[_Change, tuple[str, ...]]:
    """Torque that the recorded motion takes more."""
    still = np.zeros_like(log.tau)
    model, tau, x = Operation.of(robot, log.motion, log.tau), still.copy(), still.copy()
    notes = []
    pairs = list(zip(faults, parts, strict=True))
    for fault, part in pairs:
        why = fault.effect.untestable(robot, model, fault.joint)
        if why is not None:
            notes.append(f"a diagnosis will not see {fault.effect.name} in this log: {why}")
        if part.command is None and part.reading is None:
            now = replace(model, tau=model.tau + tau, expected=model.tau + tau, logged=log.tau + tau)
            tau = tau - fault.effect.torque(robot, now, fault.joint, np.array(fault.theta))
            x = x + _link_ahead(robot, now, fault)
    # What the drive has to be asked for: the last of its effects is undone first.
    for fault, part in reversed(pairs):
        if part.command is not None and not isinstance(fault.effect, TorqueSaturation):
            asked = smoothed(log.tau + tau, log.band.rate_hz, motion_edge(log.band))
            now = replace(model, tau=asked, expected=asked, logged=asked)
            tau = tau - fault.effect.torque(robot, now, fault.joint, np.array(fault.theta))
    return _Change(tau, still, still, x), tuple(notes)


def _link_ahead(robot: Robot, operation: Operation, fault: Degradation) -> Array:
    """How far a link is ahead of its motor [rad or m]."""
    out = np.zeros_like(operation.q)
    if isinstance(fault.effect, Backlash | TransmissionCompliance):
        row = row_of(robot, fault.joint)
        if isinstance(fault.effect, Backlash):
            load, inertia = load_and_inertia(operation, row)
            out[:, row] = -play(operation.t, load / inertia, fault.theta[0]).lead
        else:
            out[:, row] = swing(operation, row, fault.theta[0])[0]
    return out


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
    return np.column_stack([np.interp(t, log.motion.t, column) for column in values.T])


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
    robot: Robot, log: Log, table: Table, columns: dict[str, Array], change: _Change, parts: list[Simulated]
) -> None:
    """Positions as they would be read, and the velocities and link positions that go with them."""
    true = np.column_stack([table.columns[f"q.{joint}"] for joint in robot.joint_names])
    true = true + _at_rows(robot, log, table, change.q)
    read = true
    for part in parts:
        if part.reading is not None:
            read = part.reading(read)
    faster = _at_rows(robot, log, table, change.v) + np.gradient(read - true, table.columns["t"], axis=0)
    farther = _at_rows(robot, log, table, change.x)
    for k, joint in enumerate(robot.joint_names):
        columns[f"q.{joint}"] = read[:, k]
        for quantity, more in (("v", faster), ("x", farther)):
            name = f"{quantity}.{joint}"
            if name in columns:
                columns[name] = columns[name] + more[:, k]
