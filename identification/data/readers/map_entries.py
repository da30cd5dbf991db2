"""Entries of a column map that mend a recording, and the words of a message that asks for them.

A map takes columns by the file's own names. Where the recording was read through one, the entries say these.
"""

from __future__ import annotations

from collections.abc import Mapping

from identification.data.readers.contract_columns import ALONE, FRAME_AXES, FRAME_FLAGS, JOINT_QUANTITIES, column_of
from identification.data.readers.suggested_map import quoted
from identification.data.recording import Recording, Table
from phantom_dyn.model.robot import Robot


def entries_words(recording: Recording, entries: Mapping[str, str]) -> str:
    """Advice, as in ``write t: {from: t, unit: ms} into a column map and give it with --columns``.

    Args:
        recording: Says which columns of the file a map took.
        entries: By key of a map its entry, with standard names in the place of the file's.
    """
    where = "into a column map and give it with --columns"
    if recording.named:
        entries = _in_names_of_file(recording, entries)
        where = "into the column map, on top of what its entries say already"
    pairs = [f"{key}: {value}" for key, value in entries.items()]
    entry = pairs[0] if len(pairs) == 1 else "{" + ", ".join(pairs) + "}"
    return f"write {entry} {where}"


def _in_names_of_file(recording: Recording, entries: Mapping[str, str]) -> dict[str, str]:
    out: dict[str, str] = {}
    for key, value in entries.items():
        taken = next((quantity for quantity in JOINT_QUANTITIES if f'"{quantity}.{{joint}}"' in value), None)
        if taken is None:
            out[key] = _renamed(recording, value)
        elif not any(f"{taken}.{joint}" in recording.named for joint in recording.joint_names):
            out[key] = value
        else:
            for joint in recording.joint_names:
                own = value.replace(f'"{taken}.{{joint}}"', f"{taken}.{joint}")
                out[f"{key}.{joint}"] = _renamed(recording, own)
    return out


def _renamed(recording: Recording, value: str) -> str:
    """An entry, a name alone or ``{from: NAME, ...}``, with the file's name of its column."""
    before, after = ("{from: ", ", ") if value.startswith("{from: ") else ("", "")
    name, mark, rest = value.removeprefix(before).partition(after) if after else (value, "", "")
    return f"{before}{quoted(recording.named[name])}{mark}{rest}" if name in recording.named else value


def left_out_words(table: Table, robot: Robot) -> str:
    """Advice to leave out all columns of joints that a robot does not have, a sentence."""
    names = []
    for name in table.columns:
        column = column_of(name)
        if (
            column is not None
            and column.quantity not in (*ALONE, *FRAME_AXES, *FRAME_FLAGS, "temp")
            and column.of not in (*robot.joint_names, *robot.passive_names, *robot.locked)
        ):
            names.append(quoted(table.named.get(name, name)))
    return f"To leave it out, write ignore: [{', '.join(names)}] into a column map (--columns)."


def gear_entries(robot: Robot, by_joint: dict[int, str]) -> dict[str, str]:
    """Entries for torques, one for all joints where they agree."""
    return _of_joints(robot, "tau", by_joint)


def position_entries(robot: Robot, by_joint: dict[int, str]) -> dict[str, str]:
    """Entries for positions, one for all joints where they agree."""
    return _of_joints(robot, "q", by_joint)


def _of_joints(robot: Robot, quantity: str, by_joint: dict[int, str]) -> dict[str, str]:
    if len(set(by_joint.values())) == 1:
        return entries(robot, quantity, tuple(by_joint), next(iter(by_joint.values())))
    return {key: value for j, option in by_joint.items() for key, value in _entry(robot, quantity, j, option).items()}


def entries(robot: Robot, quantity: str, joints: tuple[int, ...], option: str) -> dict[str, str]:
    """Entries of a column map for a quantity of some joints, in one line where they are all joints."""
    if len(joints) == robot.nv > 1 and not robot.passive_names:
        return {quantity: f'{{from: "{quantity}.{{joint}}", {option}}}'}
    return {key: value for j in joints for key, value in _entry(robot, quantity, j, option).items()}


def _entry(robot: Robot, quantity: str, j: int, option: str) -> dict[str, str]:
    column = f"{quantity}.{robot.joint_names[j]}"
    return {column: f"{{from: {column}, {option}}}"}
