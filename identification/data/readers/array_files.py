# pyright: reportAttributeAccessIssue=false
"""Reads files that hold named arrays: NPZ and Parquet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from identification.data.readers.contract_columns import column_of
from identification.data.readers.unpacked_size import require_small_npz, require_small_parquet
from identification.data.recording import RawTable
from phantom_dyn.array_types import Array
from phantom_dyn.errors import LogError, shortened
from phantom_dyn.libraries import is_installed, missing_library

MOST_IN_LIST = 256
"""Largest length of a list in a column; a longer list is an image or a point cloud, not values of joints."""
_NAMES = ("joint_names", "joints", "joint_sequence", "names")
"""Names under which an NPZ file may have an array with the names of its joints."""
_SECONDS = "write seconds as floats"


def numbered(name: str, values: Array) -> dict[str, Array]:
    """An array ``(N, n)`` as columns with names such as ``q[0]``; an array ``(N,)`` as one column with its own name."""
    if values.ndim == 1:
        return {name: values}
    return {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}


def _problem(file: str, name: str, array: Array) -> str | None:
    """The reason why an array cannot be used as columns; None if it can."""
    has_columns = array.ndim == 2 and array.shape[1] <= MOST_IN_LIST and column_of(name) is None
    if array.ndim != 1 and not has_columns:
        return (
            f"{file}: array {shortened(name)} has the shape {array.shape}: write one 1-D array per column, "
            f"named as {shortened(name)}.<joint> where it belongs to a joint."
        )
    if array.dtype.kind not in "fiub":
        wanted = _SECONDS if array.dtype.kind in "mM" else "write floats"
        return f"{file}: array {shortened(name)} holds {array.dtype} where numbers should be: {wanted}."
    return None


def read_npz(path: Path) -> RawTable:
    """Columns of an NPZ file under the file's own names.

    Args:
        path: The file, written by ``numpy.savez`` or ``numpy.savez_compressed``.

    Returns:
        Columns of the file; arrays that cannot be used as columns are listed under ``problems``.

    Raises:
        LogError: If it holds no arrays. Python objects are never loaded; they are listed under ``problems``.
    """
    # The file is opened here because NumPy does not close a file that it cannot read.
    with path.open("rb") as file:
        require_small_npz(path, file)
        return _arrays(path, file)


def _arrays(path: Path, file: BinaryIO) -> RawTable:
    """Columns of an open NPZ file, whose size has been checked."""
    columns, problems = {}, {}
    names: tuple[str, ...] = ()
    with np.load(file, allow_pickle=False) as archive:
        if not archive.files:
            raise LogError(f"{path.name} is empty: an NPZ log needs one array per column.")
        require_unique(path.name, [name.removesuffix(".npy") for name in archive.zip.namelist()])
        for name in archive.files:
            try:
                array = archive[name]
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                problems[name] = (
                    f"{path.name}: array {shortened(name)} holds Python objects, which are not loaded because a "
                    "pickle can run code: write it as an array of floats."
                )
                continue
            if name in _NAMES and array.ndim == 1 and array.dtype.kind == "U":
                names = tuple(str(joint) for joint in array)
                continue
            sentence = _problem(path.name, name, array)
            if sentence is None:
                columns |= numbered(name, _read_only_view(array.astype(float, copy=False)))
            else:
                problems[name] = sentence
    return RawTable(path.name, columns, problems=problems, joint_names=names)


def _read_only_view(array: Array) -> Array:
    """The array, made read-only so that no later stage has to copy it.

    NumPy may return a view of another array of the same shape. The other array is then made read-only and returned.
    """
    original = array.base
    if (
        isinstance(original, np.ndarray)
        and (original.shape, original.dtype) == (array.shape, array.dtype)
        and array.ndim == 1
    ):
        array = original
    array.flags.writeable = False
    return array


def require_unique(file: str, names: Iterable[str]) -> None:
    """Raise an error if two columns have the same name."""
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise LogError(
            f"{file}: the column name {shortened(repeated[0])} is there twice: give every column its own name."
        )


def _holds_numbers(kind: Any) -> bool:
    """True for an Arrow type that can be converted to floats."""
    import pyarrow as pa

    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)


def _holds_lists(kind: Any) -> bool:
    """True for an Arrow type that can be converted to lists of floats."""
    import pyarrow as pa

    lists = pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    return lists and _holds_numbers(kind.value_type)


def _floats(chunks: Any) -> Array:
    """A column of numbers as floats; a missing value becomes NaN."""
    import pyarrow as pa

    # Arrow's own `to_numpy` imports pandas, which takes longer than reading the file, and ignores Ctrl-C.
    values = chunks.cast(pa.float64()).fill_null(float("nan"))
    return np.concatenate([np.empty(0), *map(np.from_dlpack, values.chunks)])


def _list_column(file: str, name: str, chunks: Any) -> Array | str:
    """A column of lists as an array ``(N, n)``, or the reason why it cannot be used."""
    import pyarrow as pa
    import pyarrow.compute as pc

    lengths = _floats(pc.list_value_length(chunks))
    if not len(lengths):
        return np.empty((0, 0))
    if not np.all(lengths == lengths[0]) or lengths[0] > MOST_IN_LIST:
        row = int(np.argmax(lengths != lengths[0]))
        return (
            f"{file}: column {name} holds lists of {lengths[0]:g} numbers in row 1 and {lengths[row]:g} in row "
            f"{row + 1}, wanted one number per joint in every row, at most {MOST_IN_LIST}."
        )
    flat = pc.list_flatten(chunks)
    return _floats(flat if isinstance(flat, pa.ChunkedArray) else pa.chunked_array([flat])).reshape(len(lengths), -1)


def parquet_columns(file: str, table: Any) -> tuple[dict[str, Array], dict[str, str]]:
    """Columns of an Arrow table, with lists as one column per index, and for unusable columns the reason."""
    columns: dict[str, Array] = {}
    problems: dict[str, str] = {}
    for name, kind in zip(table.schema.names, table.schema.types, strict=True):
        values = _list_column(file, name, table.column(name)) if _holds_lists(kind) else _floats(table.column(name))
        if isinstance(values, str):
            problems[name] = values
        else:
            columns |= numbered(name, values)
    return columns, problems


def open_parquet(path: Path) -> Any:
    """An open Parquet file, after its declared sizes have been checked.

    Raises:
        LogError: If it declares too large sizes, repeats a column name, or the library is not installed.
    """
    if not is_installed("pyarrow"):
        raise LogError(f"{path.name} is Parquet. {missing_library('pyarrow')}")
    import pyarrow.parquet as pq

    file = pq.ParquetFile(path)
    require_small_parquet(path, file.metadata)
    require_unique(path.name, file.schema_arrow.names)
    return file


def read_parquet(path: Path) -> RawTable:
    """Columns of a Parquet file under the file's own names; a missing value becomes NaN.

    Args:
        path: The file.

    Returns:
        Columns of the file; those that hold no numbers are listed under ``problems``.

    Raises:
        LogError: If the file declares too large sizes, repeats a column name, or the library is not installed.
    """
    file = open_parquet(path)
    import pyarrow as pa

    kinds = dict(zip(file.schema_arrow.names, file.schema_arrow.types, strict=True))
    # Only columns of numbers are read, as texts may be of any size.
    wanted = [name for name, kind in kinds.items() if _holds_numbers(kind) or _holds_lists(kind)]
    columns, problems = parquet_columns(path.name, file.read(columns=wanted))
    problems |= {
        name: f"{path.name}: column {shortened(name)} holds {kind} where numbers should be: "
        f"{_SECONDS if pa.types.is_temporal(kind) else 'write floats'}."
        for name, kind in kinds.items()
        if name not in wanted
    }
    return RawTable(path.name, columns, problems=problems)
