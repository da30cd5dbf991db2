"""Damaged files: whatever is cut off or overwritten, the answer is a table or a `LogError`, never another exception.

Oracle: the contract (bad input is one clear sentence).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from identification.data.readers.read_table import read_table
from phantom_dyn.errors import LogError

JOINT_STATE = "sensor_msgs/msg/JointState"


def _bag(folder: Path, kind: str, columns) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    types = store.types
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    path = folder / "log.bag" if kind == "bag" else folder / "bag"
    writer = Writer1(path) if kind == "bag" else Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=store)
        for k, t in enumerate((columns["t"] * 1e9).astype(int).tolist()):
            stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=t)
            seq = {"seq": k} if kind == "bag" else {}
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **seq)
            q = np.array([columns["q.a"][k], columns["q.b"][k]])
            state = types[JOINT_STATE](header=header, name=["a", "b"], position=q, velocity=q, effort=q)
            raw = (store.serialize_ros1 if kind == "bag" else store.serialize_cdr)(state, JOINT_STATE)
            writer.write(connection, t + 1, raw)
    return path if kind == "bag" else next(path.glob(f"*.{kind}"))


@pytest.fixture(params=["csv", "npz", "parquet", "bag", "db3", "mcap"])
def log(request, tmp_path, columns, write, lines) -> Path:
    """A good log in each format."""
    if request.param == "csv":
        return write(lines)
    if request.param == "npz":
        np.savez_compressed(tmp_path / "log.npz", **columns)
        return tmp_path / "log.npz"
    if request.param == "parquet":
        pq.write_table(pa.table(columns), tmp_path / "log.parquet")
        return tmp_path / "log.parquet"
    return _bag(tmp_path, request.param, columns)


def refused_or_whole(path: Path) -> bool:
    """True if a log is refused as a log, or read with one value of every column in every row."""
    try:
        table = read_table(path)
    except LogError:
        return True
    return len({len(values) for values in table.columns.values()}) == 1


def test_the_undamaged_log_is_read(log):
    assert len(read_table(log).columns["t"]) == 60


def test_a_log_cut_off_anywhere_is_refused_or_read(log, rng, tmp_path):
    data = log.read_bytes()
    path = tmp_path / f"cut{log.suffix}"
    for size in [0, 1, 7, 16, *rng.integers(17, len(data), 40).tolist()]:
        path.write_bytes(data[:size])
        assert refused_or_whole(path)


def test_a_log_with_overwritten_bytes_is_refused_or_read(log, rng, tmp_path):
    data = log.read_bytes()
    path = tmp_path / f"bad{log.suffix}"
    for _ in range(60):
        damaged = bytearray(data)
        start = int(rng.integers(0, len(data)))
        size = int(rng.integers(1, 30))
        damaged[start : start + size] = rng.bytes(size)
        path.write_bytes(bytes(damaged))
        assert refused_or_whole(path)


def test_half_a_file_says_that_it_is_cut_off(log, tmp_path):
    path = tmp_path / f"half{log.suffix}"
    data = log.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    # Half a CSV ends inside a row; half a bag may lack its index, its messages or its tables.
    with pytest.raises(LogError, match=r"cut off or damaged|values where 7 columns are named|has no|too few"):
        read_table(path)
