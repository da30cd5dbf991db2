"""A recording from any of the known formats, recognised by its first bytes, to a table of the contract's columns.

The libraries behind the formats (pyarrow, rosbags) are imported in the functions that need them: a recording waits for
those of its own format alone.
"""

from __future__ import annotations

from pathlib import Path

from identification.data.readers.array_files import read_npz, read_parquet
from identification.data.readers.column_map import mapped, read_column_map
from identification.data.readers.contract_columns import contract_table
from identification.data.readers.delimited import read_delimited
from identification.data.readers.rosbag import read_ros1_bag, read_ros2_bag
from identification.data.recording import RawTable, Table
from identification.files import LOG_FORMATS, require_existing
from phantom_dyn.errors import LogError, PhantomDynError
from phantom_dyn.model.plain_file import require_plain_file


def _read(path: Path, topic: str | None) -> RawTable:
    """The reader that fits the content."""
    if path.is_dir():
        if not (path / "metadata.yaml").exists():
            raise LogError(f"{path} is a folder without metadata.yaml, so no ROS 2 bag: give a file ({LOG_FORMATS}).")

        return read_ros2_bag(path, topic)
    require_plain_file(path, LogError, f"a log ({LOG_FORMATS})")
    with path.open("rb") as file:
        start = file.read(16)
    if not start:
        raise LogError(f"{path.name} is empty: a log needs rows of numbers; record it again.")
    if start.startswith(b"#ROSBAG V"):
        return read_ros1_bag(path, topic)
    if start.startswith((b"SQLite format 3", b"\x89MCAP")):
        return read_ros2_bag(path, topic)
    if start.startswith(b"PK\x03\x04") or start.startswith(b"PK\x05\x06"):
        return read_npz(path)
    if start.startswith(b"PAR1"):
        return read_parquet(path)

    return read_delimited(path)


def read_raw(path: str | Path, *, topic: str | None = None) -> RawTable:
    """Columns of a file under the file's own names.

    Args:
        path: CSV, NPZ, Parquet, ROS 1 or ROS 2 bag, or MCAP; recognised by its content, not by its ending.
        topic: Topic of sensor_msgs/JointState in a bag that has several.

    Returns:
        Columns as they stand in the file.

    Raises:
        LogError: If the file is missing, empty, damaged or no log.
    """
    path = Path(path)
    require_existing(path)
    try:
        return _read(path, topic)
    except PhantomDynError:
        raise
    except OSError as error:
        if error.errno is not None:
            raise LogError(f"{path} cannot be read: {error.strerror}.") from error
        raise LogError(_damaged(path, error)) from error
    # The libraries behind the formats raise whatever they please on damaged bytes, MemoryError included.
    except Exception as error:
        raise LogError(_damaged(path, error)) from error


def _damaged(path: Path, error: Exception) -> str:
    reason = " ".join(str(error).split()).rstrip(".")[:160] or type(error).__name__
    return f"{path.name} is cut off or damaged ({reason}): record or copy it again; a log is {LOG_FORMATS}."


def read_table(path: str | Path, *, columns: str | Path | None = None, topic: str | None = None) -> Table:
    """Columns of a log under the contract's names, checked and ready to use.

    Args:
        path: See `read_raw`.
        columns: Column map (YAML), see `identification.data.readers.column_map`.
        topic: See `read_raw`.

    Returns:
        The contract's columns; other columns are named in the warnings.

    Raises:
        LogError: If file or map cannot be used, or one of the contract's columns cannot be right.
    """
    if columns is None:
        return contract_table(read_raw(path, topic=topic))

    column_map = read_column_map(columns)
    return contract_table(mapped(read_raw(path, topic=topic), column_map))
