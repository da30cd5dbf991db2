"""Assigns the robot's joints to numbered columns: by the names that the file states, or in the robot's order.

UR's RTDE, libfranka, Unitree's LowState and arrays number their joints (``actual_q_0``, ``q[0]``). A warning states the
assignment, because the file cannot confirm it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from identification.data.recording import RawTable
from phantom_dyn.errors import LogError, listed, shortened


def joints_of_numbers(
    raw: RawTable, positions: Mapping[int, str], joints: Sequence[str] | None
) -> tuple[dict[int, str], tuple[str, ...]]:
    """The joint of each number, and a warning that states the assignment.

    Args:
        raw: The file.
        positions: For each number, the column of the position.
        joints: Joint names of the robot, in its order; without a robot (None) the numbers are the names.

    Raises:
        LogError: If there are fewer numbers than joints, or a number beyond the joints has a position that is not
            always zero; the message has a column map to complete.
    """
    numbers = sorted(positions)
    if len(raw.joint_names) == len(numbers):
        return dict(zip(numbers, raw.joint_names, strict=True)), ()
    if joints is None:
        return {number: str(number) for number in numbers}, ()
    for order in raw.documented_joint_orders:
        known = dict(zip(numbers, order, strict=False))
        if set(joints) <= set(known.values()):
            joint_of_number = {number: joint for number, joint in known.items() if joint in joints}
            sentence = _sentence(raw.file, "in the order of the maker's documentation", positions, joint_of_number)
            return joint_of_number, (sentence,)
    moving = [number for number in numbers if _moves(raw, positions[number])]
    if len(numbers) > len(joints) and (not moving or moving[-1] in numbers[: len(joints)]):
        numbers = numbers[: len(joints)]
    if len(numbers) != len(joints):
        raise LogError(_refusal(raw, positions, numbers, joints))
    joint_of_number = dict(zip(numbers, joints, strict=True))
    return joint_of_number, (_sentence(raw.file, "in the robot's order", positions, joint_of_number),)


def _moves(raw: RawTable, column: str) -> bool:
    """False for a column that is always zero, like the columns of motors that do not exist."""
    values = raw.columns.get(column)
    return values is None or bool(np.any(values))


def _sentence(file: str, order: str, positions: Mapping[int, str], joint_of_number: Mapping[int, str]) -> str:
    pairs = [f"{positions[number]} is {joint}" for number, joint in joint_of_number.items()]
    return f"{file} numbers its joints, which were taken {order}: {listed(pairs, 40)}; if not, map them with --columns."


def _refusal(raw: RawTable, positions: Mapping[int, str], numbers: Sequence[int], joints: Sequence[str]) -> str:
    first, last = shortened(positions[numbers[0]]), shortened(positions[numbers[-1]])
    columns = [positions[number] for number in sorted(positions)]
    lines = [f'q.{joint}: "{column}"' for joint, column in zip(joints, columns, strict=False)]
    return (
        f"{raw.file} numbers {len(numbers)} joints ({first} to {last}) and the robot has {len(joints)}: say in a "
        "column map which is which. A map to begin with, to be completed, checked and saved as columns.yaml:\n"
        + "\n".join(lines)
    )
