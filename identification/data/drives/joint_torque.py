# pyright: reportAttributeAccessIssue=false
"""Computes the torque of every joint from the recorded torque, current or voltage of its drive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from identification.data.drive_loop import DriveLoop, drive_loop
from identification.data.mending import mended_position
from identification.data.readers.contract_columns import FRAME_AXES, MEANT
from identification.data.recording import Table
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.dynamics.kinematics import wrench_torque
from phantom_dyn.errors import LogError, known_names, listed
from phantom_dyn.model.robot import Actuator, Robot
from phantom_dyn.motion import side_by_side

# Relative growth of copper's resistance per kelvin.
_COPPER = 0.00393
# Smallest relative growth of the resistance that is reported: data sheets are not more precise.
_REPORTED = 0.01
# Largest duty cycle, with rounding.
_LARGEST_DUTY = 1.0 + 1e-6
# Number of samples from the middle of a long recording with which a position controller is estimated.
_ROWS = 60000


class NoTorqueError(LogError):
    """No joint has a torque, nor a current or voltage from which it could be computed."""


def _torque_per_ampere(table: Table, joint: str, actuator: Actuator, column: str) -> float:
    """Torque on the joint side per ampere [N m/A].

    Raises:
        LogError: If the robot states no torque constant; the message names ``column``, which needs it.
    """
    if actuator.torque_constant is None:
        raise LogError(
            f"{table.file} has {column} but no tau.{joint}, and the robot states no torque_constant of {joint}: add "
            "torque_constant (and gear_ratio) under joints in robot.yaml, or a column of the torque. "
            "docs/how_to/formats.md lists those of common drives."
        )
    return actuator.torque_constant * actuator.gear_ratio


def per_volt(actuator: Actuator) -> float:
    """Torque on the joint side per volt at standstill [N m/V or N/V]; zero if a constant is not stated."""
    if actuator.torque_constant is None or actuator.resistance is None:
        return 0.0
    return actuator.torque_constant * actuator.gear_ratio / actuator.resistance


def per_speed(actuator: Actuator) -> float:
    """Decrease of the joint's torque per speed by back-EMF [N m s/rad or N s/m]; zero if a constant is not stated."""
    return per_volt(actuator) * (actuator.torque_constant or 0.0) * actuator.gear_ratio


def voltage_bound(actuator: Actuator) -> float:
    """Torque at standstill under the largest voltage of a drive [N m or N]; infinite if this voltage is not known."""
    return per_volt(actuator) * actuator.voltage_limit if actuator.voltage_limit and per_volt(actuator) else np.inf


def warm_share(table: Table, joint: str) -> Float[Array, " N"] | float:
    """Resistance of a motor at its lowest temperature, divided by its resistance at each time, shape ``(N,)``.

    It is 1 if no temperature was measured. The stated resistance is assumed to hold at the lowest temperature of the
    recording, because its own temperature is not known: data sheets mean a cold motor, fits a running motor.
    """
    temperature = table.columns.get(f"temp.{joint}")
    return 1.0 if temperature is None else copper_share(temperature)


def copper_share(temperature: Float[Array, " N"]) -> Float[Array, " N"]:
    """Resistance of copper at the lowest temperature, divided by its resistance at each temperature, shape ``(N,)``.

    Args:
        temperature: Temperatures [deg C]. Values that are not finite count as the lowest temperature.

    Returns:
        The ratio; 1 throughout if no temperature was measured.
    """
    # Zero throughout means that the temperature was not measured.
    known = np.isfinite(temperature)
    if not known.any() or not np.any(temperature[known]):
        return np.ones(len(temperature))
    cold = float(temperature[known].min())
    return 1.0 / (1.0 + _COPPER * (np.where(known, temperature, cold) - cold))


def _voltage_torque(table: Table, joint: str, actuator: Actuator) -> Float[Array, " N"]:
    r"""Torque from the voltage of a motor that warms: :math:`i = (u - k\,n\,v)/R`, :math:`\tau = k\,n\,i`.

    Without a recorded velocity, positions are differentiated after spikes and dropouts are removed. This back-EMF is
    preliminary: it is computed again once the positions are filtered, see `Recording.velocity_gain`.
    """
    _torque_per_ampere(table, joint, actuator, f"u.{joint}")
    if actuator.resistance is None:
        raise LogError(
            f"{table.file} has u.{joint} but neither tau. nor i. of it, and the robot states no resistance of {joint}: "
            "add resistance under joints in robot.yaml, or a column of the current or torque."
        )
    v = table.columns.get(f"v.{joint}")
    if v is None:
        v = np.gradient(mended_position(table.columns[f"q.{joint}"]), table.columns["t"])
    return warm_share(table, joint) * (per_volt(actuator) * table.columns[f"u.{joint}"] - per_speed(actuator) * v)


def voltage_slowing(table: Table, robot: Robot, torque_from: Mapping[str, str]) -> Float[Array, " nv"] | None:
    """Decrease of the torque per speed by back-EMF, for joints whose back-EMF was computed from positions.

    Args:
        table: Columns under their standard names.
        robot: The robot, with the constants of its drives.
        torque_from: For each joint, the quantity from which its torque was computed, see `torque_sources`.

    Returns:
        The decrease [N m s/rad or N s/m], ``(nv,)``, zero for other joints; None if there are no such joints.
    """
    differenced = [torque_from.get(joint) == "u" and f"v.{joint}" not in table.columns for joint in robot.joint_names]
    if not any(differenced):
        return None
    # The mean resistance is accurate enough here: it multiplies only the part of the speed that a filter removes.
    warm = [float(np.mean(warm_share(table, joint))) for joint in robot.joint_names]
    decreases = [warmth * per_speed(actuator) for warmth, actuator in zip(warm, robot.actuators, strict=True)]
    return np.where(differenced, decreases, 0.0)


def _warming(table: Table, joint: str, actuator: Actuator) -> tuple[str, ...]:
    """A sentence on a motor whose resistance grows by `_REPORTED` or more with its temperature; else empty."""
    share, resistance = warm_share(table, joint), actuator.resistance
    if resistance is None or np.max(np.abs(np.asarray(share) - 1.0)) < _REPORTED:
        return ()
    warm, grown = table.columns[f"temp.{joint}"], resistance / np.asarray(share)
    return (
        f"{table.file}: the resistance of {joint} is taken to grow from the stated {resistance:.3g} to "
        f"{grown.max():.3g} ohm, as copper's does from {warm.min():.3g} to {warm.max():.3g} °C (temp.{joint}).",
    )


def with_voltages(table: Table) -> Table:
    """The table with ``u.<joint>`` computed from ``duty.<joint>`` and ``supply`` for joints without a voltage.

    Raises:
        LogError: If a duty cycle is not between -1 and 1.
    """
    duties = {name.partition(".")[2]: values for name, values in table.columns.items() if name.startswith("duty.")}
    for joint, duty in duties.items():
        largest = float(np.max(np.abs(duty), initial=0.0))
        if largest > _LARGEST_DUTY:
            raise LogError(
                f"{table.file}: duty.{joint} reaches {largest:g}, wanted the share of the supply, -1 to 1: map it with "
                f"its unit, as in duty.{joint}: {{from: duty.{joint}, unit: percent}}."
            )
    lacking = [joint for joint in duties if f"u.{joint}" not in table.columns]
    if not lacking:
        return table
    if "supply" not in table.columns:
        names = listed(f"duty.{joint}" for joint in lacking)
        sentence = f"{table.file}: {names} not used: a voltage from it needs a column supply (voltage of the supply)."
        return replace(table, warnings=(*table.warnings, sentence))
    supply = table.columns["supply"]
    voltages = {f"u.{joint}": read_only(duties[joint] * supply) for joint in lacking}
    return replace(table, columns={**table.columns, **voltages})


def torque_sources(table: Table, joints: Iterable[str]) -> dict[str, str]:
    """For each joint, the quantity that gives its torque: ``tau``, ``i`` or ``u``. Joints with none are left out."""
    found = {joint: [x for x in ("tau", "i", "u") if f"{x}.{joint}" in table.columns] for joint in joints}
    return {joint: quantities[0] for joint, quantities in found.items() if quantities}


def _torque_of_joint(table: Table, joint: str, actuator: Actuator) -> Float[Array, " N"] | None:
    """Torque of one joint; None if there is no column for it, zeros if its drive is unknown or if it has no drive."""
    if not actuator.drive_known:
        return np.zeros(len(table.columns["t"]))
    if f"tau.{joint}" in table.columns:
        return table.columns[f"tau.{joint}"]
    if f"i.{joint}" in table.columns:
        return table.columns[f"i.{joint}"] * _torque_per_ampere(table, joint, actuator, f"i.{joint}")
    if f"u.{joint}" in table.columns:
        return _voltage_torque(table, joint, actuator)
    return None if actuator.actuated else np.zeros(len(table.columns["t"]))


def _missing(table: Table, joints: list[str], all_missing: bool) -> str:
    """Error message for joints without a torque."""
    what = "no torque: there is no column" if all_missing else "no torque of"
    names = ", ".join(f"tau.{joint}" for joint in joints) if all_missing else ", ".join(joints)
    instead = ", or the references q_ref.<joint> of its position controllers, so that motion alone can be judged"
    if any(f"v_ref.{joint}" in table.columns for joint in joints):
        instead += "; a velocity controller makes the torque kv (v_ref - v): write that into tau.<joint>"
    return (
        f"{table.file} has {what} {names}: add tau.<joint>, or the motor current i.<joint> with torque_constant in "
        f"robot.yaml, or say actuated: false there for a joint without a drive, or drive: unknown "
        f"for one that something moves with a torque that nobody knows{instead if all_missing else ''}."
    )


def drive_torque(
    table: Table, robot: Robot, torque_needed: bool
) -> tuple[Float[Array, "N nv"] | None, tuple[str, ...]]:
    """Drive torque on the joint side [N m or N], shape ``(N, nv)``, read-only, and warnings about it.

    Args:
        table: Columns under their standard names.
        robot: The robot, with its joints and the constants of its drives.
        torque_needed: If False, the torque is None when a joint has none.

    Raises:
        LogError: If torque is needed and a driven joint has none, if a constant that turns current or voltage into
            torque is missing, or if the torque of every joint is zero.
    """
    pairs = list(zip(robot.joint_names, robot.actuators, strict=True))
    found = {joint: _torque_of_joint(table, joint, actuator) for joint, actuator in pairs}
    missing = [joint for joint, values in found.items() if values is None]
    if missing and torque_needed:
        error_type = LogError if torque_sources(table, robot.joint_names) else NoTorqueError
        raise error_type(_missing(table, missing, all_missing=len(missing) == len(found)))
    if missing:
        sentence = f"{table.file}: without torque of {', '.join(missing)}, the torque is not used."
        return None, (sentence,) if len(missing) < len(found) else ()
    tau = side_by_side([values for values in found.values() if values is not None])
    driven = [actuator.actuated and actuator.drive_known for _, actuator in pairs]
    zero = [
        joint
        for joint, is_driven, torque in zip(robot.joint_names, driven, tau.T, strict=True)
        if is_driven and not torque.any()
    ]
    if torque_needed and zero and len(zero) == sum(driven):
        raise LogError(f"{table.file}: the torque is zero on every joint: record the torque or current of the drives.")
    warnings = tuple(
        f"{table.file}: the torque of {joint} is zero throughout: if the joint has no drive, say actuated: false in "
        "robot.yaml."
        for joint in zero
    )
    sources = torque_sources(table, robot.joint_names)
    warm = [_warming(table, joint, actuator) for joint, actuator in pairs if sources.get(joint) == "u"]
    return tau, (*warnings, *(sentence for sentences in warm for sentence in sentences))


def external_torque(
    robot: Robot, q: Float[Array, "N nv"], forces: Mapping[str, Float[Array, "N 3"]]
) -> Float[Array, "N nv"]:
    r"""Joint torque :math:`\sum J^T f` of external forces [N m or N], shape ``(N, nv)``.

    Args:
        robot: The robot, with its frames and loops.
        q: Joint positions [rad or m], shape ``(N, nv)``.
        forces: For each frame, the force on the robot at its origin [N], world axes, shape ``(N, 3)``.

    Raises:
        LogError: If the robot has no such frame, or a force is not finite.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    require_frames(robot, forces)
    out = np.zeros_like(q)
    for frame, force in forces.items():
        if not np.isfinite(force).all():
            row = int(np.argwhere(~np.isfinite(force))[0, 0])
            raise LogError(f"The force f.{frame} is not finite at sample {row}: give finite numbers or leave it out.")
        out += wrench_torque(robot, q, np.hstack([force, np.zeros_like(force)]), frame)
    return out


def require_frames(robot: Robot, frames: Iterable[str], quantity: str = "f") -> None:
    """Raise an error if a quantity was measured at a frame that the robot does not have.

    Args:
        robot: The robot, with its frames.
        frames: Names of frames.
        quantity: ``f`` for a force, ``p`` for measured positions, ``o`` for orientations.

    Raises:
        LogError: If a frame is missing. The message lists the frames that exist.
    """
    for frame in frames:
        if not robot.model.existFrame(frame):
            names = dict.fromkeys(f.name for f in robot.model.frames)
            *first, last = [f".{axis}" for axis in FRAME_AXES[quantity]]
            raise LogError(
                f"The columns {quantity}.{frame}{', '.join(first)} and {last} are {MEANT[quantity]} at a frame that "
                f"{robot.name} does not have: {known_names(frame, names, 'frames')}"
            )


def loops_of(table: Table, joints: Iterable[str]) -> tuple[DriveLoop | None, ...]:
    """The position loop of each joint's drive; None if output or reference was not recorded, or shows no loop."""
    return tuple(_loop_of(table, joint) for joint in joints)


def _loop_of(table: Table, joint: str) -> DriveLoop | None:
    """Estimated position controller of one joint's drive; None without its output, reference or position."""
    columns = table.columns
    output = next((name for name in ("u", "i", "tau") if f"{name}.{joint}" in columns), None)
    if output is None or f"q_ref.{joint}" not in columns or f"q.{joint}" not in columns:
        return None
    start = max((len(columns["t"]) - _ROWS) // 2, 0)
    t, y, q_ref, q = (
        np.ascontiguousarray(columns[name][start : start + _ROWS])
        for name in ("t", f"{output}.{joint}", f"q_ref.{joint}", f"q.{joint}")
    )
    return drive_loop(output, t, y, q_ref, q)


def computed_from_references(
    table: Table, robot: Robot, loops: tuple[DriveLoop | None, ...], torque_from: Mapping[str, str]
) -> tuple[Float[Array, " nv"] | None, Float[Array, " nv"] | None]:
    """Gain and torque limit of joints whose voltage was computed from the reference; None without such joints.

    Only voltages are considered, which a drive computes from the reference that it holds. A torque that equals a
    control law to the last digit is instead the command of a controller that gets its reference without delay.

    Args:
        table: Columns under their standard names.
        robot: The robot, with the constants of its drives.
        loops: Position loop of each joint's drive, or None.
        torque_from: For each joint, the quantity from which its torque was computed.

    Returns:
        Torque per reference [N m/rad or N/m], zero for other joints, and the largest torque [N m or N], each ``(nv,)``.
    """
    gain, limits = np.zeros(robot.nv), np.full(robot.nv, np.inf)
    for j, (joint, loop, actuator) in enumerate(zip(robot.joint_names, loops, robot.actuators, strict=True)):
        if loop is None or not loop.computed or torque_from.get(joint) != "u":
            continue
        torque_per_volt = float(np.mean(warm_share(table, joint))) * per_volt(actuator)
        gain[j] = torque_per_volt * loop.gain
        if loop.limit is not None:
            limits[j] = torque_per_volt * loop.limit
    return (gain, limits) if gain.any() else (None, None)
