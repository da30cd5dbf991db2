"""A map as an xarray dataset: coordinates, units and what the values are of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phantom_dyn.maps.grid import TIP_AXES, Grid
from phantom_dyn.maps.model import MapModel
from phantom_dyn.maps.operational_map import OperationalMap
from phantom_dyn.maps.quantities import QUANTITIES

if TYPE_CHECKING:
    import xarray

Array = np.ndarray


def arrays(result: OperationalMap) -> dict[str, Array]:
    """Coordinates and quantities by name, as ``map.npz`` holds them."""
    return dict(zip(result.grid.names, result.grid.values, strict=True)) | result.values


def components(name: str) -> tuple[str, ...]:
    """Names of the dimensions of one value of a quantity."""
    kind = QUANTITIES[name].kind
    if kind == "matrix":
        return ("row", "joint") if name == "coulomb_friction" else ("row", "column")
    return ("row",) if kind == "vector" else ()


def axis_unit(axis: str, grid: Grid, model: MapModel) -> str:
    """Unit of a coordinate."""
    if grid.cartesian or model.prismatic[model.joint_names.index(axis.removeprefix("q."))]:
        return "m"
    return "rad"


def dataset(result: OperationalMap) -> xarray.Dataset:
    """The map with its coordinates, units and origin.

    Args:
        result: From `phantom_dyn.maps.operational_map.operational_map`.

    Returns:
        One variable per quantity over the grid's axes, then ``row`` and ``column`` (x, y, z in the root frame) or
        ``joint``.
    """
    import xarray

    model, grid = result.model, result.grid
    coordinates = {
        name: (name, values, {"units": axis_unit(name, grid, model)})
        for name, values in zip(grid.names, grid.values, strict=True)
    }
    used = {part for name in result.values for part in components(name)}
    labels = {"row": list(TIP_AXES), "column": list(TIP_AXES), "joint": list(model.joint_names)}
    coordinates |= {part: (part, labels[part], {}) for part in labels if part in used}
    variables = {
        name: (
            (*grid.names, *components(name)),
            values,
            {"units": QUANTITIES[name].unit or "1", "long_name": QUANTITIES[name].title},
        )
        for name, values in result.values.items()
    }
    if "stiffness" in variables:
        variables["stiffness"][2]["comment"] = model.stiffness_note
    about = {
        "title": f"Operational maps of {model.name}",
        "robot": model.name,
        "frame": model.frame,
        "joints": ", ".join(model.joint_names),
        "configuration": model.posture,
        "points": grid.size,
        "unreachable_points": result.unreachable,
        "singular_points": result.singular,
    }
    return xarray.Dataset(variables, coordinates, about)
