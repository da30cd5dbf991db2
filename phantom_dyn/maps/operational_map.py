"""Computes a map (quantities at every point of a grid) in one or several processes, and converts it to xarray."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from phantom_dyn.array_types import Array
from phantom_dyn.large_work import spread, starts_processes, worker_count
from phantom_dyn.libraries import optional_library
from phantom_dyn.maps.grid import TIP_AXES, Grid
from phantom_dyn.maps.inverse import Cloud, cloud_of, nearest_branch, require_determined
from phantom_dyn.maps.map_model import MapModel, tip_of, within_limits
from phantom_dyn.maps.quantities import QUANTITIES, felt_at, require_quantities, shape_of

if TYPE_CHECKING:
    import xarray

BLOCK = 8192
"""Number of points computed at once; their arrays need some tens of megabytes."""
SLOW_BLOCK = 1024
"""Number of points computed at once if each of them needs a numerical search, which takes far longer."""
LARGEST_CHUNK = 16
"""Largest number of blocks that one call of a worker computes; their result needs some tens of megabytes."""
FEW_BLOCKS = 8
"""Number of blocks below which this process computes alone, because other processes need a second to start."""


@dataclass(frozen=True)
class OperationalMap:
    """Quantities over a grid.

    Attributes:
        model: The robot.
        grid: The points.
        values: Arrays by quantity, with the shape of the grid, then that of one value; NaN at points that are out of
            reach or singular.
        unreachable: Number of points that are out of reach within the limits.
        singular: Number of points at which the tip cannot move in some direction.
    """

    model: MapModel
    grid: Grid
    values: dict[str, Array]
    unreachable: int
    singular: int


def operational_map(
    model: MapModel,
    grid: Grid,
    names: Iterable[str],
    *,
    jobs: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> OperationalMap:
    """Quantities at every point of a grid.

    Args:
        model: Result of `phantom_dyn.maps.map_model.map_model`.
        grid: Grid over the tip or over joints. Other coordinates stay as in ``model.posture``.
        names: Names of quantities.
        jobs: Largest number of processes; by default one per processor core. For Dask or Ray use
            `joblib.parallel_config`, see `phantom_dyn.large_work`.
        progress: Function that is called with the number of finished points.

    Raises:
        ParameterError: If a quantity is unknown or cannot be computed, a grid over the tip does not determine the
            active joints, or ``jobs`` is below one.
        WorkerLostError: If worker processes end repeatedly.
    """
    names = tuple(dict.fromkeys(names))
    require_quantities(names, model)
    if grid.cartesian:
        require_determined(model, grid.names)
    job = _Job(model, grid, names, cloud_of(model) if grid.cartesian else None)
    values = {name: np.empty((grid.size, *shape_of(name, model.nv))) for name in names}
    done = unreachable = singular = 0
    for block in _blocks(job, jobs):
        for name in names:
            values[name][block.start : block.stop] = block.values[name]
        done += block.stop - block.start
        unreachable += block.unreachable
        singular += block.singular
        if progress is not None:
            progress(done)
    shaped = {name: array.reshape(*grid.shape, *array.shape[1:]) for name, array in values.items()}
    return OperationalMap(model, grid, shaped, unreachable, singular)


def arrays(result: OperationalMap) -> dict[str, Array]:
    """Coordinates and quantities by name, which are the content of ``map.npz``."""
    return dict(zip(result.grid.names, result.grid.values, strict=True)) | result.values


def components(name: str) -> tuple[str, ...]:
    """Names of the dimensions of one value of a quantity."""
    kind = QUANTITIES[name].kind
    if kind == "matrix":
        return ("row", "joint") if QUANTITIES[name].columns == "joints" else ("row", "column")
    return ("row",) if kind == "vector" else ()


def axis_unit(axis: str, grid: Grid, model: MapModel) -> str:
    """Unit of a coordinate."""
    if grid.cartesian or model.robot.prismatic[model.joint_names.index(axis.removeprefix("q."))]:
        return "m"
    return "rad"


def dataset(result: OperationalMap) -> xarray.Dataset:
    """The map with its coordinates, units and origin.

    Args:
        result: Result of `operational_map`.

    Returns:
        One variable per quantity over the grid's axes, then ``row`` and ``column`` (x, y, z in the root frame) or
        ``joint``.

    Raises:
        UsageError: If xarray is missing.
    """
    # Imported here, because the import takes longer than a small map.
    xarray = optional_library("xarray")
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


@dataclass(frozen=True)
class _Job:
    """Arguments of a map that all blocks share."""

    model: MapModel
    grid: Grid
    names: tuple[str, ...]
    cloud: Cloud | None


@dataclass(frozen=True)
class _Block:
    """Quantities of the points ``start`` to ``stop``, and numbers of points out of reach and of singular points."""

    start: int
    stop: int
    values: dict[str, Array] = field(repr=False)
    unreachable: int = 0
    singular: int = 0


def _blocks(job: _Job, jobs: int | None) -> Iterator[_Block]:
    """Blocks of the map, in the order in which they are finished; few blocks are computed by this process alone."""
    size = job.grid.size
    slow = job.cloud is not None or job.model.closed_numerically
    block = min(BLOCK, SLOW_BLOCK) if slow else BLOCK
    spans = [(start, min(start + block, size)) for start in range(0, size, block)]
    if jobs is None and len(spans) < FEW_BLOCKS and not slow and starts_processes():
        jobs = 1
    workers = worker_count(jobs)
    # There are more chunks than workers, so that all workers finish at about the same time.
    chunk = 1 if workers == 1 else min(LARGEST_CHUNK, math.ceil(len(spans) / (4 * workers)))
    pieces = ((job, spans[k : k + chunk]) for k in range(0, len(spans), chunk))
    for _, found in spread(_chunk, pieces, jobs=jobs):
        yield from found


def _chunk(job: _Job, spans: list[tuple[int, int]]) -> list[_Block]:
    """Quantities of several blocks of points, as one call of a worker."""
    return [_block(job, *span) for span in spans]


def _block(job: _Job, start: int, stop: int) -> _Block:
    """Quantities of the points ``start`` to ``stop``."""
    model = job.model
    q = _joint_positions(job, start, stop)
    rows = np.flatnonzero(np.isfinite(q).all(axis=1))
    rows = rows[within_limits(model, q[rows])]
    values = {name: np.full((stop - start, *shape_of(name, model.nv)), np.nan) for name in job.names}
    singular = 0
    if len(rows):
        found, mask = felt_at(model, q[rows], job.names)
        for name in job.names:
            values[name][rows] = found[name]
        singular = int(mask.sum())
    return _Block(start, stop, values, stop - start - len(rows), singular)


def _joint_positions(job: _Job, start: int, stop: int) -> Array:
    """Active positions of the points; NaN where a point is out of reach."""
    model, points = job.model, job.grid.points(start, stop)
    if job.grid.cartesian:
        tip = np.repeat(tip_of(model, model.posture[None])[0], len(points), axis=0)
        axes = tuple(TIP_AXES.index(name) for name in job.grid.names)
        tip[:, list(axes)] = points
        return nearest_branch(model, tip, job.cloud, axes if model.nv == 2 else (0, 1, 2))
    q = np.repeat(model.posture[None], len(points), axis=0)
    q[:, [model.joint_names.index(name.removeprefix("q.")) for name in job.grid.names]] = points
    return q
