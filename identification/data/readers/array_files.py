# pyright: reportAttributeAccessIssue=false
"""Readers of files that hold arrays by name: NPZ (one 1-D array per column) and Parquet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from identification.data.readers.unpacked_size import require_small_npz, require_small_parquet
from identification.data.recording import RawTable
from phantom_dyn.errors import LogError
from phantom_dyn.libraries import is_installed, missing_library

Array = np.ndarray


def _problem(file: str, name: str, array: Array) -> str | None:
    """Why an array cannot be a column, or None if it can."""
    if array.ndim != 1:
        return (
            f"{file}: array {name} has the shape {array.shape}: write one 1-D array per column, "
            f"named as {name}.<joint> where it belongs to a joint."
        )
    if array.dtype.kind not in "fiub":
        return f"{file}: array {name} holds {array.dtype} where numbers should be: write floats."
    return None


def read_npz(path: Path) -> RawTable:
    """Columns of an NPZ file under the file's own names.

    Args:
        path: The file, written by ``numpy.savez`` or ``numpy.savez_compressed``.

    Returns:
        Its columns; arrays that are no columns of numbers are listed under ``problems``.

    Raises:
        LogError: If it holds no arrays, or Python objects (those are never loaded).
    """
    # Opened here, as NumPy leaves a file open that it cannot read.
    with path.open("rb") as file:
        require_small_npz(path, file)
        return _arrays(path, file)


def _arrays(path: Path, file: BinaryIO) -> RawTable:
    """Columns of an open NPZ file that is known to be of a reasonable size."""
    columns, problems = {}, {}
    with np.load(file, allow_pickle=False) as archive:
        if not archive.files:
            raise LogError(f"{path.name} is empty: an NPZ log needs one array per column.")
        _require_unique(path, [name.removesuffix(".npy") for name in archive.zip.namelist()])
        for name in archive.files:
            try:
                array = archive[name]
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                problems[name] = (
                    f"{path.name}: array {name} holds Python objects, which are not loaded because a pickle can run "
                    "code: write it as an array of floats."
                )
                continue
            sentence = _problem(path.name, name, array)
            if sentence is None:
                columns[name] = array.astype(float, copy=False)
            else:
                problems[name] = sentence
    return RawTable(path.name, columns, problems)


def _require_unique(path: Path, names: Iterable[str]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise LogError(f"{path.name}: the column name {twice[0]} stands there twice: give every column its own name.")


def _holds_numbers(kind: Any) -> bool:
    """True for a type of Arrow that becomes floats."""
    import pyarrow as pa

    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)


def read_parquet(path: Path) -> RawTable:
    """Columns of a Parquet file under the file's own names; a missing value becomes NaN.

    Args:
        path: The file.

    Returns:
        Its columns; those that hold no numbers are listed under ``problems``.

    Raises:
        LogError: If a column name stands there twice, or the library for Parquet is not installed.
    """
    if not is_installed("pyarrow"):
        raise LogError(f"{path.name} is Parquet. {missing_library('pyarrow')}")
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = pq.ParquetFile(path)
    require_small_parquet(path, file.metadata)
    kinds = dict(zip(file.schema_arrow.names, file.schema_arrow.types, strict=True))
    _require_unique(path, file.schema_arrow.names)
    # Nothing but numbers is read: texts may be of any size.
    table = file.read(columns=[name for name, kind in kinds.items() if _holds_numbers(kind)])
    columns, problems = {}, {}
    for name, kind in kinds.items():
        if _holds_numbers(kind):
            # Arrow's own `to_numpy` imports pandas, which takes longer than the reading and swallows a Ctrl-C.
            numbers = table.column(name).cast(pa.float64()).fill_null(float("nan"))
            columns[name] = np.concatenate([np.empty(0), *map(np.from_dlpack, numbers.chunks)])
        else:
            problems[name] = f"{path.name}: column {name} holds {kind} where numbers should be: write floats."
    return RawTable(path.name, columns, problems)
