"""Writes entries of a column map that correct a recording, as advice for the user.

If the recording was read with the user's own column map, the entries contain the column names of the file.
"""

from __future__ import annotations

from collections.abc import Mapping

from identification.data.readers.contract_columns import ALONE, FRAME_AXES, FRAME_FLAGS, JOINT_QUANTITIES, column_of
from identification.data.readers.suggested_map import quoted
from identification.data.recording import Recording, Table
from phantom_dyn.model.robot import Robot


def entries_words(recording: Recording, entries: Mapping[str, str]) -> str:
    """Advice such as ``write t: {from: t, unit: ms} into a column map and give it with --columns``.

    Args:
        recording: States the columns of the file, if it was read with a column map.
        entries: Entries of a column map by key, with standard column names.
    """
    where = "into a column map and give it with --columns"
    if recording.named:
        entries = _in_names_of_file(recording, entries)
        where = "into the column map, on top of what its entries say already"
    pairs = [f"{key}: {value}" for key, value in entries.items()]
    entry = pairs[0] if len(pairs) == 1 else "{" + ", ".join(pairs) + "}"
    return f"write {entry} {where}"


def _in_names_of_file(recording: Recording, entries: Mapping[str, str]) -> dict[str, str]:
    """Entries with the column names of the file in place of standard names.

    An entry for all joints, such as ``q: {from: "q.{joint}", unit: deg}``, becomes one entry for each joint.
    """
    out: dict[str, str] = {}
    for key, value in entries.items():
        repeated_for = next((quantity for quantity in JOINT_QUANTITIES if f'"{quantity}.{{joint}}"' in value), None)
        if repeated_for is None:
            out[key] = _renamed(recording, value)
        elif not any(f"{repeated_for}.{joint}" in recording.named for joint in recording.joint_names):
            out[key] = value
        else:
            for joint in recording.joint_names:
                of_joint = value.replace(f'"{repeated_for}.{{joint}}"', f"{repeated_for}.{joint}")
                out[f"{key}.{joint}"] = _renamed(recording, of_joint)
    return out


def _renamed(recording: Recording, value: str) -> str:
    """An entry, ``NAME`` or ``{from: NAME, ...}``, with the column name of the file."""
    name, options = _parts(value)
    if name not in recording.named:
        return value
    column = quoted(recording.named[name])
    return f"{{from: {column}, {options}}}" if options else column


def left_out_words(table: Table, robot: Robot) -> str:
    """A sentence that says how to leave out all columns of joints that a robot does not have."""
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


def affixed_words(table: Table, robot: Robot) -> str:
    """A sentence with the entries for a log whose names of joints have the same letters before or after the robot's.

    It is empty if the names differ otherwise, or if the log was read with a column map.
    """
    columns = [column for name in table.columns if (column := column_of(name)) is not None and column.of]
    names = {column.of for column in columns if column.quantity == "q"}
    # For each joint, the letters before and after its name in each name of the log.
    around = [{tuple(name.split(joint, 1)) for name in names if joint in name} for joint in robot.joint_names]
    common = set.intersection(*around) - {("", "")} if around else set()
    if len(common) != 1 or table.named:
        return ""
    before, after = common.pop()
    quantities = dict.fromkeys(column.quantity for column in columns if column.quantity in JOINT_QUANTITIES)
    pairs = ", ".join(f'{quantity}: "{quantity}.{before}{{joint}}{after}"' for quantity in quantities)
    return f" Or, if these are the same joints, write {{{pairs}}} into a column map (--columns)."


def joint_entries(robot: Robot, quantity: str, by_joint: dict[int, str]) -> dict[str, str]:
    """Entries that give a quantity of each joint an option; a single entry if all joints have the same option.

    Args:
        robot: The robot, with the names of its joints.
        quantity: Quantity, such as ``tau``.
        by_joint: For the index of each joint its option, such as ``gear: 100``.
    """
    if len(set(by_joint.values())) == 1:
        return entries(robot, quantity, tuple(by_joint), next(iter(by_joint.values())))
    return {key: value for j, option in by_joint.items() for key, value in _entry(robot, quantity, j, option).items()}


def entries(robot: Robot, quantity: str, joints: tuple[int, ...], option: str) -> dict[str, str]:
    """Entries that give a quantity of some joints the same option; a single entry for all joints."""
    if len(joints) == robot.nv > 1 and not robot.passive_names:
        return {quantity: f'{{from: "{quantity}.{{joint}}", {option}}}'}
    return {key: value for j in joints for key, value in _entry(robot, quantity, j, option).items()}


def _entry(robot: Robot, quantity: str, j: int, option: str) -> dict[str, str]:
    """The entry for a quantity of one joint."""
    column = f"{quantity}.{robot.joint_names[j]}"
    return {column: f"{{from: {column}, {option}}}"}


def entries_after(earlier: Mapping[str, str], later: Mapping[str, str]) -> dict[str, str]:
    """Entries that make two corrections one after the other, because a map can have only one entry for a column.

    For example, ``q.a: {from: x, unit: deg}`` and then ``q.a: {from: q.a, sign: -1}`` become
    ``q.a: {from: x, unit: deg, sign: -1}``.

    Args:
        earlier: Entries of the first correction.
        later: Entries of the second correction, for the corrected columns.
    """
    out = dict(later)
    # If the later entry is for all joints and the earlier one for a single joint, this joint gets its own later entry.
    for key in earlier:
        general = later.get(key.partition(".")[0])
        if key not in later and general is not None:
            out[key] = general.replace(f'"{key.partition(".")[0]}.{{joint}}"', key)
    for key, value in out.items():
        source, options = _parts(value)
        quantity, _, joint = source.strip('"').partition(".")
        first = earlier.get(f"{quantity}.{joint}", earlier.get(quantity))
        if first is not None and (joint != "{joint}" or quantity in earlier):
            column, first_options = _parts(first.replace('"' + quantity + '.{joint}"', source))
            both = ", ".join(part for part in (first_options, options) if part)
            out[key] = f"{{from: {column}, {both}}}" if both else column
    return out


def _parts(value: str) -> tuple[str, str]:
    """Column and options of an entry, which is a name or ``{from: NAME, ...}``."""
    name, _, options = value.removeprefix("{from: ").removesuffix("}").partition(", ")
    return (name, options) if value.startswith("{from: ") else (value, "")
