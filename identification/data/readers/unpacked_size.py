"""Refuses compressed logs that decompress to far more data than a recording can have (decompression bombs).

The libraries that read these formats decompress a whole chunk, whatever size it declares. So the declared sizes are
added up first. Chunks of a bag may decompress to more than they declare. They are decompressed once in small steps, and
the result is not kept.
"""

from __future__ import annotations

import bz2
import math
import struct
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from phantom_dyn.errors import LogError

_ALLOWED_SIZE = 200_000_000
"""Decompressed size that is always allowed [bytes]: position and torque of seven joints for an hour at 1 kHz."""
_ALLOWED_RATIO = 50
"""Largest compression ratio that is allowed for larger logs; the ratio of measured numbers is below ten."""
_STEP_SIZE = 1_000_000  # bytes that are decompressed at once
_MAGIC_SIZE = 8  # bytes at the start and at the end of an MCAP file
_NUMBER_SIZE = 8  # bytes of a number in memory
_FOOTER, _CHUNK, _CHUNK_INDEX = 2, 6, 8  # kinds of record in an MCAP file
_BAG_CHUNK, _BAG_CHUNK_INDEX = b"\5", b"\6"  # kinds of record in a ROS 1 bag


class DamagedError(ValueError):
    """The structure of a compressed file contradicts itself."""


def require_unpacked_size(path: Path, size: int) -> None:
    """Raise an error if a log decompresses to more than a file of its size can contain.

    Args:
        path: The file.
        size: Size after decompression [bytes].

    Raises:
        LogError: If it is too large; the message states both sizes.
    """
    compressed = path.stat().st_size
    if size > max(_ALLOWED_SIZE, _ALLOWED_RATIO * compressed):
        raise LogError(
            f"{path.name} has {compressed / 1e6:.3g} MB and unpacks to {size / 1e6:.3g} MB or more, which no recording "
            "does: record it again, or write it without compression."
        )


def require_small_npz(path: Path, file: BinaryIO) -> None:
    """Raise an error for an NPZ file whose arrays declare more numbers than a file of its size can hold."""
    with zipfile.ZipFile(file) as archive:
        numbers = 0
        for entry in archive.infolist():
            require_unpacked_size(path, entry.file_size)
            if entry.filename.endswith(".npy"):
                with archive.open(entry) as array:
                    numbers += _declared_numbers(array)
        require_unpacked_size(path, _NUMBER_SIZE * numbers)
    file.seek(0)


def _declared_numbers(array: Any) -> int:
    """Count of numbers that the header of an array file declares; 0 if it is no array file."""
    try:
        version = np.lib.format.read_magic(array)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = read(array)
    except ValueError:
        return 0
    return math.prod(max(int(length), 0) for length in shape) * max(1, kind.itemsize // _NUMBER_SIZE)


def require_small_parquet(path: Path, metadata: Any) -> None:
    """Raise an error for a Parquet file that declares more numbers or larger pages than a file of its size can hold."""
    require_unpacked_size(path, _NUMBER_SIZE * metadata.num_rows * max(1, metadata.num_columns))
    groups = (metadata.row_group(k) for k in range(metadata.num_row_groups))
    columns = [group.column(k) for group in groups for k in range(group.num_columns)]
    require_unpacked_size(path, sum(max(0, column.total_uncompressed_size) for column in columns))
    # In columns of lists, a row may hold any number of values.
    require_unpacked_size(path, _NUMBER_SIZE * sum(max(0, column.num_values) for column in columns))


@dataclass(frozen=True)
class _Chunk:
    """Compressed chunk of a bag: method, first byte and length in the file, and declared size after decompression."""

    compression: str
    start: int
    compressed: int
    declared: int


def require_small_mcap(path: Path) -> None:
    """Check the sizes of the chunks of an MCAP file.

    Raises:
        LogError: If they decompress to more than a file of this size can contain.
        DamagedError: If a chunk decompresses to more than it declares, the index points to something else than a chunk,
            or a record is longer than the file (a reader allocates the declared memory).
    """
    with path.open("rb") as file:
        file.seek(_MAGIC_SIZE)
        starts, chunks, indexed = set(), [], set()
        for start, kind, length in _mcap_records(file, path.stat().st_size):
            starts.add(start)
            if kind == _CHUNK:
                *_, declared, _, name = struct.unpack("<QQQII", file.read(32))
                compression = file.read(name).decode()
                (compressed,) = struct.unpack("<Q", file.read(8))
                chunks.append((start, _Chunk(compression, file.tell(), min(compressed, length), declared)))
            elif kind == _CHUNK_INDEX:
                indexed.add(_indexed_chunk(file.read(length), path.stat().st_size))
            elif kind == _FOOTER:
                summary = struct.unpack("<Q", file.read(8))[0]
                if summary and summary not in starts:
                    raise DamagedError("its summary is not where it should be")
        if indexed - {start for start, _ in chunks}:
            raise DamagedError("its index points at what is no chunk")
        _require_small_chunks(path, file, [chunk for _, chunk in chunks])


def _mcap_records(file: BinaryIO, size: int) -> Iterator[tuple[int, int, int]]:
    """Start, kind and length of every record; the file position is then at the beginning of the record's content."""
    start = file.tell()
    while start + 9 <= size:
        file.seek(start)
        kind, length = struct.unpack("<BQ", file.read(9))
        if start + 9 + length > size:
            raise DamagedError("a record is longer than the file")
        if kind == _FOOTER and start + 9 + length + _MAGIC_SIZE != size:
            raise DamagedError("its footer is not at its end")
        yield start, kind, length
        if kind == _FOOTER:  # the last record
            return
        start += 9 + length


def _indexed_chunk(record: bytes, size: int) -> int:
    """Start of the chunk to which an entry of the index points; ``size`` is the size of the file."""
    (start,) = struct.unpack_from("<Q", record, 16)
    offset = 32
    # This skips the offsets of messages, their length, and the name of the compression.
    offset += 4 + struct.unpack_from("<I", record, offset)[0] + 8
    offset += 4 + struct.unpack_from("<I", record, offset)[0]
    if struct.unpack_from("<Q", record, offset)[0] > size:
        raise DamagedError("its index declares a chunk that is longer than the file")
    return start


def require_small_bag(path: Path) -> None:
    """Check the sizes of the chunks of a ROS 1 bag.

    Raises:
        LogError: If they decompress to more than a file of this size can contain.
        DamagedError: If a chunk decompresses to more than it declares, or the index points to something else than a
            chunk.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        file.readline()
        chunks, indexed, start = [], set(), file.tell()
        while start + 8 <= size:
            file.seek(start)
            (head,) = struct.unpack("<I", file.read(4))
            fields = _bag_fields(file.read(min(head, size)))
            (length,) = struct.unpack("<I", file.read(4))
            kind = fields.get(b"op", b"")
            if kind == _BAG_CHUNK:
                declared = int.from_bytes(fields.get(b"size", b""), "little")
                chunks.append((start, _Chunk(fields.get(b"compression", b"").decode(), file.tell(), length, declared)))
            elif kind == _BAG_CHUNK_INDEX:
                indexed.add(int.from_bytes(fields.get(b"chunk_pos", b""), "little"))
            start += 8 + head + length
        if indexed - {place for place, _ in chunks}:
            raise DamagedError("its index points at what is no chunk")
        _require_small_chunks(path, file, [chunk for _, chunk in chunks])


def _bag_fields(head: bytes) -> dict[bytes, bytes]:
    """Fields in the header of a record of a ROS 1 bag."""
    out, offset = {}, 0
    while offset + 4 <= len(head):
        (length,) = struct.unpack_from("<I", head, offset)
        name, _, value = head[offset + 4 : offset + 4 + length].partition(b"=")
        out[name] = value
        offset += 4 + length
    return out


def _require_small_chunks(path: Path, file: BinaryIO, chunks: list[_Chunk]) -> None:
    require_unpacked_size(path, sum(chunk.declared for chunk in chunks))
    for chunk in chunks:
        if chunk.compression in _DECOMPRESSORS:
            file.seek(chunk.start)
            _require_declared(file.read(chunk.compressed), chunk)


def _require_declared(data: bytes, chunk: _Chunk) -> None:
    """Raise an error for a chunk that decompresses to more than it declares; the decompressed data are not kept."""
    size = 0
    while data:
        decompressor = _DECOMPRESSORS[chunk.compression]()
        while not decompressor.eof:
            data_out = decompressor.decompress(data, max_length=_STEP_SIZE)
            data = b""
            size += len(data_out)
            if size > chunk.declared:
                raise DamagedError("a chunk unpacks to more than it declares")
            if not data_out and decompressor.needs_input:
                raise DamagedError("a chunk is cut off")
        data = decompressor.unused_data or b""


def _lz4_decompressor() -> Any:
    from lz4.frame import LZ4FrameDecompressor

    return LZ4FrameDecompressor()


def _zstd_decompressor() -> Any:
    # In the standard library since Python 3.14; before that, rosbags depends on the backport.
    zstd = import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
    return zstd.ZstdDecompressor()


_DECOMPRESSORS = {"bz2": bz2.BZ2Decompressor, "lz4": _lz4_decompressor, "zstd": _zstd_decompressor}
