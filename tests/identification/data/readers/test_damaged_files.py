"""Files that are damaged or too large."""

import bz2
import io
import re
import struct
import tracemalloc
import zipfile
from importlib import import_module
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from lz4 import frame
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from identification.data.readers.read_table import read_raw, read_table
from identification.data.readers.unpacked_size import DamagedError, require_small_bag, require_small_mcap
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


GIGABYTE = 10**9

zstd = pytest.importorskip("backports.zstd")


def refusal(path) -> str:
    """What a file is refused with; a failure if its content was unpacked as a whole before."""
    tracemalloc.start()
    try:
        with pytest.raises(LogError) as refused:
            read_raw(path)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
    return str(refused.value)


def npy_head(shape) -> bytes:
    sink = io.BytesIO()
    np.lib.format.write_array_header_1_0(sink, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return sink.getvalue()


def test_zeros_in_an_npz_that_unpack_to_gigabytes(tmp_path):
    path = tmp_path / "log.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("t.npy", "w", force_zip64=True) as t:
        t.write(npy_head((10**8,)))
        for _ in range(300):
            t.write(bytes(10**6))
    assert path.stat().st_size < 1e6
    assert "unpacks to 300 MB or more, which no recording does: record it again" in refusal(path)


def test_an_array_that_declares_more_than_follows(tmp_path):
    path = tmp_path / "log.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("t.npy", npy_head((2**50,)) + bytes(800))
    assert re.search("unpacks to .* MB or more", refusal(path))


def test_parquet_of_one_value_repeated(tmp_path):
    path = tmp_path / "log.parquet"
    rows = 4 * 10**6
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int8)), pa.array([1.0]))
    table = pa.table({f"q.{k}": column for k in range(12)})
    pq.write_table(table, path, compression="zstd", store_schema=False)
    assert path.stat().st_size < 1e6
    assert "unpacks to 384 MB or more" in refusal(path)


def test_texts_of_a_parquet_file_are_not_read(tmp_path):
    path = tmp_path / "log.parquet"
    note = pa.array(["x" * 100_000] * 1000).dictionary_encode()
    pq.write_table(pa.table({"t": np.arange(1000.0), "note": note}), path)
    raw = read_raw(path)
    assert list(raw.columns) == ["t"]
    assert "column note holds" in raw.problems["note"]


def mcap(tmp_path, packing: str, packed: bytes, declared: int, index_at: int | None = None):
    """An MCAP file of one chunk, written from the format's specification."""
    name = packing.encode()
    body = struct.pack("<QQQI", 0, 1, declared, 0) + struct.pack("<I", len(name)) + name
    body += struct.pack("<Q", len(packed)) + packed
    out = b"\x89MCAP0\r\n" + b"\x01" + struct.pack("<Q", 12) + struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0)
    chunk_at = len(out)
    out += b"\x06" + struct.pack("<Q", len(body)) + body
    summary_at = len(out)
    place = chunk_at if index_at is None else index_at
    entry = struct.pack("<QQQQ", 0, 1, place, len(body) + 9) + struct.pack("<I", 0) + struct.pack("<Q", 0)
    entry += struct.pack("<I", len(name)) + name + struct.pack("<QQ", len(packed), declared)
    out += b"\x08" + struct.pack("<Q", len(entry)) + entry
    out += b"\x02" + struct.pack("<Q", 20) + struct.pack("<QQI", summary_at, 0, 0) + b"\x89MCAP0\r\n"
    path = tmp_path / "log.mcap"
    path.write_bytes(out)
    return path


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_a_chunk_of_an_mcap_that_declares_gigabytes(tmp_path, packing):
    assert "unpacks to 3e+03 MB or more" in refusal(mcap(tmp_path, packing, b"1234", 3 * GIGABYTE))


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_a_chunk_of_an_mcap_that_unpacks_to_more_than_it_declares(tmp_path, packing):
    packed = (zstd.compress if packing == "zstd" else frame.compress)(bytes(60_000_000))
    assert "a chunk unpacks to more than it declares" in refusal(mcap(tmp_path, packing, packed, 1000))


def test_an_index_that_points_beside_the_chunks(tmp_path):
    path = mcap(tmp_path, "zstd", zstd.compress(b"x"), 1, index_at=40)
    with pytest.raises(DamagedError, match="its index points at what is no chunk"):
        require_small_mcap(path)


def changed(path, at: int, value: int):
    """The file with eight of its bytes replaced by a number."""
    content = bytearray(path.read_bytes())
    content[at : at + 8] = struct.pack("<Q", value)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("at", [9, 30])
def test_a_record_of_an_mcap_that_is_longer_than_the_file(tmp_path, at):
    # Lengths of the head and of the chunk: a reader asks for as much memory.
    path = mcap(tmp_path, "", b"1234", 4)
    assert path.read_bytes()[at - 1] in (1, 6)
    assert "a record is longer than the file" in refusal(changed(path, at, 3 * GIGABYTE))


def test_a_footer_of_an_mcap_that_stands_before_its_end(tmp_path):
    path = mcap(tmp_path, "", b"1234", 4)
    content = path.read_bytes()
    footer = content[-37:-8]
    path.write_bytes(content[:29] + footer + content[29:])
    with pytest.raises(DamagedError, match="its footer is not at its end"):
        require_small_mcap(path)


def test_an_index_of_an_mcap_that_declares_a_chunk_of_gigabytes(tmp_path):
    path = mcap(tmp_path, "", b"1234", 4)
    packed_at = path.stat().st_size - 37 - 16
    assert struct.unpack("<QQ", path.read_bytes()[packed_at : packed_at + 16]) == (4, 4)
    assert "a chunk that is longer than the file" in refusal(changed(path, packed_at, 3 * GIGABYTE))


def bag_record(head: dict[bytes, bytes], data: bytes) -> bytes:
    fields = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in head.items())
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


@pytest.mark.parametrize(("size", "message"), [(3 * GIGABYTE, "unpacks to 3e"), (1000, "more than it declares")])
def test_a_chunk_of_a_ros1_bag_that_unpacks_to_gigabytes(tmp_path, size, message):
    packed = bz2.compress(bytes(60_000_000))
    head = {b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", size)}
    path = tmp_path / "log.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + bag_record(head, packed))
    assert message in refusal(path)


def test_a_chunk_that_is_cut_off_is_damaged(tmp_path):
    head = {b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", 10**6)}
    path = tmp_path / "log.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + bag_record(head, bz2.compress(bytes(10**6))[:-20]))
    with pytest.raises(DamagedError, match="a chunk is cut off"):
        require_small_bag(path)


def test_the_library_of_zstd_is_that_of_the_reader():
    # Oracle: rosbags, which brings it.
    assert import_module("rosbags.rosbag2.storage_mcap").zstd.__name__ in ("backports.zstd", "compression.zstd")
