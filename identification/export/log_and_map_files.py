"""Writes logs (CSV, NPZ or Parquet, by the file's ending) and maps (NPZ, NetCDF and figures) without rounding."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from zipfile import ZipFile

import numpy as np

from identification.csv_cells import header_line
from identification.file_sets import renamed_together
from identification.files import require_ending, temporary_beside
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import UsageError
from phantom_dyn.libraries import is_installed, missing_library
from phantom_dyn.maps.map_figures import figure
from phantom_dyn.maps.operational_map import OperationalMap, arrays, dataset

if TYPE_CHECKING:
    from xarray import Dataset

NETCDF = "map.nc"


def write_log(path: Path, columns: Mapping[str, Float[Array, " N"]]) -> None:
    """Write a log; an existing file of this name is replaced only when the new file is complete.

    Raises:
        UsageError: If the ending is unknown, the format's library is not installed, or the file cannot be written.
    """
    require_ending(path)
    if path.suffix.lower() == ".parquet" and not is_installed("pyarrow"):
        raise UsageError(f"{path.name} would be Parquet. {missing_library('pyarrow')}")
    with temporary_beside(path) as temporary:
        if path.suffix.lower() == ".npz":
            with temporary.open("wb") as file:
                np.savez(file, allow_pickle=False, **columns)
        elif path.suffix.lower() == ".parquet":
            import pyarrow as pa  # optional, and only needed for Parquet
            import pyarrow.parquet as pq

            pq.write_table(pa.table(dict(columns)), temporary)
        else:
            rows = np.column_stack(list(columns.values()))
            np.savetxt(temporary, rows, delimiter=",", header=header_line(columns), comments="", fmt="%.17g")


def write_map(result: OperationalMap, folder: Path, *, progress: Progress = lambda _: None) -> list[Path]:
    """Write a map; ``map.nc`` only if the library for NetCDF is installed.

    Args:
        result: The map.
        folder: The folder, which is created if it is missing; its other files are kept.
        progress: Called at the start of each stage.

    Returns:
        Paths of the written files.

    Raises:
        UsageError: If a file cannot be written.
    """
    netcdf = (NETCDF,) if is_installed("netCDF4") and is_installed("xarray") else ()
    written = [folder / name for name in ("map.npz", *netcdf, *(f"{name}.png" for name in result.values))]
    with renamed_together(folder) as temporary_path:
        progress(Announcement(Stage.WRITING, detail={"file": "map.npz"}))
        made = temporary_path(written[0])
        with made.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays(result))
        with ZipFile(made, "a") as archive:
            archive.comment = b"phantom-dyn"  # `files.require_own` lets a later run overwrite only files with this mark
        if netcdf:
            progress(Announcement(Stage.WRITING, detail={"file": NETCDF}))
            _write_netcdf(dataset(result), temporary_path(written[1]))
        for name, path in zip(result.values, written[1 + len(netcdf) :], strict=True):
            progress(Announcement(Stage.DRAWING, detail={"file": name}))
            figure(result, name).savefig(temporary_path(path))
    return written


def _write_netcdf(data: Dataset, path: Path) -> None:
    """Write a data set as NetCDF.

    The library raises an unspecific error if the disk is full, so its error is replaced by one that names this cause.
    It also refuses to write a locked file, and `temporary_beside` locks ``path``, so the file is written in a temporary
    folder and then copied.
    """
    with TemporaryDirectory() as folder:
        made = Path(folder) / path.name
        try:
            data.to_netcdf(made, format="NETCDF4", engine="netcdf4")
        except RuntimeError as error:
            raise OSError(None, f"{error}, as on a full disk") from error
        shutil.copyfile(made, path)
