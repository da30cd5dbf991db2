# pyright: reportAttributeAccessIssue=false
"""Parquet: one column of numbers per column."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from identification.data.readers.raw import RawTable
from phantom_dyn.errors import LogError


def read_parquet(path: Path) -> RawTable:
    """Columns of a Parquet file under the file's own names; a missing value becomes NaN.

    Args:
        path: The file.

    Returns:
        Its columns; those that hold no numbers are listed under ``problems``.

    Raises:
        LogError: If a column name stands there twice.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.ParquetFile(path).read()
    twice = [name for name, count in Counter(table.column_names).items() if count > 1]
    if twice:
        raise LogError(f"{path.name}: the column name {twice[0]} stands there twice: give every column its own name.")
    columns, problems = {}, {}
    for name, kind in zip(table.column_names, table.schema.types, strict=True):
        if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
            columns[name] = np.asarray(table.column(name).cast(pa.float64()).to_numpy(), dtype=float)
        else:
            problems[name] = f"{path.name}: column {name} holds {kind} where numbers should be: write floats."
    return RawTable(path.name, columns, problems)
