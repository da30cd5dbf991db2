"""Grid of tip positions or joint positions for a map, read from a text such as ``x=START:STOP:COUNT,y=...``."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array
from phantom_dyn.errors import ParameterError, known_names

TIP_AXES = ("x", "y", "z")
MOST_POINTS = 20_000_000
"""Largest number of points of a grid: one 3 x 3 matrix for each of so many points takes 1.4 GB."""
# Largest coordinate of a grid [m or rad]: far beyond any robot, and still small enough for figures.
_FARTHEST = 1e6


@dataclass(frozen=True)
class Grid:
    """Points of a grid in the order of its axes; the last axis changes fastest.

    Attributes:
        names: ``x``, ``y``, ``z``, or ``q.<joint>``.
        values: Coordinates along each axis [m or rad], both ends included.
    """

    names: tuple[str, ...]
    values: tuple[Array, ...]

    @property
    def cartesian(self) -> bool:
        """True for a grid over the position of the tip."""
        return self.names[0] in TIP_AXES

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points along each axis."""
        return tuple(len(values) for values in self.values)

    @property
    def size(self) -> int:
        """Number of all points."""
        return math.prod(self.shape)

    def points(self, start: int, stop: int) -> Array:
        """Coordinates of points ``start`` to ``stop`` in order, shape ``(stop - start, axes)``."""
        index = np.unravel_index(np.arange(start, stop), self.shape)
        return np.stack([values[i] for values, i in zip(self.values, index, strict=True)], axis=-1)


def read_grid(text: str, joint_names: tuple[str, ...]) -> Grid:
    """Grid from its text.

    Args:
        text: For example ``x=-0.1:0.1:41,y=0:0:1`` or ``q.theta1=-1:1:21``.
        joint_names: Active joints of the robot.

    Raises:
        ParameterError: If the text cannot be read; the message says which axis and what is wanted.
    """
    names, values = [], []
    for part in text.split(","):
        name, mark, span = (piece.strip() for piece in part.partition("="))
        if not mark:
            raise ParameterError(f"The grid has {part.strip()!r}, wanted NAME=START:STOP:COUNT such as x=-0.1:0.1:41.")
        _require_axis(name, joint_names)
        if name in names:
            raise ParameterError(f"The grid has the axis {name} twice: give it once.")
        names.append(name)
        values.append(_axis(name, span))
    if len({name in TIP_AXES for name in names}) > 1:
        raise ParameterError(
            f"The grid mixes {', '.join(names)}: give a grid over the tip (x, y, z) or one over joints (q.<joint>)."
        )
    grid = Grid(tuple(names), tuple(values))
    if grid.size > MOST_POINTS:
        raise ParameterError(f"The grid has {grid.size} points, wanted at most {MOST_POINTS}: take larger steps.")
    return grid


def _require_axis(name: str, joint_names: tuple[str, ...]) -> None:
    """Refuse an axis that is neither x, y, z nor ``q.`` with the name of an active joint."""
    axes = [*TIP_AXES, *(f"q.{joint}" for joint in joint_names)]
    if name not in axes:
        raise ParameterError(f"The grid has the unknown axis {name!r}: {known_names(name, axes, 'axes')}")


def _axis(name: str, span: str) -> Array:
    """Coordinates along one axis, from the text ``START:STOP:COUNT``."""
    wanted = "wanted START:STOP:COUNT such as -0.1:0.1:41"
    parts = span.split(":")
    try:
        start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        raise ParameterError(f"The axis {name} of the grid is {span!r}, {wanted}.") from None
    if len(parts) != 3 or not (math.isfinite(start) and math.isfinite(stop)):
        raise ParameterError(f"The axis {name} of the grid is {span!r}, {wanted}.")
    if max(abs(start), abs(stop)) > _FARTHEST:
        raise ParameterError(f"The axis {name} of the grid is {span!r}: give m or rad, up to {_FARTHEST:g}.")
    if count < 1 or (start == stop) != (count == 1):
        raise ParameterError(
            f"The axis {name} of the grid is {span!r}: give START and STOP apart with at least 2 points, or both the "
            "same with 1 point."
        )
    if count > MOST_POINTS:
        raise ParameterError(f"The axis {name} of the grid has {count} points, wanted at most {MOST_POINTS}.")
    return np.linspace(start, stop, count)
