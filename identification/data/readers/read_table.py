"""Reads a table of standard columns from one or several files of any known format.

The first bytes of a file show its format. The libraries for some formats (pyarrow, rosbags) are imported only in the
functions that need them, as they take long to load. Several files of one recording, such as positions in one and
torques in another, are joined row by row.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from identification.data.readers.array_files import read_npz, read_parquet
from identification.data.readers.bags.rosbag import read_ros1_bag, read_ros2_bag
from identification.data.readers.column_map import ColumnMap, mapped, matching, read_column_map, require_joints
from identification.data.readers.contract_columns import JOINT_QUANTITIES, UnknownNamesError, contract_table
from identification.data.readers.delimited import read_delimited
from identification.data.readers.lerobot import read_dataset, read_episode, units_question
from identification.data.readers.map_source import Source
from identification.data.readers.presets import fitting_presets, map_of, preset_of
from identification.data.readers.sage import with_neighbours
from identification.data.readers.suggested_map import suggested_map
from identification.data.recording import RawTable, Table
from identification.files import LOG_FORMATS, is_lerobot, lerobot_episode, require_existing
from phantom_dyn.errors import LogError, PhantomDynError, shortened
from phantom_dyn.model.files.plain_file import require_plain_file
from phantom_dyn.model.robot import Robot

Files = str | Path | Sequence[str | Path]
"""A file, or several of one recording."""
_TIME = "t"
# Largest difference between the times of a row in two files, as a share of the median time step.
_TIME_TOLERANCE = 0.01


def _read(path: Path, topic: str | None, ref_topic: str | None) -> RawTable:
    """Table of a file or folder, read with the reader for its format."""
    episode = lerobot_episode(path)
    if episode is not None:
        _require_no_topic(path, topic, ref_topic)
        return read_episode(*episode)
    if path.is_dir():
        if is_lerobot(path):
            _require_no_topic(path, topic, ref_topic)
            return read_dataset(path)
        if not (path / "metadata.yaml").exists():
            raise LogError(
                f"{path} is a folder without metadata.yaml, so no ROS 2 bag, and without meta/info.json, so no LeRobot "
                f"dataset: give a file ({LOG_FORMATS})."
            )
        return read_ros2_bag(path, topic, ref_topic)
    require_plain_file(path, LogError, f"a log ({LOG_FORMATS})")
    with path.open("rb") as file:
        start = file.read(16)
    if not start:
        raise LogError(f"{path.name} is empty: a log needs rows of numbers; record it again.")
    if start.startswith(b"#ROSBAG V"):
        return read_ros1_bag(path, topic, ref_topic)
    if start.startswith((b"SQLite format 3", b"\x89MCAP")):
        return read_ros2_bag(path, topic, ref_topic)
    _require_no_topic(path, topic, ref_topic)
    if start.startswith(b"PK\x03\x04") or start.startswith(b"PK\x05\x06"):
        return read_npz(path)
    if start.startswith(b"PAR1"):
        return read_parquet(path)
    return read_delimited(path)


def _require_no_topic(path: Path, topic: str | None, ref_topic: str | None) -> None:
    """Raise an error if a topic was named for a file without topics."""
    for option, name in (("--topic", topic), ("--ref-topic", ref_topic)):
        if name is not None:
            raise LogError(f"{path.name} is no bag, so it has no topic {shortened(name)}: leave {option} out.")


def read_raw(path: str | Path, *, topic: str | None = None, ref_topic: str | None = None) -> RawTable:
    """Columns of a file under the file's own names.

    Args:
        path: CSV, NPZ, Parquet, ROS 1 or ROS 2 bag, or MCAP; recognised by its content, not by its ending.
        topic: Topic of joint states in a bag that has several.
        ref_topic: Topic of the references in a bag, if it differs from that of the joint states.

    Raises:
        LogError: If the file is missing, empty, damaged or no log.
    """
    path = Path(path)
    require_existing(path)
    try:
        return _read(path, topic, ref_topic)
    except PhantomDynError:
        raise
    except OSError as error:
        if error.errno is not None:
            raise LogError(f"{path} cannot be read ({error.strerror}): give {LOG_FORMATS}.") from error
        raise LogError(_damaged(path, error)) from error
    # On damaged bytes, the libraries for the formats raise exceptions of any type, MemoryError included.
    except Exception as error:
        raise LogError(_damaged(path, error)) from error


def _damaged(path: Path, error: Exception) -> str:
    """Error message for a file that a library could not read."""
    reason = " ".join(str(error).split()).rstrip(".")[:160] or type(error).__name__
    return f"{path.name} is cut off or damaged ({reason}): record or copy it again; a log is {LOG_FORMATS}."


def read_table(
    path: Files,
    *,
    columns: str | Path | None = None,
    topic: str | None = None,
    ref_topic: str | None = None,
    joints: Sequence[str] | None = None,
    other_joints: Sequence[str] = (),
) -> Table:
    """Columns of a log under their standard names, after all checks.

    Args:
        path: A file for `read_raw`, or several files of one recording; the topics are those of the first.
        columns: Column map (YAML), see `identification.data.readers.column_map`, or the name of a built-in one, see
            `identification.data.readers.presets`.
        topic: Topic of joint states in a bag that has several.
        ref_topic: Topic of the references in a bag, if it differs from that of the joint states.
        joints: Joint names of the robot in its order, for files that number the joints; None without a robot.
        other_joints: Passive and locked joints of the robot, which a column map may name as well.

    Returns:
        The standard columns; the warnings name the other columns.

    Raises:
        LogError: If a file or the column map cannot be used, or if a standard column cannot be right.
    """
    preset = None if columns is None else preset_of(columns)
    # The column map is checked before a long recording is read.
    column_map = None if columns is None or preset is not None else read_column_map(columns)
    if column_map is not None and joints is not None:
        require_joints(column_map, (*joints, *other_joints))
    by_user = column_map is not None
    path, *others = (path,) if isinstance(path, str | Path) else path
    raw = read_raw(path, topic=topic, ref_topic=ref_topic)
    if others:
        raw = columns_joined(raw, [read_raw(one) for one in others])
    if preset is not None:
        raw = with_neighbours(Path(path), raw) if preset.name == "sage" else raw
        raw = replace(raw, documented_joint_orders=raw.documented_joint_orders or preset.documented_joint_orders)
        column_map = map_of(preset, raw, joints)
    elif column_map is None and raw.asks_units:
        raise LogError(units_question(raw, joints))
    elif column_map is None and (raw.numbered or raw.joint_names):
        column_map = _numbers_of_quantities(raw)
    table = contract_table(raw if column_map is None else mapped(raw, column_map, joints))
    # Advice to change an entry names the file's columns only if the user wrote a map that can be changed.
    return table if by_user else replace(table, named={})


def _numbers_of_quantities(raw: RawTable) -> ColumnMap | None:
    """The column map for numbered columns with standard names, such as ``q[0]``; None without such columns."""
    found = {name: f"{name}[{{number}}]" for name in JOINT_QUANTITIES}
    sources = {name: Source(place, 1.0) for name, place in found.items() if matching(place, raw.names)}
    return ColumnMap(raw.file, sources) if sources else None


def columns_joined(first: RawTable, others: Sequence[RawTable]) -> RawTable:
    """One table with the columns of several files that have the same rows.

    Columns with the same name get the name of their file in front: ``joint1`` of ``pos.csv`` and of ``tau.csv`` become
    ``pos/joint1`` and ``tau/joint1``, which a column map can name. The time is that of the first file that has one.

    Args:
        first: Table of the first file.
        others: Tables of the other files, with the same number of rows.

    Raises:
        LogError: If the files differ in their number of rows or in their times.
    """
    counts = Counter(name for raw in (first, *others) for name in raw.names)
    twice = {name for name, count in counts.items() if count > 1 and name != _TIME}
    out, *others = [_renamed(raw, twice) for raw in (first, *others)]
    for other in others:
        rows, other_rows = _rows(out), _rows(other)
        if rows != other_rows:
            raise LogError(
                f"{out.file} has {rows} rows and {other.file} has {other_rows}: files side by side need the same rows; "
                "cut them alike."
            )
        if _TIME in out.columns and _TIME in other.columns:
            _require_same_times(out, other)
        out = replace(
            out,
            columns={**other.columns, **out.columns},
            problems={**other.problems, **out.problems},
            warnings=(*out.warnings, *other.warnings),
        )
    return out


def _renamed(raw: RawTable, twice: set[str]) -> RawTable:
    """The table with the name of its file in front of the column names that several files have."""
    before = raw.file.rpartition(".")[0] or raw.file
    columns = {f"{before}/{name}" if name in twice else name: values for name, values in raw.columns.items()}
    problems = {f"{before}/{name}" if name in twice else name: problem for name, problem in raw.problems.items()}
    return replace(raw, columns=columns, problems=problems)


def _rows(raw: RawTable) -> int:
    return len(next(iter(raw.columns.values()), ()))


def _require_same_times(first: RawTable, other: RawTable) -> None:
    """Raise an error if a row has different times in two files."""
    t, other_t = first.columns[_TIME], other.columns[_TIME]
    if len(t) < 2:
        return
    differences = np.abs(t - other_t)
    if not float(np.max(differences)) <= _TIME_TOLERANCE * abs(float(np.median(np.diff(t)))):
        row = int(np.argmax(differences))
        raise LogError(
            f"{first.file} and {other.file} have different times, {t[row]:g} s and {other_t[row]:g} s in "
            f"{first.place(row)}: files side by side need the same rows; bring them to one time first."
        )


def table_of(path: Files, robot: Robot, columns: str | Path | None, topic: str | None, ref_topic: str | None) -> Table:
    """Columns of a file under their standard names, see `read_table`.

    If the column names are not standard and exactly one preset fits, this preset is used. Otherwise the error message
    proposes a column map.
    """

    def read(columns: str | Path | None) -> Table:
        return read_table(
            path,
            columns=columns,
            topic=topic,
            ref_topic=ref_topic,
            joints=robot.joint_names,
            other_joints=(*robot.passive_names, *robot.locked),
        )

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
    """The warning that a preset was used although the user did not name one.

    Raises:
        LogError: If the file has motor currents but the robot states no torque constant; the message asks for it.
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
    """A proposed column map with a sentence before it; empty if no column is recognised."""
    suggested = suggested_map(names, robot.joint_names)
    return f" A map to begin with, to be checked and saved as columns.yaml:\n{suggested}" if suggested else ""
