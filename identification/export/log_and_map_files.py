"""Files of a log (CSV, NPZ or Parquet) and of a map (NPZ, NetCDF, figures).

Files of a log under the contract's names of columns: CSV, NPZ or Parquet, by ending; nothing is rounded.

Files of a map: ``map.npz``, ``map.nc`` and a figure of each quantity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identification.files import temporary_beside
from phantom_dyn.errors import UsageError
from phantom_dyn.maps.map_figures import figure
from phantom_dyn.maps.operational_map import OperationalMap, arrays, dataset

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


def write_map(result: OperationalMap, folder: Path, *, say: Callable[[str], None] = lambda words: None) -> list[Path]:
    """Write a map.

    Args:
        result: The map.
        folder: Made if it is missing; files that are not ours stay.
        say: Told what is being written.

    Returns:
        The files.

    Raises:
        UsageError: If a file cannot be written.
    """
    written = [folder / "map.npz", folder / "map.nc"]
    say("writing map.npz")
    with temporary_beside(written[0]) as path, path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays(result))
    say("writing map.nc")
    with temporary_beside(written[1]) as path:
        dataset(result).to_netcdf(path, format="NETCDF4", engine="netcdf4")
    for name in result.values:
        written.append(folder / f"{name}.png")
        say(f"drawing {name}")
        with temporary_beside(written[-1]) as path:
            figure(result, name).savefig(path)
    return written
