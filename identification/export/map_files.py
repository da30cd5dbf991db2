"""Files of a map: ``map.npz``, ``map.nc`` and a figure of each quantity."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from identification.files import temporary_beside
from phantom_dyn.maps.dataset import arrays, dataset
from phantom_dyn.maps.figures import figure
from phantom_dyn.maps.operational_map import OperationalMap


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
