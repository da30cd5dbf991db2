"""Which drives of a recording have a loop that its columns show, and which torques were computed from references."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from identification.data.drive_loop import DriveLoop, drive_loop
from identification.data.drives.joint_torque import per_volt, warm_share
from identification.data.recording import Table
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot

_ROWS = 60000
"""Rows of a long recording that are enough to read a loop from, in its middle."""


def loops_of(table: Table, joints: Iterable[str]) -> tuple[DriveLoop | None, ...]:
    """The loop of each joint's drive, None where no output or no reference was recorded, or the output follows none.

    Args:
        table: Columns under the contract's names.
        joints: Names.
    """
    return tuple(_loop_of(table, joint) for joint in joints)


def _loop_of(table: Table, joint: str) -> DriveLoop | None:
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
    """Torque per unit of the reference of each joint whose voltage was computed from it, and where that is clipped.

    None for both where there is no such joint. A voltage is what a drive makes of a reference by itself; a torque that
    follows a law to the last digit is the command of somebody who knows the reference at that instant.

    Args:
        table: Columns under the contract's names.
        robot: Gives the constants of the drives.
        loops: Of each joint.
        torque_from: The quantity that gave the torque of each joint.
    """
    gain, limits = np.zeros(robot.nv), np.full(robot.nv, np.inf)
    for j, (joint, loop, actuator) in enumerate(zip(robot.joint_names, loops, robot.actuators, strict=True)):
        if loop is None or not loop.computed or torque_from.get(joint) != "u":
            continue
        own = float(np.mean(warm_share(table, joint))) * per_volt(actuator)
        gain[j] = own * loop.gain
        if loop.limit is not None:
            limits[j] = own * loop.limit
    return (gain, limits) if gain.any() else (None, None)
