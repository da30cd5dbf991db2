"""List of optional libraries: the extra that installs each of them, and the message if a library is missing."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from phantom_dyn.errors import UsageError


@dataclass(frozen=True)
class Library:
    """An optional library.

    Attributes:
        module: Name of the module.
        distribution: Name of the package that contains the module.
        extra: Extra of phantom-dyn that installs the package.
        use: Use that needs the library, with which a message begins.
    """

    module: str
    distribution: str
    extra: str
    use: str


OPTIONAL = (
    Library("rosbags", "rosbags", "ros", "Reading a ROS bag or MCAP"),
    Library("pyarrow", "pyarrow", "parquet", "Reading or writing Parquet"),
    Library("pandas", "pandas", "tables", "A table of findings, parameters or columns"),
    Library("xarray", "xarray", "tables", "An array with coordinates"),
    Library("netCDF4", "netcdf4", "maps", "Writing a map as NetCDF"),
    Library("xarray", "xarray", "maps", "Writing a map as NetCDF"),
    Library("dask", "dask", "cluster", "Work on a Dask cluster"),
    Library("distributed", "distributed", "cluster", "Work on a Dask cluster"),
    Library("example_robot_data", "example-robot-data", "examples", "A robot of example:NAME"),
    Library("viser", "viser", "view", "A replay in the browser"),
)
"""All optional libraries, which the extras of ``pyproject.toml`` list, too."""


def is_installed(module: str) -> bool:
    """True if a module can be imported; it is not imported."""
    return find_spec(module) is not None


def optional_library(module: str) -> ModuleType:
    """The module of an optional library.

    Raises:
        UsageError: If it is not installed; the message says how to install it.
    """
    if not is_installed(module):
        raise UsageError(missing_library(module))
    return import_module(module)


def missing_library(module: str) -> str:
    """Message for a library that is not installed, with the command that installs it."""
    one = next(library for library in OPTIONAL if library.module == module)
    return f"{one.use} needs {one.distribution}, which is not installed: pip install 'phantom-dyn[{one.extra}]'."
