# pyright: reportAttributeAccessIssue=false
"""Torque of every joint from what was recorded: torque, current or voltage of its drive, and measured forces."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from identification.data.mending import mended_position
from identification.data.readers.contract_columns import FRAME_AXES, MEANT
from identification.data.recording import Table
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.kinematics import wrench_torque
from phantom_dyn.errors import LogError, known_names
from phantom_dyn.model.robot import Actuator, Robot
from phantom_dyn.motion import side_by_side

# Copper's resistance grows by so much per kelvin.
_COPPER = 0.00393
# Of the resistance: a smaller growth is less than what data sheets are right to, and is not said.
_SAID = 0.01


class NoTorqueError(LogError):
    """No joint has a torque, or a current or voltage in its place."""


def _constant(table: Table, joint: str, actuator: Actuator, column: str) -> float:
    """Torque on the joint side per ampere [N m/A]."""
    if actuator.torque_constant is None:
        raise LogError(
            f"{table.file} has {column} but no tau.{joint}, and the robot states no torque_constant of {joint}: add "
            "torque_constant (and gear_ratio) under joints in robot.yaml, or a column of the torque. "
            "docs/how_to/formats.md lists those of common drives."
        )
    return actuator.torque_constant * actuator.gear_ratio


def per_volt(actuator: Actuator) -> float:
    """Torque on the joint side per volt at standstill [N m/V or N/V]; zero where a constant is not stated."""
    if actuator.torque_constant is None or actuator.resistance is None:
        return 0.0
    return actuator.torque_constant * actuator.gear_ratio / actuator.resistance


def per_speed(actuator: Actuator) -> float:
    """Torque on the joint side that back-EMF takes per speed [N m s/rad or N s/m]; zero where it is not known."""
    return (
        0.0 if actuator.torque_constant is None else per_volt(actuator) * actuator.torque_constant * actuator.gear_ratio
    )


def voltage_bound(actuator: Actuator) -> float:
    """Torque [N m or N] at standstill of the largest voltage of a drive; infinite where that is not known."""
    return per_volt(actuator) * actuator.voltage_limit if actuator.voltage_limit and per_volt(actuator) else np.inf


def warm_share(table: Table, joint: str) -> Float[Array, " N"] | float:
    """Resistance of a motor at the coldest of a recording as a share of the one at each time; one without temperature.

    Nobody says at which temperature a resistance was stated: a data sheet's is that of a cold motor, one that was
    fitted that of the motor as it ran. Only how it changes within a recording is certain.
    """
    warm = table.columns.get(f"temp.{joint}")
    return 1.0 if warm is None else copper_share(warm)


def copper_share(warm: Float[Array, " N"]) -> Float[Array, " N"]:
    """The same at temperatures [deg C]; one where none was measured."""
    # A register that nobody fills is zero throughout.
    known = np.isfinite(warm)
    if not known.any() or not np.any(warm[known]):
        return np.ones(len(warm))
    cold = float(warm[known].min())
    return 1.0 / (1.0 + _COPPER * (np.where(known, warm, cold) - cold))


def _voltage_torque(table: Table, joint: str, actuator: Actuator) -> Float[Array, " N"]:
    r"""Torque from the voltage: :math:`i = (u - k\,n\,v)/R`, :math:`\tau = k\,n\,i`, of a motor that warms.

    Where no velocity was recorded it is that of differences of the mended positions, as a dropout of one sample is none
    of the motor; whoever filters the positions takes the back-EMF of the filtered ones, see `Recording.slowing`.
    """
    _constant(table, joint, actuator, f"u.{joint}")
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
    """Torque per speed of joints whose back-EMF was computed from differences of positions; None if there is none.

    Args:
        table: Columns under the contract's names.
        robot: Gives the constants of its drives.
        torque_from: The quantity that gave the torque of each joint.
    """
    pairs = zip(robot.joint_names, robot.actuators, strict=True)
    differenced = [torque_from.get(joint) == "u" and f"v.{joint}" not in table.columns for joint in robot.joint_names]
    if not any(differenced):
        return None
    # Of what the filter takes from speeds, the mean of a motor that warms is enough.
    warm = [float(np.mean(warm_share(table, joint))) for joint in robot.joint_names]
    return np.array([w * per_speed(a) if own else 0.0 for (_, a), own, w in zip(pairs, differenced, warm, strict=True)])


def _warming(table: Table, joint: str, actuator: Actuator) -> tuple[str, ...]:
    """A sentence on a motor whose resistance is not the stated one."""
    share, resistance = warm_share(table, joint), actuator.resistance
    if resistance is None or np.max(np.abs(np.asarray(share) - 1.0)) < _SAID:
        return ()
    warm, grown = table.columns[f"temp.{joint}"], resistance / np.asarray(share)
    return (
        f"{table.file}: the resistance of {joint} is taken to grow from the stated {resistance:.3g} to "
        f"{grown.max():.3g} ohm, as copper's does from {warm.min():.3g} to {warm.max():.3g} °C (temp.{joint}).",
    )


def torque_sources(table: Table, joints: Iterable[str]) -> dict[str, str]:
    """The quantity that gives the torque of each joint: ``tau``, ``i`` or ``u``; joints that have none are left out."""
    found = {joint: [x for x in ("tau", "i", "u") if f"{x}.{joint}" in table.columns] for joint in joints}
    return {joint: quantities[0] for joint, quantities in found.items() if quantities}


def _one_joint(table: Table, joint: str, actuator: Actuator) -> Float[Array, " N"] | None:
    """Torque of one joint, or None if nothing gives it; zeros where nobody knows its drive."""
    if not actuator.drive_known:
        return np.zeros(len(table.columns["t"]))
    if f"tau.{joint}" in table.columns:
        return table.columns[f"tau.{joint}"]
    if f"i.{joint}" in table.columns:
        return table.columns[f"i.{joint}"] * _constant(table, joint, actuator, f"i.{joint}")
    if f"u.{joint}" in table.columns:
        return _voltage_torque(table, joint, actuator)
    return None if actuator.actuated else np.zeros(len(table.columns["t"]))


def _missing(table: Table, joints: list[str], all_missing: bool) -> str:
    what = "no torque: there is no column" if all_missing else "no torque of"
    names = ", ".join(f"tau.{joint}" for joint in joints) if all_missing else ", ".join(joints)
    instead = ", or the references q_ref.<joint> of its position controllers, so that motion alone can be judged"
    return (
        f"{table.file} has {what} {names}: add tau.<joint>, or the motor current i.<joint> with torque_constant in "
        f"robot.yaml, or say actuated: false there for a joint without a drive, or drive: unknown "
        f"for one that something moves with a torque that nobody knows{instead if all_missing else ''}."
    )


def drive_torque(
    table: Table, robot: Robot, torque_needed: bool
) -> tuple[Float[Array, "N nv"] | None, tuple[str, ...]]:
    """Drive torque on the joint side [N m or N], shape ``(N, nv)``, read-only, and what was noticed about it.

    Args:
        table: Columns under the contract's names.
        robot: Gives the joints and the constants of its drives.
        torque_needed: If False, None is returned where a joint has no torque.

    Raises:
        LogError: If a driven joint has no torque and it is needed, a constant is missing that turns current or voltage
            into torque, or the torque of every joint is zero.
    """
    pairs = list(zip(robot.joint_names, robot.actuators, strict=True))
    found = {joint: _one_joint(table, joint, actuator) for joint, actuator in pairs}
    missing = [joint for joint, values in found.items() if values is None]
    if missing and torque_needed:
        kind = LogError if torque_sources(table, robot.joint_names) else NoTorqueError
        raise kind(_missing(table, missing, all_missing=len(missing) == len(found)))
    if missing:
        sentence = f"{table.file}: without torque of {', '.join(missing)}, the torque is not used."
        return None, (sentence,) if len(missing) < len(found) else ()
    tau = side_by_side([values for values in found.values() if values is not None])
    driven = [actuator.actuated and actuator.drive_known for _, actuator in pairs]
    some = [bool(np.any(column)) for column in tau.T]
    if torque_needed and any(driven) and not any(x for x, live in zip(some, driven, strict=True) if live):
        raise LogError(f"{table.file}: the torque is zero on every joint: record the torque or current of the drives.")
    zero = [joint for (joint, _), live, moved in zip(pairs, driven, some, strict=True) if live and not moved]
    warnings = tuple(
        f"{table.file}: the torque of {joint} is zero throughout: if the joint has no drive, say actuated: false in "
        "robot.yaml."
        for joint in zero
    )
    sources = torque_sources(table, robot.joint_names)
    warm = [_warming(table, joint, actuator) for joint, actuator in pairs if sources.get(joint) == "u"]
    return tau, (*warnings, *(sentence for own in warm for sentence in own))


def external_torque(
    robot: Robot, q: Float[Array, "N nv"], forces: Mapping[str, Float[Array, "N 3"]]
) -> Float[Array, "N nv"]:
    r"""Torque :math:`\sum J^T f` that forces on the robot put on its joints, :math:`(N, nv)` [N m or N].

    Args:
        robot: Gives frames and loops.
        q: Joint positions [rad or m].
        forces: Force on the robot [N], world axes, by the frame at whose origin it acts.

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
    """Refuse a force, or what else belongs to a frame, at a frame that the robot does not have.

    Args:
        robot: Gives the frames.
        frames: Names.
        quantity: ``f`` for a force, ``p`` for measured positions, ``o`` for orientations.

    Raises:
        LogError: It lists the frames that there are.
    """
    for frame in frames:
        if not robot.model.existFrame(frame):
            names = dict.fromkeys(f.name for f in robot.model.frames)
            *first, last = [f".{axis}" for axis in FRAME_AXES[quantity]]
            raise LogError(
                f"The columns {quantity}.{frame}{', '.join(first)} and {last} are {MEANT[quantity]} at a frame that "
                f"{robot.name} does not have: {known_names(frame, names, 'frames')}"
            )
