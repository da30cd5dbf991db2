"""Entries of a column map that mend a fault."""

from __future__ import annotations

from phantom_dyn.model.robot import Robot


def gear_entries(robot: Robot, by_joint: dict[int, str]) -> dict[str, str]:
    """Entries for all torques, one for all joints where they agree."""
    if len(set(by_joint.values())) == 1:
        return entries(robot, "tau", tuple(by_joint), next(iter(by_joint.values())))
    return {key: value for j, option in by_joint.items() for key, value in _entry(robot, "tau", j, option).items()}


def entries(robot: Robot, quantity: str, joints: tuple[int, ...], option: str) -> dict[str, str]:
    """Entries of a column map for a quantity of some joints, in one line where they are all joints."""
    if len(joints) == robot.nv > 1 and not robot.passive_names:
        return {quantity: f'{{from: "{quantity}.{{joint}}", {option}}}'}
    return {key: value for j in joints for key, value in _entry(robot, quantity, j, option).items()}


def _entry(robot: Robot, quantity: str, j: int, option: str) -> dict[str, str]:
    column = f"{quantity}.{robot.joint_names[j]}"
    return {column: f"{{from: {column}, {option}}}"}
