"""Files of a log under the contract's names of columns: CSV, NPZ or Parquet, by ending; nothing is rounded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identification.files import temporary_beside
from phantom_dyn.errors import UsageError

Array = np.ndarray
ENDINGS = (".csv", ".npz", ".parquet")


def require_ending(path: Path) -> None:
    """Refuse a file whose ending names no format that is written.

    Raises:
        UsageError: In a sentence.
    """
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"{path} ends in {path.suffix or 'nothing'}, wanted a log that ends in {', '.join(ENDINGS)}")


def write_log(path: Path, columns: Mapping[str, Float[Array, " N"]]) -> None:
    """Write a log in one step.

    Raises:
        UsageError: If the ending names no format, or the file cannot be written.
    """
    require_ending(path)
    with temporary_beside(path) as temporary:
        if path.suffix.lower() == ".npz":
            with temporary.open("wb") as file:
                np.savez(file, allow_pickle=False, **columns)
        elif path.suffix.lower() == ".parquet":
            import pyarrow as pa
            import pyarrow.parquet as pq

            pq.write_table(pa.table(dict(columns)), temporary)
        else:
            rows = np.column_stack(list(columns.values()))
            np.savetxt(temporary, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
