"""Files whose columns have other names than the contract's: a layout that is known is read without being named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from identification.data.readers.contract_columns import UnknownNamesError
from identification.data.readers.presets import fitting_presets
from identification.data.readers.read_table import Files, read_table
from identification.data.readers.suggested_map import suggested_map
from identification.data.recording import Table
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot


def table_of(path: Files, robot: Robot, columns: str | Path | None, topic: str | None, ref_topic: str | None) -> Table:
    """Columns of a file, see `read_table`; a known layout is read, and for other names the refusal shows a map."""

    def read(columns: str | Path | None) -> Table:
        others = (*robot.passive_names, *robot.locked)
        more = {"topic": topic, "ref_topic": ref_topic, "joints": robot.joint_names, "other_joints": others}
        return read_table(path, columns=columns, **more)

    try:
        return read(columns)
    except UnknownNamesError as error:
        if columns is not None:
            raise
        fitting = fitting_presets(error.names)
        if len(fitting) == 1:
            found = read(fitting[0])
            return replace(found, warnings=(*found.warnings, _recognised(found, robot, fitting[0])))
        raise LogError(f"{error}{_advice(error.names, robot)}") from error


def _recognised(table: Table, robot: Robot, preset: str) -> str:
    """The sentence on a layout that was read without being named.

    Raises:
        LogError: If it has currents and the robot no torque constants; the sentence asks for them.
    """
    lacking = [
        joint
        for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
        if f"i.{joint}" in table.columns and f"tau.{joint}" not in table.columns and actuator.torque_constant is None
    ]
    if lacking:
        raise LogError(
            f"{table.file} was read as --columns {preset}: it has motor currents, and the robot no constants that make "
            f"torques of them: add torque_constant and gear_ratio of {', '.join(lacking)} under joints in robot.yaml."
            " docs/how_to/formats.md lists those of common drives."
        )
    return f"{table.file}: its columns are those of --columns {preset}, and were read so."


def _advice(names: tuple[str, ...], robot: Robot) -> str:
    """A map to begin with for columns of other names; empty where nothing helps."""
    suggested = suggested_map(names, robot.joint_names)
    return f" A map to begin with, to be checked and saved as columns.yaml:\n{suggested}" if suggested else ""
